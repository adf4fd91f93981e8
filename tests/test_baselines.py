"""The arithmetic of the study of baselines, against arrays that are really there."""

import numpy as np
import pytest

from experiments import baselines
from prtnet import score, sh
from prtnet.data import builtin, matrix, vertex
from prtnet.data.texture import page_of
from prtnet.data.tracer import Tracer
from prtnet.render.vertex import pack
from tests.nets import random_net


@pytest.mark.parametrize("bands", [2, 3])
def test_forms_take_what_real_arrays_take(bands):
    mesh = vertex.mesh(builtin.make("cornell", tessellation=0.25))
    count, size, k = len(mesh.vertices), 32, sh.count(bands)
    net = random_net(bands=bands)
    found = {form.name: form.bytes for form in baselines.forms(count, size**2, bands, net, {})}
    options = {"bands": bands, "directions": 4, "rng": np.random.default_rng(0)}
    assert found["vertex matrix"] == matrix.bake(Tracer(mesh), mesh.vertices, mesh.normals, **options).nbytes
    assert found["vertex vector"] == np.zeros((count, k), np.float32).nbytes
    assert found["texel vector"] == page_of(np.zeros((size, size, k), np.float32)).levels[0].nbytes
    assert found["texel matrix"] == np.zeros((size, size, k, k), np.float32).nbytes
    assert found["net"] == sum(array.nbytes for array in (*net.weights, *net.biases))
    assert found["512^3 grid of vectors"] == 512**3 * np.zeros((1, k), np.float32).nbytes


def test_real_arrays_stand_in_for_what_is_computed():
    forms = baselines.forms(
        10, 4, 5, random_net(), {"vertex vector": pack(np.zeros((10, 25), np.float32), 4096).nbytes}
    )
    by_name = {form.name: form for form in forms}
    # 25 coefficients lie in 28 floats
    assert by_name["vertex vector"].bytes == score.vertex_bytes(10, 25) == 10 * 28 * 4
    assert by_name["vertex matrix"].real is None
    assert by_name["vertex matrix"].bytes == 10 * 625 * 4


def test_tables_say_what_was_computed():
    row = {"scene": "room", "mesh": "", "form": "net", "vertices": 8, "bytes": 1000, "from": "arrays"}
    text = baselines.memory_table([row, row | {"form": "grid", "bytes": 13_421_772_800, "from": "computed"}])
    assert text.splitlines()[-1] == "| room | 1 kB | *13.4 GB* |"
