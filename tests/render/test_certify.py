"""The figures of certificates: a wrong number in any of the exported texts is seen."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.export import certificate
from prtnet.export.bundle import bundle
from prtnet.export.form import Form
from prtnet.export.spelling import number
from prtnet.render import certify, verify
from tests.nets import random_net


def measured(made, net):
    points = certify.Points(*verify.random_points(300, np.random.default_rng(0)))
    return certify.errors_and_timing(made, net, points)["errors"]


@pytest.mark.parametrize("groups", [1, 4])
def test_each_text_is_measured(groups):
    net = random_net(width=6, depth=1, bands=3, groups=groups, output="linear", residual=True)
    made = bundle(net, Form())
    found = measured(made, net)
    assert list(found) == ["coefficients", "diffuse shading", "glossy shading", "diffuse shading, light folded"]
    certificate.refuse(found)
    assert made.irradiance
    albedo = number(1 / np.pi)
    weight, wrong = number(net.weights[0][0, 0]), number(net.weights[0][0, 0] + 0.01)
    for change, what in (
        ({"shading": made.shading.replace(albedo, "0.319")}, "diffuse shading"),
        ({"shading": made.shading.replace("reflect(-view", "reflect(view")}, "glossy shading"),
        ({"irradiance": made.irradiance.replace(weight, wrong, 1)}, "diffuse shading, light folded"),
        ({"transfer": made.transfer.replace(weight, wrong, 1)}, "coefficients"),
    ):
        with pytest.raises(PrtnetError, match=f"export: {what}: found an error"):
            certificate.refuse(measured(replace(made, **change), net))
