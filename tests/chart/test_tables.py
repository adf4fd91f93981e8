from dataclasses import replace

import pytest

from prtnet.chart import tables
from tests.rows import BOTH_REFERENCES, FLOOR, NET, ROWS, TEXTURE, TWO_SCENES


def body(text: str) -> list[str]:
    """The lines of a table's rows, without headings, titles and rules."""
    names = ("net", "texture", "noise")
    return [line for line in text.splitlines() if line.startswith(names)]


def test_numbers_are_short() -> None:
    assert [tables.count(value) for value in (5, 999, 1000, 17_321, 999_999, 2.5e9)] == [
        "5",
        "999",
        "1k",
        "17.3k",
        "1M",
        "2.5G",
    ]
    assert [tables.size(value) for value in (12, 70_123, 117_440_512)] == ["12 B", "70.1 kB", "117 MB"]
    assert [tables.duration(value) for value in (0.52, 12.34, 120, 9000)] == ["0.52 s", "12.3 s", "2.0 min", "2.5 h"]
    assert [tables.milliseconds(value) for value in (0.1234, 8.14, 1234.6)] == ["0.123", "8.14", "1235"]
    assert tables.ratio(16.44) == "16.4x"
    assert tables.percent(0.0123) == "1.2 %"


def test_table_has_a_line_per_row_in_order_and_marks_the_best() -> None:
    lines = body(tables.table(ROWS))
    assert [line.split("  ")[0] for line in lines] == ["net", "net published", "texture", "noise floor"]
    assert "46.92*" in lines[2]
    assert "44.51 " in lines[0]
    assert "56.13 " in lines[3]
    assert "70.1 kB*" in lines[0]
    assert "8.14x" in lines[0]


def test_references_are_never_compared() -> None:
    lines = body(tables.table(BOTH_REFERENCES))
    assert len(lines) == 5
    assert "texture" in lines[-1]
    assert "*" not in lines[-1]


def test_a_reference_against_another_is_no_rival() -> None:
    """Its row stands with those against the same reference, and is never the best of them."""
    exact = [replace(row, reference="exact") for row in ROWS]
    lines = [
        line.split()
        for line in tables.table(
            [*BOTH_REFERENCES, *exact, replace(FLOOR, method="traced", reference="exact")]
        ).splitlines()
        if " exact " in line
    ]
    assert [" ".join(line[: line.index("exact")]) for line in lines] == [
        "net", "net published", "texture", "traced", "noise floor",
    ]  # fmt: skip
    best = [any(cell.endswith("*") for cell in line) for line in lines]
    assert best == [True, True, True, False, False]
    assert lines[2][lines[2].index("exact") + 1] == "46.92*"


def test_columns_line_up_and_fit() -> None:
    long = [
        replace(row, scene="s" * 300, light="l" * 90, method="a very long name of a method " * 3, flip=0.01)
        for row in ROWS
    ]
    for rows in (ROWS, TWO_SCENES, long, [replace(row, ms=123_456.7, macs=10**9, flip=0.1234) for row in ROWS]):
        text = tables.table(rows)
        assert max(map(len, text.splitlines())) <= tables.WIDTH
        assert "PSNR" in text
        assert "size" in text
    at = tables.table(ROWS).splitlines()[1].index("PSNR") + 4
    assert all(line[:at].split()[-1].rstrip("*").replace(".", "").isdigit() for line in body(tables.table(ROWS)))


def test_columns_nobody_measured_are_left_out() -> None:
    assert "FLIP" not in tables.table(ROWS)
    assert "FLIP" in tables.table([replace(NET, flip=0.02), TEXTURE])
    assert tables.table([]) == ""


def test_scenes_stand_apart() -> None:
    text = tables.table(TWO_SCENES)
    assert "plants · diffuse · sky (8 views)" in text
    assert "room · diffuse · sky (8 views)" in text
    assert len(body(text)) == len(TWO_SCENES)


def test_order_does_not_depend_on_that_of_the_input() -> None:
    assert tables.table(ROWS) == tables.table(ROWS[::-1])


def test_markdown_has_every_row_and_escapes() -> None:
    text = tables.markdown([*TWO_SCENES, replace(NET, scene="a|b <script>*x*")])
    assert text.count("| noise floor |") == 2
    assert text.count("| net |") == 3
    assert "**46.92**" in text
    assert "<script>" not in text
    assert r"a\|b &lt;script>\*x\*" in text
    widths = {line.replace(r"\|", "").count("|") for line in text.splitlines() if line.startswith("|")}
    assert len(widths) == 1


@pytest.mark.parametrize("row", [NET, FLOOR])
def test_a_single_row_has_no_best(row: tables.Row) -> None:
    assert "*" not in tables.table([row])
