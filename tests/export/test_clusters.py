"""Weights and cubes of clusters in GLSL against NumPy, and what cannot be one program."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError, clusters, gl, netspec
from prtnet.clusters import ClusterSpec, Plane, Split
from prtnet.export import clusters as spelt
from prtnet.export import glsl
from prtnet.export.form import Form
from prtnet.render import pixelwise, verify
from tests.nets import random_grid, random_net

TREE = Split((Plane(0, 0.1, 1, 2), Plane(2, -0.2, -1, -2), Plane(1, 0.3, -3, -4)))


def spec_of(delta: float = 0.15, split: Split = TREE, cluster=(0, 1, 2, 0), **fields) -> ClusterSpec:
    fields = {"bands": 2, "width": 4, "depth": 1, **fields}
    cubes = [((10.2, -3.0, 0.1 * index), 0.5 + index) for index in range(max(cluster) + 1)]
    nets = [random_net(seed=index, centre=cube[0], scale=cube[1], **fields) for index, cube in enumerate(cubes)]
    return ClusterSpec(split, cluster, delta, tuple(nets), (10.0, -3.0, 0.0), 0.75)


def points(count: int = 2000) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1, 1, (count, 3)).astype(np.float32)


def run(spec: ClusterSpec, statement: str, values: np.ndarray, more: str = "") -> np.ndarray:
    lines = ["uniform sampler2D positions; out vec4 colour;", spelt.functions(spec), more, "void main() {"]
    lines += ["vec4 given = texelFetch(positions, ivec2(gl_FragCoord.xy), 0); vec3 position = given.xyz;"]
    lines += [f"float weights[{len(spec.nets)}];", statement, "}"]
    drawn = pixelwise.Pass("\n".join(lines), {"positions": gl.upload(pixelwise.image(values))})
    return drawn.read()[: len(values)]


@pytest.mark.parametrize("delta", [0.0, 0.15, 0.5])
def test_weights_are_those_of_numpy(delta):
    spec = spec_of(delta)
    found = run(
        spec,
        "prt_cluster_weights(position, weights); colour = vec4(weights[0], weights[1], weights[2], 1.0);",
        points(),
    )
    expected = clusters.weights(spec, points())
    np.testing.assert_allclose(found[:, :3], expected, atol=1e-6)
    # outside of the blend no net runs for rounding
    beyond = np.isin(expected, (0, 1))
    np.testing.assert_array_equal(found[:, :3][beyond], expected[beyond])
    assert beyond.any()


def test_shares_are_of_all_weights_so_far():
    spec = spec_of()
    expected = clusters.weights(spec, points())
    for index in range(3):
        found = run(spec, "colour = vec4(prt_cluster_share(position), 0.0, 0.0);", points(), spelt.share(spec, index))
        np.testing.assert_allclose(found[:, 0], expected[:, index], atol=1e-6)
        np.testing.assert_allclose(found[:, 1], expected[:, : index + 1].sum(axis=1), atol=1e-6)


def test_positions_are_those_of_each_cube():
    spec = spec_of()
    for index, net in enumerate(spec.nets):
        file = points().astype(np.float64) / spec.scale + spec.centre
        expected = (file - np.array(net.centre)) * net.scale
        found = run(spec, f"colour = vec4(prt_cluster_position({index}, position), 1.0);", points())
        np.testing.assert_allclose(found[:, :3], expected, atol=2e-6)


def test_parts_lead_to_clusters():
    spec = spec_of(0.0, Split(parts=4), (1, 0, 2, 1))
    values = np.repeat(np.arange(4, dtype=np.float32)[:, None], 3, axis=1)
    statement = "prt_cluster_weights(int(position.x), weights); colour = vec4(weights[0], weights[1], weights[2], 1.0);"
    np.testing.assert_array_equal(run(spec, statement, values)[:, :3], np.eye(3)[[1, 0, 2, 1]])


def test_a_stack_is_the_blend():
    spec = spec_of(grids=(random_grid(2, 3, 4),))
    stack = spelt.stacked(spec, Form())
    normals = verify.random_points(500, np.random.default_rng(1))[1]
    one = replace(spec.nets[0], grids=stack.grids)
    found = verify.run(one, stack.text, points(500), normals, weights=stack.weights)
    np.testing.assert_allclose(found, clusters.evaluate_unit(spec, points(500), normals), atol=5e-5)


def test_what_is_exported_is_valid():
    spec = spec_of(grids=(random_grid(2, 3, 4),), position_frequencies=1)
    for version in ("330", "300 es"):
        stack = spelt.stacked(spec, Form(version=version))
        glsl.validate(glsl.whole(version, glsl.around(spec.nets[0], stack.text)))


def test_nets_of_other_sizes_are_no_one_program():
    spec = spec_of()
    for other, words in (
        (random_net(bands=2, width=8, depth=1, seed=1), r"layers \[.*4, 4\] and \[.*8, 4\]"),
        (random_net(bands=2, width=4, depth=1, seed=1, activation="silu"), "other encodings, activations or grids"),
    ):
        mixed = replace(spec, nets=(spec.nets[0], replace(other, centre=spec.nets[1].centre), spec.nets[2]))
        with pytest.raises(
            PrtnetError, match=f"split.select: found fragment with nets of {words}, expected all alike; use draw"
        ):
            spelt.stacked(mixed, Form())


def test_a_stack_that_no_driver_holds_is_refused():
    spec = spec_of(
        width=64,
        depth=2,
        split=Split(tuple(Plane(0, 0.01 * i, i + 1 if i < 39 else -1, -2 - i) for i in range(40))),
        cluster=tuple(range(41)),
    )
    with pytest.raises(PrtnetError, match=r"texels along a side of the weight texture, expected at most 1024"):
        spelt.stacked(spec, Form())
    assert netspec.macs(spec.nets[0]) < 10_000
