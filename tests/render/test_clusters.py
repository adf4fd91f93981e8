"""Pictures of several nets against the plain twin on the same pixels, and against each other."""

from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError, clusters, sh
from prtnet.clusters import ClusterSpec, Plane, Split
from prtnet.data import atlas, builtin
from prtnet.export import clusters as spelt
from prtnet.export.bundle import bundle
from prtnet.export.form import Form
from prtnet.render.camera import Camera
from prtnet.render.clusters import ClusterMethod, DeferredClusters, faces_of, leaf_boxes, stack_method
from prtnet.render.gbuffer import shade
from prtnet.render.material import DIFFUSE, Material
from prtnet.render.method import NetMethod
from prtnet.render.raster import Raster
from tests.nets import random_grid, random_hash, random_net

SIZE = 48
EYE = Camera((0.4, 0.9, 2.6), (0.0, 0.0, 0.0), fov_y=45.0, near=0.1, far=10.0)
GLOSSY = Material(diffuse=0.5, specular=(0.5, 0.25, 0.5), exponent=12.0)
# four leaves, two of which are one cluster
TREE = Split((Plane(0, 0.1, 1, 2), Plane(2, -0.2, -1, -2), Plane(1, 0.3, -3, -4)))
CUBES = (((-0.4, 0.0, 0.0), 1.25), ((0.3, 0.1, -0.2), 1.0), ((0.0, 0.0, 0.0), 1.5))


@pytest.fixture(scope="module")
def raster() -> Raster:
    return Raster(atlas.make(builtin.make("cornell", tessellation=0.25).centred(), size=64), SIZE)


def spec_of(raster: Raster, delta: float = 0.15, *, split: Split = TREE, cluster=(0, 1, 2, 0), **fields) -> ClusterSpec:
    """Nets in cubes of their own, in the units of the raster's scene."""
    nets = []
    for index in range(max(cluster) + 1):
        centre, scale = CUBES[index]
        fields = {"bands": 3, "width": 6, "depth": 1, "position_frequencies": 2, **fields}
        nets.append(random_net(seed=index, centre=centre, scale=scale, **fields))
    return ClusterSpec(split, cluster, delta, tuple(nets))


def bundles(spec: ClusterSpec, form: Form | None = None):
    return [bundle(net, form or Form()) for net in spec.nets]


def light_of(material: Material = DIFFUSE) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(sh.count(material.orders(3)[0]), 3)).astype(np.float32)


def twin(raster: Raster, spec: ClusterSpec, material: Material = DIFFUSE) -> np.ndarray:
    found = raster.gbuffer(EYE)
    transfer = clusters.evaluate_unit(spec, found.positions, found.normals, found.part)
    return shade(found, transfer, light_of(material), material, groups=spec.nets[0].groups)


def assert_alike(found: np.ndarray, expected: np.ndarray, mean: float = 1e-5) -> None:
    """Points of the twin are found in float64, those of shaders by the rasteriser."""
    scale = np.abs(expected).max()
    assert scale > 0.1
    np.testing.assert_allclose(found, expected, atol=1e-3 * scale)
    assert np.abs(found - expected).mean() < mean * scale


@pytest.mark.parametrize(
    "material", [DIFFUSE, GLOSSY, replace(GLOSSY, product="full")], ids=["diffuse", "fixed", "full"]
)
@pytest.mark.parametrize("fields", [{}, {"output": "linear", "groups": 4, "residual": True}], ids=["tanh", "folded"])
def test_draw_calls_give_the_blend_of_numpy(raster, material, fields):
    spec = spec_of(raster, **fields)
    made = ClusterMethod(raster, spec, bundles(spec), material=material)
    assert_alike(made.draw(EYE, light_of(material)), twin(raster, spec, material))


@pytest.mark.parametrize("material", [DIFFUSE, replace(GLOSSY, product="full")], ids=["diffuse", "full"])
@pytest.mark.parametrize("border", ["clip", "assign"])
def test_one_program_for_all_gives_what_numpy_gives(raster, material, border):
    """Nets in stacked textures, blended or the dominant one alone."""
    features = {"grids": (random_grid(3, 4, 5),), "hashes": (random_hash(8), random_hash(16, channels=8))}
    spec = spec_of(raster, 0.15 if border == "clip" else 0.0, **features)
    stack = spelt.stacked(spec, Form(), blended=border == "clip")
    found = stack_method(raster, spec, stack, material=material).draw(EYE, light_of(material))
    expected = twin(raster, spec, material)
    if border == "assign":
        # pixels on a border, where rounding chooses
        few = (np.abs(found - expected).max(axis=2) > 1e-3 * np.abs(expected).max()).mean()
        assert few < 0.005
        return
    assert_alike(found, expected, mean=1e-4)


@pytest.mark.parametrize("material", [DIFFUSE, GLOSSY], ids=["diffuse", "fixed"])
def test_the_cpu_draws_what_numpy_gives(raster, material):
    spec = spec_of(raster, grids=(random_grid(3, 4, 5),))
    found = DeferredClusters(raster, spec, material=material).draw(EYE, light_of(material))
    expected = twin(raster, spec, material)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_one_cluster_is_the_plain_method(raster):
    spec = spec_of(raster, split=Split(), cluster=(0,))
    alone = replace(spec, nets=(replace(spec.nets[0], centre=(0.0, 0.0, 0.0), scale=1.0),))
    plain = NetMethod(raster, bundle(alone.nets[0], Form()).transfer).draw(EYE, light_of())
    for border in ("clip", "assign"):
        made = ClusterMethod(raster, alone, bundles(alone), border=border)
        assert made.triangles == len(raster.scene.faces)
        np.testing.assert_array_equal(made.draw(EYE, light_of()), plain)


def test_the_same_net_everywhere_shows_no_border(raster):
    """Blended or not, over triangles that are drawn twice."""
    net = replace(spec_of(raster).nets[0], centre=(0.0, 0.0, 0.0), scale=1.0)
    spec = replace(spec_of(raster), nets=(net, net, net))
    plain = NetMethod(raster, bundle(net, Form()).transfer).draw(EYE, light_of())
    for border in ("clip", "assign"):
        found = ClusterMethod(raster, spec, bundles(spec), border=border).draw(EYE, light_of())
        np.testing.assert_allclose(found, plain, atol=1e-5 * np.abs(plain).max())


def test_coincident_faces_are_no_brighter(raster):
    """Two of one place are blended one over the other: with nets that agree, they show what one of them does."""
    drawn = builtin.make("cornell", tessellation=0.25).centred()
    twice = {name: np.concatenate([getattr(drawn, name)] * 2) for name in ("faces", "part", "two_sided")}
    doubled = Raster(atlas.make(replace(drawn, **twice), size=64), SIZE)
    net = replace(spec_of(raster).nets[0], centre=(0.0, 0.0, 0.0), scale=1.0)
    spec = replace(spec_of(raster), nets=(net, net, net))
    images = [ClusterMethod(each, spec, bundles(spec)).draw(EYE, light_of()) for each in (raster, doubled)]
    np.testing.assert_allclose(*images, atol=1e-5 * np.abs(images[0]).max())


def test_draw_calls_have_the_triangles_of_their_regions(raster):
    spec, scene = spec_of(raster, 0.1), raster.scene
    rng = np.random.default_rng(0)
    bary = rng.dirichlet([1, 1, 1], len(scene.faces))
    corners = scene.vertices[scene.faces].astype(np.float64)
    points = np.einsum("fc,fcd->fd", bary, corners)
    touched, owned = faces_of(spec, scene, "clip"), faces_of(spec, scene, "assign")
    # no point has a weight whose triangle is left out, and each triangle has one owner
    assert not ((clusters.weights(spec, points).T > 0) & ~touched).any()
    np.testing.assert_array_equal(owned.sum(axis=0), 1)
    assert not (owned & ~touched).any()
    assert len(scene.faces) < touched.sum() < 2 * len(scene.faces)
    made = ClusterMethod(raster, spec, bundles(spec))
    assert made.triangles == touched.sum()


def test_boxes_of_leaves_fill_space():
    boxes = leaf_boxes(TREE)
    points = np.random.default_rng(0).uniform(-1, 1, (500, 3))
    inside = ((points[:, None] >= boxes[:, 0]) & (points[:, None] < boxes[:, 1])).all(axis=2)
    np.testing.assert_array_equal(inside, clusters.leaf_weights(TREE, 0.0, points) == 1)


def test_clipped_borders_are_smooth_and_assigned_ones_follow_the_mesh(raster):
    """Of nets that disagree: assigned triangles leave a hard step, in the plain twin as on screen."""
    spec = spec_of(raster, 0.15)
    assigned = ClusterMethod(raster, spec, bundles(spec), border="assign").draw(EYE, light_of())
    found = raster.gbuffer(EYE)
    owner = faces_of(spec, raster.scene, "assign").argmax(axis=0)[found.face]
    by_part = ClusterSpec(Split(parts=3), (0, 1, 2), 0.0, spec.nets)
    transfer = clusters.evaluate_unit(by_part, found.positions, found.normals, owner)
    assert_alike(assigned, shade(found, transfer, light_of()))
    deferred = DeferredClusters(raster, spec, border="assign").draw(EYE, light_of())
    np.testing.assert_allclose(deferred, assigned, atol=1e-3 * np.abs(assigned).max())


def test_parts_have_clusters_of_their_own(raster):
    parts = len(raster.scene.materials)
    spec = spec_of(raster, 0.0, split=Split(parts=parts), cluster=tuple(part % 3 for part in range(parts)))
    assert_alike(ClusterMethod(raster, spec, bundles(spec)).draw(EYE, light_of()), twin(raster, spec))
    deferred = DeferredClusters(raster, spec).draw(EYE, light_of())
    np.testing.assert_allclose(deferred, twin(raster, spec), atol=1e-5 * np.abs(deferred).max())
    with pytest.raises(PrtnetError, match=r"split.select: found fragment for a scene split by its parts"):
        spelt.stacked(spec, Form())


def test_another_order_of_light_is_refused(raster):
    spec = spec_of(raster)
    for method in (ClusterMethod(raster, spec, bundles(spec)), DeferredClusters(raster, spec)):
        with pytest.raises(PrtnetError, match="light: found 16 SH coefficients, expected"):
            method.draw(EYE, np.zeros((16, 3), np.float32))
