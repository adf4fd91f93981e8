import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from PIL import Image

from prtnet import PrtnetError
from prtnet.chart import report
from tests.rows import NET, ROWS, TWO_SCENES

EVIL = '<script>alert("x")</script>'


class Page(HTMLParser):
    """What a browser would see: tags, links, text outside style and script, and cells by row."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.lines: list[list[str]] = []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "action", "data")]
        if tag == "tr":
            self.lines.append([])

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1] not in ("style", "script"):
            self.text += data
        if self.tags and self.tags[-1] in ("td", "th") and data.strip():
            self.lines[-1].append(data)


@pytest.fixture
def pictures(tmp_path: Path) -> dict[str, Path]:
    path = tmp_path / "pictures" / "sheet of views.png"
    path.parent.mkdir()
    Image.new("RGB", (8, 6), (200, 30, 10)).save(path)
    return {"All views": path}


def page(path: Path) -> Page:
    return Page(path.read_text(encoding="utf-8"))


def test_report_holds_everything_and_needs_no_network(tmp_path: Path, pictures: dict[str, Path]) -> None:
    path = tmp_path / "report.html"
    facts = {"triangles": 23_456, "GLSL error": 1.234567e-6, "tracer": None}
    report.report(
        path, TWO_SCENES, facts, pictures, title="plants & room", history=[(0, 1.0), (100, 0.1)],
        versions={"numpy": "2.4", "torch": None}, command="prtnet scene=plants 'stages=[bake,train]'",
    )  # fmt: skip
    seen = page(path)
    assert len(seen.links) == 2
    assert all(link.startswith("data:image/png;base64,") for link in seen.links)
    assert not re.search(r"url\(|@import|https?:|//cdn", path.read_text(encoding="utf-8"))
    methods = [line[0] for line in seen.lines if line and line[0] in ("net", "net published", "texture", "noise floor")]
    assert methods == ["net", "net published", "texture", "noise floor"] * 2
    for text in ("plants & room", "44.51", "23 456", "1.235e-06", "numpy", "All views", "Loss over 100 steps"):
        assert text in seen.text
    assert "prtnet scene=plants 'stages=[bake,train]'" in seen.text


def test_report_escapes_all_text(tmp_path: Path, pictures: dict[str, Path]) -> None:
    path = tmp_path / "report.html"
    rows = [replace(row, scene=EVIL, method=EVIL, light=EVIL, material=EVIL) for row in ROWS]
    evil_pictures = {EVIL + "\"'": next(iter(pictures.values()))}
    report.report(path, rows, {EVIL: EVIL}, evil_pictures, title=EVIL, versions={EVIL: EVIL}, command=EVIL)
    # table cells are shortened, so look for its beginning
    assert path.read_text(encoding="utf-8").count("<script") == 1
    assert page(path).text.count(EVIL) > 5


def test_report_is_the_same_each_time_and_works_bare(tmp_path: Path, pictures: dict[str, Path]) -> None:
    for name in ("a.html", "b.html"):
        report.report(tmp_path / name, ROWS, {"a": 1}, pictures, history=[(0, 1.0), (1, 0.5)])
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    report.report(tmp_path / "bare.html", [NET], {}, {})
    assert page(tmp_path / "bare.html").tags.count("h2") == 1


def test_headlines_compare_the_net_with_the_texture(tmp_path: Path) -> None:
    report.report(tmp_path / "report.html", ROWS, {}, {})
    text = page(tmp_path / "report.html").text
    assert "1/1675 of the texture's 117 MB" in text
    assert "56.1 dB" in text


def test_missing_picture_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(PrtnetError, match=r"absent\.png"):
        report.report(tmp_path / "report.html", ROWS, {}, {"x": tmp_path / "absent.png"})


def test_card_links_pictures_and_lists_facts_scores_and_files(tmp_path: Path, pictures: dict[str, Path]) -> None:
    path = tmp_path / "net" / "card.md"
    report.card(
        path, ROWS, {"triangles": 23_456, "scene": "a|b"}, pictures, title="plants", files={"net.glsl": "shader"}
    )
    text = path.read_text(encoding="utf-8")
    assert text.startswith("# plants\n")
    assert "![All views](<../pictures/sheet of views.png>)" in text
    assert (path.parent / "../pictures/sheet of views.png").exists()
    for line in ("| triangles | 23 456 |", r"| scene | a\|b |", "| `net.glsl` | shader |", "## Use", "## Limits"):
        assert line in text
    assert text.count("| noise floor |") == 1


def test_facts_are_readable() -> None:
    shown = [report.fact(value) for value in (1_234_567, 1.23456e-6, "x", None, True)]
    assert shown == ["1 234 567", "1.235e-06", "x", "-", "True"]
