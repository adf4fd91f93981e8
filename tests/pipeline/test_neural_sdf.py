import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.config import SdfOptions
from prtnet.data.part import Part
from prtnet.data.scene import assemble
from prtnet.data.shapes import ellipsoid
from prtnet.models import neural_sdf as fitting
from prtnet.pipeline.job import open_job
from prtnet.pipeline.neural_sdf import implicit_of_mesh
from prtnet.store import Store
from tests.pipeline.test_pipeline import config

OPTIONS = SdfOptions(width=16, depth=1, steps=250)


@pytest.fixture(autouse=True)
def few_points(monkeypatch):
    monkeypatch.setattr(fitting, "POINTS", 1 << 13)
    monkeypatch.setattr("prtnet.data.implicit.surface_error.RESOLUTION", 40)


@pytest.fixture(scope="module")
def egg():
    surface = ellipsoid([1, 2, 1.5], 48).moved(5, 0, 0)
    return assemble("egg", [Part("egg", surface.vertices, surface.faces, albedo=np.array([0.1, 0.5, 0.2]))])


def test_a_mesh_becomes_a_surface_once(egg, tmp_path, monkeypatch):
    made = implicit_of_mesh(egg, OPTIONS, Store(tmp_path))
    assert 0 < made.facts["chamfer"] < made.facts["worst"] < OPTIONS.largest_error
    assert made.facts["cpu_seconds"] > 0
    monkeypatch.setattr(fitting, "fit", None)
    found = implicit_of_mesh(egg, OPTIONS, Store(tmp_path))
    assert found.implicit.field.digest() == made.implicit.field.digest()
    assert found.facts == made.facts
    # with room for a surface that bulges
    np.testing.assert_array_equal(found.implicit.frame.centre, egg.frame.centre)
    assert 0.9 * egg.frame.scale < found.implicit.frame.scale < egg.frame.scale
    np.testing.assert_allclose(found.implicit.materials[0].albedo, [0.1, 0.5, 0.2], rtol=1e-5)
    # the frame leads from the file's coordinates to the field's
    at = found.implicit.frame.to_unit(np.array([[5.0, 0, 0], [8, 0, 0]]))
    assert found.implicit.field.distance(at)[0] < 0 < found.implicit.field.distance(at)[1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"largest_error": 1e-4}, r"egg: found a neural surface that is off by up to .* expected at most 0\.01 %"),
        ({"steps": 1}, r"raise sdf\.width or sdf\.steps"),
        ({"width": 0}, r"sdf\.width: found 0, expected at least 1"),
        ({"steps": 0}, r"sdf\.steps: found 0"),
    ],
)
def test_a_fit_that_is_none_leaves_nothing(egg, tmp_path, change, message):
    options = SdfOptions(**({"width": 4, "depth": 1, "steps": 60} | change))
    with pytest.raises(PrtnetError, match=message):
        implicit_of_mesh(egg, options, Store(tmp_path))
    assert not [file for file in tmp_path.rglob("*") if file.is_file()]


def test_the_scene_wants_a_mesh(tmp_path):
    with pytest.raises(PrtnetError, match=r"scene\.path: found none with scene=neural_sdf, expected the mesh"):
        open_job(config(tmp_path, scene__name="neural_sdf"), "", None)
