"""Mitsuba: whether it runs here, the lights it gets, and paths that serve many lights against its own integrators."""

import importlib.util
import os
from dataclasses import replace

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import shapes
from prtnet.data.lighting.lamp import Lamp, Lighting, arriving, scaled, together
from prtnet.data.lightmap import hair, many_lights, mitsuba, strands, subsurface
from prtnet.data.part import Part
from prtnet.data.samples import area_uniform
from prtnet.data.scene import IDENTITY, assemble

AIM = (0.48, -0.64, 0.6)
POINT = Lighting((Lamp("point", (3.0, 2.0, 1.0), (0.4, 1.9, 0.8)),))
SPOT = Lighting((Lamp("spot", (6.0, 5.0, 4.0), (-0.96, 1.28, -1.2), AIM, 10.0, 25.0),))
SUN = Lighting((Lamp("directional", (0.5, 1.0, 2.0), aim=AIM),))


def sky() -> Lighting:
    coefficients = np.zeros((9, 3), np.float32)
    coefficients[0], coefficients[1], coefficients[3] = np.sqrt(4 * np.pi), [0.9, 0.5, -0.4], 0.6
    return Lighting((), coefficients)


WHITE = Lighting((), np.full((1, 3), np.sqrt(4 * np.pi), np.float32))


@pytest.fixture(scope="module")
def mi():
    try:
        return mitsuba.module()
    except PrtnetError as error:
        pytest.skip(f"needs the extra paths and an LLVM that Dr.Jit compiles with: {error}")


def ball(albedo=(0.9, 0.6, 0.3), two_sided=False):
    shape = shapes.ellipsoid([1.0, 1.0, 1.0], 24)
    part = Part("wax", shape.vertices, shape.faces, albedo=np.asarray(albedo), two_sided=two_sided)
    return replace(assemble("ball", [part]).centred(), frame=IDENTITY)


def test_absent_is_said_with_the_line_to_type(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(PrtnetError, match=r"pip install 'mitsuba"):
        mitsuba.check()


def test_llvm_that_kills_is_found_in_another_process(mi, monkeypatch, tmp_path):
    monkeypatch.setenv(mitsuba.SETTING, str(tmp_path / "libLLVM.so"))
    with pytest.raises(PrtnetError, match=r"apt-get install libllvm19"):
        mitsuba.check()


def test_the_first_library_that_lives_is_chosen(mi, monkeypatch):
    monkeypatch.delenv(mitsuba.SETTING)
    monkeypatch.setattr(mitsuba, "libraries", lambda: ["bad", "good", "later"])
    monkeypatch.setattr(mitsuba, "survives", lambda library: library != "bad")
    mitsuba.check()
    assert os.environ[mitsuba.SETTING] == "good"


def test_newest_llvm_first(monkeypatch, tmp_path):
    for name in ("libLLVM-15.so.1", "libLLVM.so.19.1", "libLLVM-9.so", "libLLVM.so", "libLLVMSupport.a"):
        (tmp_path / name).touch()
    monkeypatch.setattr(mitsuba, "FOLDERS", (str(tmp_path),))
    monkeypatch.setattr(mitsuba.Path, "glob", lambda self, pattern: [] if "llvm-*" in pattern else self.iterdir())
    names = [os.path.basename(path) for path in mitsuba.libraries()]
    assert names == ["libLLVM.so.19.1", "libLLVM-15.so.1", "libLLVM-9.so"]


@pytest.mark.parametrize("lighting", [POINT, SPOT, SUN], ids=lambda each: each.lamps[0].kind)
def test_lamps_send_what_ours_do(mi, lighting):
    import drjit as dr

    rng, lamp = np.random.default_rng(0), lighting.lamps[0]
    places = np.asarray(lamp.position) + rng.normal(size=(2000, 3)) * 0.4 + 1.5 * np.asarray(AIM)
    towards, _, strength = arriving(lamp, places)
    scene = mi.load_dict({"type": "scene", "ball": {"type": "sphere", "radius": 9.0}, **mitsuba.emitters(lighting)})
    found = dr.zeros(mi.SurfaceInteraction3f, len(places))
    found.p = mi.Point3f(places.T.astype(np.float32))
    sample, weight = scene.emitters()[0].sample_direction(found, mi.Point2f(0.5))
    wanted = strength[:, None] * np.asarray(lamp.colour)
    if lamp.kind == "spot":
        falling = strength * np.sum((places - lamp.position) ** 2, axis=1)
        assert np.mean((falling > 0) & (falling < 0.999)) > 0.2
    np.testing.assert_allclose(np.broadcast_to(np.array(weight).T, wanted.shape), wanted, atol=0.01 * wanted.max())
    np.testing.assert_allclose(np.broadcast_to(np.array(sample.d).T, towards.shape), towards, atol=1e-4)


def test_environment_is_the_sh_light_without_what_rings_below_0(mi):
    import drjit as dr

    light = sky()
    light = replace(light, environment=light.environment * np.array([1, 2.2, 1], np.float32))
    light.environment[3] *= 4
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = dr.zeros(mi.SurfaceInteraction3f, len(directions))
    found.wi = mi.Vector3f(-directions.T.astype(np.float32))
    emitter = mi.load_dict(mitsuba.emitters(light)["environment"])
    wanted = sh.evaluate(directions, 3) @ light.environment
    assert (wanted < 0).mean() > 0.05
    np.testing.assert_allclose(np.array(emitter.eval(found)).T, np.maximum(wanted, 0), atol=0.03)


def by_integrator(mi, made, rays, count, samples, kind):
    """Mean radiance of each texel and its standard error, by Mitsuba's own integrator."""
    import drjit as dr

    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(77, count * samples)
    ray = rays(sampler, dr.arange(mi.UInt32, count * samples) % count)
    integrator = mi.load_dict({"type": kind, "max_depth": 2048, "rr_depth": 64})
    found = np.array(integrator.sample(made, sampler, mi.RayDifferential3f(ray))[0]).T.reshape(samples, count, 3)
    return found.mean(axis=0), found.std(axis=0) / np.sqrt(samples)


def agree(ours, error, theirs, their_error, least):
    """Means over texels within 4 standard errors of their difference, which is at most `least` of the mean."""
    one = np.sqrt(np.sum(error[:, None] ** 2 + their_error**2, axis=0)) / len(ours)
    away = (ours - theirs).mean(axis=0) / one
    assert np.abs(away).max() < 4, away
    assert one.mean() < least * theirs.mean(), "too noisy to tell"


@pytest.mark.parametrize("lighting", [sky(), POINT], ids=["sky", "point"])
def test_paths_in_a_medium_against_the_integrator_of_volumes(mi, lighting, monkeypatch):
    # of less noise than the boundary that pictures have
    monkeypatch.setattr(subsurface, "ROUGHNESS", 0.8)
    scene, kept = ball(), {}
    points = area_uniform(scene, 64, np.random.default_rng(0))
    own = many_lights.radiance
    monkeypatch.setattr(
        many_lights,
        "radiance",
        lambda made, start, *rest, **more: own(made, kept.setdefault("rays", start), *rest, **more),
    )
    ours = subsurface.lightmaps(scene, points, [lighting], samples=2048, density=6.0, seed=1)
    made = subsurface.made_of(scene, density=6.0, extra=mitsuba.emitters(lighting))
    theirs, error = by_integrator(mi, made, kept["rays"], 64, 2048, "volpath")
    agree(ours.values[0], ours.noise, theirs, error, 0.04)


def test_fibres_against_the_path_integrator(mi, monkeypatch):
    curves, kept = strands.straight(24, np.random.default_rng(3), radius=0.03), {}
    own = many_lights.radiance
    monkeypatch.setattr(
        many_lights,
        "radiance",
        lambda made, start, *rest, **more: own(made, kept.setdefault("rays", start), *rest, **more),
    )
    ours = hair.lightmaps(curves, [POINT], samples=96, seed=1)
    made = hair.made_of(curves, extra=mitsuba.emitters(POINT))
    theirs, error = by_integrator(mi, made, kept["rays"], 240, 96, "path")
    agree(ours.values[0], ours.noise, theirs, error, 0.04)


def test_lights_add_up_and_furnace_stays_white(mi, monkeypatch):
    """The paths do not depend on the light: sums are exact. A medium that takes nothing, under even light, shows it,
    but for what a rough boundary loses between its facets, which is little where it is almost smooth."""
    monkeypatch.setattr(subsurface, "ROUGHNESS", 0.03)
    scene = ball((1.0, 1.0, 1.0))
    points = area_uniform(scene, 48, np.random.default_rng(0))
    lights = [POINT, SPOT, scaled(POINT, 3.0), together([POINT, SPOT, WHITE]), WHITE]
    made = subsurface.lightmaps(scene, points, lights, samples=256, density=4.0, seed=1)
    point, spot, thrice, all_, white = made.values
    np.testing.assert_allclose(thrice, 3 * point, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(all_, point + spot + white, rtol=1e-4, atol=1e-5)
    assert 0.97 < white.mean() < 1.005
    again = subsurface.lightmaps(scene, points, [WHITE, *lights[:4]], samples=256, density=4.0, seed=2).values[0]
    assert np.abs(white - again).max() > 1e-4


def test_what_is_no_solid_is_refused(mi):
    scene, points = ball(two_sided=True), area_uniform(ball(), 4, np.random.default_rng(0))
    with pytest.raises(PrtnetError, match="only open parts"):
        subsurface.lightmaps(scene, points, [WHITE], samples=2, density=1.0, seed=0)
    with pytest.raises(PrtnetError, match=r"found \['jade'\].*wax"):
        subsurface.lightmaps(ball(), points, [WHITE], samples=2, density=1.0, seed=0, solid=["jade"])
    with pytest.raises(PrtnetError, match="density"):
        subsurface.lightmaps(ball(), points, [WHITE], samples=2, density=0.0, seed=0)
    with pytest.raises(PrtnetError, match="at least 2"):
        subsurface.lightmaps(ball(), points, [WHITE], samples=1, density=1.0, seed=0)
    with pytest.raises(PrtnetError, match="roughness"):
        hair.made_of(strands.straight(2, np.random.default_rng(0)), fibre=hair.Fibre(longitudinal_roughness=2.0))
