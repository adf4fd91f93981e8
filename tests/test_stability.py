"""The study of stability: small cases from the mesh to the row, and the arithmetic of quantised weights."""

import csv
import math
from dataclasses import replace

import numpy as np
import pytest

from experiments.stability import meshes, report, run
from experiments.stability.cases import CASES, Case, Value
from prtnet import netspec
from prtnet.data.repair import is_closed
from tests.nets import random_net, random_points

SIZES = run.Sizes(
    atlas=64, pixels=48, views=2, traced=32, samples=2000, directions=16, steps=30, width=8, depth=1, test=100
)
OWN = {"scene.two_sided": "none", "scene.camera": "orbit", "vertex.subdivide": ["floor"], "vertex.level": 2}


def case_of(name: str, **parts: meshes.Parts) -> Case:
    """A case of that name with small scenes of its own."""
    values = tuple(Value(label, OWN, scene) for label, scene in parts.items())
    return Case(name, "A reason.", "an axis", values, values[0].label)


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    """(folder of the results, their rows) of a study of two cases."""
    base = tmp_path_factory.mktemp("stability")
    (base / "README.md").write_text(f"before\n{report.START}old\n{report.END}after\n")
    near = meshes.contact(0.1)
    cases = [
        replace(case_of("far", here=near, far=meshes.far(near, 1e4)), shown=None),
        case_of("ground", small=meshes.plane(3)),
    ]
    run.study(cases, SIZES, base / "out", base / "results", order=cases)
    return base, run.read(base / "results" / "stability.csv")


def test_rows_have_all_columns_and_finite_numbers(studied):
    base, rows = studied
    with (base / "results" / "stability.csv").open(newline="") as file:
        assert tuple(csv.DictReader(file).fieldnames or ()) == run.COLUMNS
    found = [(row["case"], row["value"], row["method"]) for row in rows]
    places = [("far", "here"), ("far", "far"), ("ground", "small")]
    assert found == [(*place, method) for place in places for method in run.METHODS]
    for row in rows:
        numbers = [row[column] for column in run.COLUMNS[3:]]
        assert all(math.isfinite(number) for number in numbers)
        assert 0 < row["p999"] <= row["worst"] <= 1
        assert row["other_part"] < 0.02


def test_far_from_the_origin_is_as_good_as_at_it(studied):
    _, rows = studied
    by_place = {(row["value"], row["method"]): row for row in rows if row["case"] == "far"}
    for method in run.METHODS:
        here, there = by_place["here", method], by_place["far", method]
        # training starts from positions that may differ in their last bit
        assert there["psnr"] == pytest.approx(here["psnr"], abs=0.1)
        assert there["worst"] == pytest.approx(here["worst"], abs=0.02)


def test_pictures_and_page_are_written(studied):
    base, _ = studied
    assert {file.name for file in (base / "results").iterdir()} == {"stability.csv", "chart.png", "sheet.jpg"}
    page = (base / "README.md").read_text()
    assert page.startswith("before\n")
    assert page.endswith("after\n")
    assert "old" not in page
    assert page.count("| ground | small |") == 1


def test_int8_is_the_plain_definition():
    weight = np.random.default_rng(0).normal(size=(5, 7)).astype(np.float32) * np.array([[1], [10], [0.01], [1], [0]])
    weight = weight.astype(np.float32)
    found = run.int8_by_row(weight)
    for row, kept in zip(weight, found, strict=True):
        largest = max(abs(float(value)) for value in row)
        for value, back in zip(row, kept, strict=True):
            step = largest / 127
            whole = round(float(value) / step) if step else 0
            assert -127 <= whole <= 127
            assert back == pytest.approx(whole * step, rel=1e-6)
    # a step of the whole matrix would lose the third row
    assert np.abs(found[2] - weight[2]).max() <= np.abs(weight[2]).max() / 127


def test_quantised_nets_stay_near_and_bytes_are_the_coarsest():
    net, (positions, normals) = random_net(width=32, depth=3), random_points(500)
    exact = netspec.evaluate_unit(net, positions, normals)
    off = {
        kind: np.abs(netspec.evaluate_unit(run.quantised(net, kind), positions, normals) - exact).max()
        for kind in ("float32", "float16", "int8")
    }
    assert off["float32"] == 0
    assert 0 < off["float16"] < 0.02
    assert off["float16"] < off["int8"] < 0.3


def test_errors_against_hand_made_images():
    wanted = np.zeros((10, 100, 3), np.float32)
    image, mask = wanted.copy(), np.ones((10, 100), bool)
    image[0, 0, 1], image[9, 99] = 0.5, 1.0
    mask[9, 99] = False
    found = run.errors([image, wanted], [wanted, wanted], [mask, mask])
    assert found["worst"] == 0.5
    # one pixel of 1998 is less than one in a thousand
    assert found["p999"] < 0.01
    assert found["psnr"] == pytest.approx((100 + 10 * math.log10(999 * 3 / 0.25)) / 2)


def test_cases_have_names_labels_and_scenes_of_their_own():
    assert len({case.name for case in CASES}) == len(CASES)
    for case in CASES:
        labels = [value.label for value in case.values]
        assert len(set(labels)) == len(labels)
        assert case.shown is None or case.shown in labels


@pytest.mark.parametrize("width", [0.4, 0.04])
def test_plates_with_holes_are_closed(width):
    plate = meshes.holes(width)["plate"]
    assert is_closed(plate.vertices, plate.faces)
    low, high = plate.vertices.min(axis=0), plate.vertices.max(axis=0)
    assert np.allclose(high - low, [2, 0.04, 2])


def test_grooves_keep_their_shape():
    # the sheet of half the period has as much area: the same walls, only smaller and more of them
    areas = [_area(meshes.grating(period)["grating"]) for period in (0.5, 0.25)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-6)


def _area(surface) -> float:
    a, b, c = np.moveaxis(surface.vertices[surface.faces], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def test_unknown_case_is_refused(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["run.py", "contct"])
    with pytest.raises(SystemExit):
        run.main()
    assert "contct" in capsys.readouterr().err
