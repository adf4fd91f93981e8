"""What a person sees of a search for a size."""

import pytest

from prtnet import size
from prtnet.chart import size as chart
from prtnet.size import Candidate, Trial

CANDIDATES = [Candidate(f"{width} x 1 + 8x4x8", width, 1, "", 100 * width, 450 * width) for width in (8, 16, 32, 64)]


def found(target=None, **options):
    def trial(candidate, share):
        psnr = 30 + candidate.width / 4 - 2 / share**0.3
        return Trial(psnr, psnr - 1, 10 * share)

    return size.search(CANDIDATES, trial, target=target, **options)


def test_the_table_has_a_line_and_a_verdict_for_each_candidate():
    search = found(target=33.0)
    lines = chart.table(search, 33.0).splitlines()
    assert len(lines) == 2 + len(CANDIDATES)
    assert [line.split("  ")[0] for line in lines[2:]] == [each.name for each in CANDIDATES]
    assert "chosen" in lines[4]
    assert "in full" in lines[4]
    assert lines[2].endswith("expected to miss") or lines[2].endswith("misses")
    assert "costs more" in lines[5] or "meets the target" in lines[5]
    assert "3.2k" in lines[4]
    assert "14.4 kB" in lines[4]


@pytest.mark.parametrize(
    ("options", "words"), [({"max_macs": 10**6}, "left after 1/9"), ({"target": 60.0}, "expected to miss")]
)
def test_what_is_left_out_says_why(options, words):
    search = found(**options)
    assert words in {chart.verdict(search, each, options.get("target")) for each in search.candidates}


def test_markdown_has_as_many_cells_in_each_line():
    lines = chart.markdown(found(target=33.0), 33.0).splitlines()
    assert len(lines) == 2 + len(CANDIDATES)
    assert len({line.count("|") for line in lines}) == 1


@pytest.mark.parametrize("target", [33.0, 60.0, None])
@pytest.mark.parametrize("cost", ["macs", "bytes"])
def test_equal_searches_give_equal_pictures(target, cost, tmp_path):
    for name in ("a", "b"):
        search = found(target=target, max_macs=10**6, floor=70.0, cost=cost)
        chart.picture(tmp_path / name, search, target=target, floor=70.0, cost=cost)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert (tmp_path / "a").read_bytes()[:4] == b"\x89PNG"


def test_a_search_that_tried_nothing_has_a_picture_and_a_table(tmp_path):
    search = found(target=60.0, floor=50.0)
    chart.picture(tmp_path / "a", search, target=60.0, floor=50.0)
    assert (tmp_path / "a").stat().st_size > 0
    assert "-" in chart.table(search, 60.0).splitlines()[2]
