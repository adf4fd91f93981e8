"""What only a GPU can show: `./run gpu-check`."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import netspec
from prtnet.models.train import train
from tests.models.test_train import MODEL, SHORT, points

pytestmark = pytest.mark.gpu


def test_training_on_cuda_ends_where_the_cpu_does():
    test = points(500, seed=9)
    errors = []
    for device in ("cpu", "cuda"):
        options = replace(SHORT, device=device)
        net = train(points(20_000), model=MODEL, options=options, steps=400).net
        errors.append(np.sqrt(np.mean((netspec.evaluate_unit(net, test.positions, test.normals) - test.transfer) ** 2)))
    # the sums run in another order, so the weights differ; what was learned does not
    assert errors[1] == pytest.approx(errors[0], rel=0.15)
