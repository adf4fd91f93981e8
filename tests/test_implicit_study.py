"""The study of implicit surfaces: its table and its picture say what scores and contact sheets say."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from experiments.implicit import report
from prtnet import PrtnetError, score
from prtnet.chart import sheet
from tests.rows import FLOOR, NET
from tests.test_experiments import composed

GREY = np.full((256, 256, 3), 0.5)


@pytest.fixture
def swept(tmp_path):
    """Two points of one surface; the net's picture is the only bright one."""
    base = tmp_path / "implicit"
    for width, psnr in ((128, 50.25), (64, 47.5)):
        folder = base / f"material=diffuse,model.width={width},scene=sdf_car"
        folder.mkdir(parents=True)
        net = replace(NET, scene="sdf_car", psnr=psnr, views=1)
        bare = replace(net, method="unshadowed", psnr=21.0, ms_ratio=1.0)
        score.write(folder / "score.json", [net, bare, replace(FLOOR, scene="sdf_car")], {})
        shown = {"traced": [GREY], "net": [GREY + 0.4], "unshadowed": [GREY]}
        sheet.contact_sheet(folder / "contact_sheet.png", shown, covered=[np.ones((256, 256), bool)])
    (base / "command.txt").write_text("prtnet -m experiment=implicit\n")
    return base


def test_rows_stand_by_width_with_their_own_figures(swept, tmp_path):
    report.main([swept], tmp_path / "results")
    lines = (tmp_path / "results" / "transfer.md").read_text().splitlines()[2:]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert [(each[2], each[3]) for each in cells] == [("64", "47.50"), ("128", "50.25")]
    assert {each[-1] for each in cells} == {"56.1"}
    assert "experiment=implicit" in (tmp_path / "results" / "command.txt").read_text()


def test_the_picture_has_the_net_where_it_says(swept, tmp_path):
    report.main([swept], tmp_path / "results")
    image = np.asarray(Image.open(tmp_path / "results" / "sheet.jpg").convert("L"), float)
    middles = [image[100, 100 + 200 * column] for column in range(len(report.SHOWN))]
    assert np.argmax(middles[:2]) == 1
    assert middles[1] > middles[3] + 50


def test_a_sweep_without_points_is_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(PrtnetError, match=r"found no point with a score\.json"):
        report.main([tmp_path / "empty"], tmp_path / "results")


def test_the_sweep_has_every_surface_in_two_widths_and_materials():
    params = composed("experiment=implicit", hydra=True).hydra.sweeper.params
    assert params["scene"].split(",") == ["sdf_monster", "sdf_fish", "sdf_rabbit", "sdf_car"]
    assert (params["model.width"], params["material"]) == ("64,128", "diffuse,glossy")
