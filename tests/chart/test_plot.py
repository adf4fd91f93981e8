from dataclasses import replace
from io import BytesIO
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.transforms import Bbox
from PIL import Image

from prtnet import PrtnetError
from prtnet.chart import plot
from prtnet.chart.labels import Labels, extents, overlap
from prtnet.chart.tables import Spread
from tests.rows import BOTH_REFERENCES, FLOOR, NET, ROWS, TEXTURE, TWO_SCENES

POINTS = st.lists(st.tuples(st.floats(0.1, 1e3), st.floats(10, 60)), max_size=20)


@settings(deadline=None)
@given(POINTS)
def test_front_holds_what_no_other_beats(points: list[tuple[float, float]]) -> None:
    def beaten(cost: float, accuracy: float) -> bool:
        return any((c <= cost and a > accuracy) or (c < cost and a >= accuracy) for c, a in points)

    assert plot.front(points) == sorted({point for point in points if not beaten(*point)})


@pytest.mark.parametrize(
    "rows",
    [
        [NET],
        [FLOOR],
        ROWS,
        BOTH_REFERENCES,
        TWO_SCENES,
        [replace(row, ms_ratio=None) for row in ROWS],
        [replace(NET, macs=None, bytes=None), FLOOR],
        [replace(NET, scene="$x$ _y_"), replace(NET, scene="z", method="$a")],
    ],
)
def test_chart_is_a_picture_and_the_same_each_time(tmp_path: Path, rows: list) -> None:
    first, second = tmp_path / "a.png", tmp_path / "b.png"
    plot.pareto(first, rows, title="a $title$")
    plot.pareto(second, rows[::-1], title="a $title$")
    assert first.read_bytes() == second.read_bytes()
    with Image.open(first) as image:
        assert image.size == (1320, 594)
        assert len(image.convert("RGB").getcolors(1 << 20) or []) > 20


def test_chart_draws_one_reference_only(tmp_path: Path) -> None:
    plot.pareto(tmp_path / "both.png", BOTH_REFERENCES)
    plot.pareto(tmp_path / "one.png", ROWS)
    assert (tmp_path / "both.png").read_bytes() == (tmp_path / "one.png").read_bytes()
    with pytest.raises(PrtnetError, match="no row against 'texture'"):
        plot.pareto(tmp_path / "none.png", ROWS, reference="texture")


@pytest.mark.parametrize("scenes", [1, 2])
def test_a_sweep_has_a_line_of_panels_for_each_scene(tmp_path: Path, scenes: int) -> None:
    rows = [
        replace(row, scene=f"scene {i}", point=point)
        for i in range(scenes)
        for row, point in ((NET, "a"), (replace(NET, psnr=40.0, macs=900), "$b$"), (TEXTURE, None), (FLOOR, None))
    ]
    spreads = {row: Spread(0.4, 3) if row.point == "a" else None for row in rows}
    plot.panels(tmp_path / "a.png", spreads, title="$x$")
    plot.panels(tmp_path / "b.png", dict(reversed(spreads.items())), title="$x$")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    plot.panels(tmp_path / "bare.png", dict.fromkeys(rows), title="$x$")
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "bare.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (1782, 55 + 484 * scenes)


def test_axes_of_a_sweep_keep_to_what_is_swept() -> None:
    swept = [replace(NET, psnr=level, point=str(level)) for level in (33.0, 34.0, 36.0)]
    above, below = replace(TEXTURE, psnr=40.0), replace(TEXTURE, psnr=29.0, method="vertex")
    close = replace(FLOOR, psnr=38.9)
    assert plot._near([*swept, above, below, close]) == ([*swept, close], [above, below])


def test_labels_keep_off_points_and_each_other() -> None:
    figure = plot.canvas(6, 5)
    axes = figure.add_axes((0.1, 0.1, 0.85, 0.85))
    points = [(200.0 + 9 * i, 250.0 + 5 * (i % 3), 8.0, f"method {i}", "black") for i in range(8)]
    discs = [Bbox.from_extents(x - r, y - r, x + r, y + r) for x, y, r, _, _ in points]
    Labels(points, list(discs)).write(axes)
    boxes = [text.get_window_extent() for text in axes.texts]
    assert len(boxes) == 8
    for index, box in enumerate(boxes):
        others = [*discs, *boxes[:index]]
        assert max(overlap(extents([box]), extents([other])) for other in others) < 0.02 * box.width * box.height
        assert axes.get_window_extent().containsx(box.x0)
        assert axes.get_window_extent().containsx(box.x1)


@pytest.mark.parametrize("history", [[(0, 0.5), (10, 0.1), (20, 0.02)], [(0, 0.5)], [(0, 0.0), (1, 1.0)], []])
def test_training_curve_is_a_picture(history: list[tuple[int, float]]) -> None:
    first, second = BytesIO(), BytesIO()
    plot.training_curve(first, history)
    plot.training_curve(second, history)
    assert first.getvalue() == second.getvalue()
    assert Image.open(first).size == (880, 352)
