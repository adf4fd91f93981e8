"""The study of data-driven transfer: its words are points that can be run, its tables say what files say."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from experiments.data_driven import directional, report
from prtnet import PrtnetError, score, sh
from prtnet.chart import sheet
from prtnet.data import builtin, samples
from prtnet.data.lighting.lamp import Lamp, Lighting
from prtnet.data.lightmap import poses
from prtnet.pipeline.data_driven import options
from tests.rows import FLOOR, NET
from tests.test_experiments import composed, options_of, words_of

KINDS = ("spot", "point", "directional", "environment")
WORDS = words_of("data_driven")


LEVELS = {"path_traced": 0.5, "data_driven": 0.0, "direct": 0.2, "projection": 0.6, "lightmap": 0.7}


def line(unseen: float, **words) -> dict:
    return words | {"training": unseen / 2, "unseen": unseen, "projection": unseen / 4}


def curves_of(unseen: float) -> dict:
    return {
        "elements": [line(unseen * 2, elements=4), line(unseen, elements=16)],
        "points": [line(unseen, points=256)],
        "ridge": [line(unseen, ridge=ridge) for ridge in (0.0, 0.01)],
        "configurations": [line(unseen, configurations=128)],
        "noise": [line(unseen, rays=1 / 4, noise=0.1)],
        "spaces": [line(unseen, channels="joint", gamma=1.0, coloured=5.0)],
        "lights": [line(unseen + place / 10, kind=kind) for place, kind in enumerate(KINDS)],
    }


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """Points with figures of their own, no run among them."""
    base = tmp_path_factory.mktemp("runs") / "data_driven"
    drawn = replace(NET, method="data_driven", scene="cornell", reference="path_traced", ms_ratio=1.5)
    for word, unseen in {"trained_on_spot": 0.4, "trained_on_all": 0.3, "matrix_each": 0.6}.items():
        folder = base / f"ablation={word}"
        folder.mkdir(parents=True)
        rows = [replace(drawn, psnr=30 + 10 * unseen), replace(drawn, method="direct", psnr=20.0, ms_ratio=1.0)]
        score.write(folder / "score.json", [*rows, replace(FLOOR, reference="path_traced")], {})
        made = curves_of(unseen)
        if word == "matrix_each":
            made["matrices"] = [line(0.6, matrices="each"), line(0.9, matrices="one")]
        (folder / "curves.json").write_text(json.dumps(made))
        frames = {name: [np.full((32, 32, 3), level) for _ in range(5)] for name, level in LEVELS.items()}
        frames["data_driven"] = [np.full((32, 32, 3), unseen) for _ in range(5)]
        sheet.contact_sheet(folder / "contact_sheet.png", frames, reference="path_traced")
    folder = base / "ablation=methods_cornell"
    folder.mkdir()
    others = [replace(NET, method=name, psnr=40 + number) for number, name in enumerate(("texture", "pca", "cpca"))]
    score.write(folder / "score.json", [*others, FLOOR], {})
    (base / "command.txt").write_text("prtnet -m experiment=data_driven\n")
    return base


@pytest.fixture(scope="module")
def reported(swept, tmp_path_factory):
    page = tmp_path_factory.mktemp("study") / "README.md"
    page.write_text("# Why?\n\n<!-- lights -->\nold\n<!-- end -->\n\nwords\n\n<!-- nobody -->\nkept\n<!-- end -->\n")
    return report.report(swept, page), page


def cells(text: str) -> list[list[str]]:
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in text.splitlines()[2:]]


@pytest.mark.parametrize("word", WORDS)
def test_every_point_can_be_run(word):
    found = options_of("experiment=data_driven", f"ablation={word}")
    options.check(found)
    assert (found.out, found.cache) == ("runs/data_driven", "runs/data_driven/cache")
    chosen = found.data_driven
    least = chosen.configurations * max(1, len(chosen.keyframes))
    assert least >= 2 * chosen.elements
    if word.startswith("trained_on_") and word != "trained_on_colours":
        # the same unseen lights, else the table would compare different ones
        default = options_of("experiment=data_driven", "ablation=trained_on_all").data_driven
        assert replace(chosen, scenario=default.scenario) == default
        assert tuple(chosen.lit_by) == KINDS


def test_the_sweep_runs_two_points_at_a_time_and_has_every_kind_of_light():
    hydra = composed("experiment=data_driven", hydra=True).hydra
    assert (hydra.mode.name, hydra.launcher.n_jobs) == ("MULTIRUN", 2)
    assert {f"trained_on_{kind}" for kind in (*KINDS, "all", "colours")} <= set(WORDS)
    assert len(WORDS) == len(set(WORDS))


@pytest.mark.parametrize("word", ["matrix_each", "matrix_one"])
def test_poses_of_the_small_box_keep_out_of_the_others(word):
    scene = builtin.make("cornell").centred()
    names = [part.name for part in scene.materials]
    for words in options_of("experiment=data_driven", f"ablation={word}").data_driven.keyframes:
        posed = poses.posed(scene, poses.parse(words))
        own = posed.part == names.index("small_box")
        points = samples.area_uniform(posed, 20_000, np.random.default_rng(0))
        points = points.positions[own[points.face]]
        assert len(points) > 500
        for name in ("floor", "back_wall", "left_wall", "right_wall", "tall_box"):
            faces = np.flatnonzero(posed.part == names.index(name))
            # of a convex solid
            heights = np.einsum(
                "pfi,fi->pf", points[:, None] - posed.vertices[posed.faces[faces, 0]], posed.face_normals[faces]
            )
            assert (heights.max(axis=1) > 0).all(), name


def test_a_table_has_a_line_for_each_database_and_a_column_for_each_light(reported):
    made, _ = reported
    assert cells(made["lights"]) == [
        ["spot", "0.400 / 0.100", "0.500 / 0.125", "0.600 / 0.150", "0.700 / 0.175"],
        ["all", "0.300 / 0.075", "0.400 / 0.100", "0.500 / 0.125", "0.600 / 0.150"],
    ]


def test_what_varies_stands_side_by_side(reported):
    made, _ = reported
    few, many = cells(made["elements"])
    assert few == ["4", "0.800 / 0.200", "0.600 / 0.150"]
    assert many == ["16", "0.400 / 0.100", "0.300 / 0.075"]
    assert cells(made["noise"])[1] == ["all", "1/4", "0.100", "0.300 / 0.075"]
    assert cells(made["spaces"])[1] == ["all", "joint", "1", "0.150", "0.300", "0.075", "5.000"]
    assert cells(made["matrices"]) == [["each", "0.300", "0.600", "0.150"], ["one", "0.450", "0.900", "0.225"]]


def test_pictures_and_methods_have_the_figures_of_their_scores(reported):
    made, _ = reported
    assert ["trained on spot", "20.0", "34.0", "-", "-", "56.1"] in cells(made["drawn"])
    assert [row[:3] for row in cells(made["methods"])] == [
        ["plants", "texture", "40.00"], ["plants", "pca", "41.00"], ["plants", "cpca", "42.00"],
        ["plants", "noise floor", "56.13"],
    ]  # fmt: skip


def test_the_page_gets_its_tables_and_keeps_its_words(reported):
    made, page = reported
    text = page.read_text()
    assert made["lights"] in text
    assert "old" not in text
    assert "words" in text
    assert "kept" in text
    # once more changes nothing
    assert report.fill(text, made) == text


def test_files_lie_beside_the_page(reported):
    _, page = reported
    results = page.parent / "results"
    with (results / "curves.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["point"] for row in rows} == {"trained_on_spot", "trained_on_all", "matrix_each"}
    assert len([row for row in rows if row["curve"] == "lights"]) == 12
    for name in ("curves.png", "failure.png", "methods.png"):
        assert (results / name).stat().st_size > 5000
    assert (results / "command.txt").read_text().startswith("prtnet -m experiment=data_driven\n# collected at commit ")


def test_views_are_cut_out_at_the_pictures(reported):
    _, page = reported
    with Image.open(page.parent / "results" / "views.jpg") as image:
        shown = np.asarray(image.convert("L"), float) / 255
    plan = sheet.Layout(4, 6, 256, 256)
    assert shown.shape[::-1] == plan.sheet
    middles = [
        [shown[y + 128, x + 128] for x, y in (plan.corner(row, column) for column in range(6))] for row in (0, 3)
    ]
    # path traced, direct, learned from spots, 8 x its error, from all, 8 x its error
    expected = [0.5, 0.2, 0.4, 0.8, 0.3, 1.0]
    assert np.allclose(middles, [expected, expected], atol=0.03)


def test_a_sweep_without_points_is_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(PrtnetError, match=r"found no point with a score\.json"):
        report.report(tmp_path / "empty", tmp_path / "README.md")
    assert not (tmp_path / "results").exists()


def test_coefficients_of_a_directional_light_are_those_of_its_irradiance():
    aim = np.array([0.6, -0.8, 0.0])
    lighting = Lighting((Lamp("directional", (2.0, 1.0, 0.5), aim=tuple(aim)),))
    found = directional.coefficients(lighting, 9)
    # an open floor receives colour times the cosine; what nine bands leave of a clamped cosine is below 1 %
    floor = np.array([0.0, 1.0, 0.0])
    irradiance = sh.cosine_lobe(floor[None], 9)[0] @ found
    assert irradiance == pytest.approx(0.8 * np.array([2.0, 1.0, 0.5]), rel=0.01)


def test_a_point_without_directional_lights_is_refused(tmp_path):
    class Made:
        class unseen:
            lightings = (Lighting((Lamp("spot", (1.0, 1.0, 1.0)),)),)

    class Job:
        out = tmp_path

    with pytest.raises(PrtnetError, match="no directional light"):
        directional.shown_of(Made, Job)
