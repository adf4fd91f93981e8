"""What the clusters of a scene are and why: clusters.md."""

from collections.abc import Mapping
from typing import Any

from prtnet import console
from prtnet.chart.tables import escape_markdown

_HEADINGS = ("cluster", "leaves", "points", "network", "parameters", "bytes", "steps", "CPU time", "RMSE")


def markdown(name: str, facts: Mapping[str, Any]) -> str:
    """A page on the clusters of one scene, of the facts of `pipeline.clusters`."""
    rows = [_row(index, each) for index, each in enumerate(facts["clusters"])]
    total = sum(each["bytes"] for each in facts["clusters"])
    lines = [f"# The clusters of {escape_markdown(name)}", ""]
    lines += ["| " + " | ".join(cells) + " |" for cells in (_HEADINGS, ("---",) * len(_HEADINGS), *rows)]
    lines += [
        "",
        f"Together {console.size(total)}, {console.duration(facts['cpu_seconds'])} of training; transfer RMSE of their"
        f" blend {facts['areas_rmse']:.4f} on held-out points, {facts['vertices_rmse']:.4f} on vertices.",
        "",
        "## Merges",
        "",
        *(f"1. {escape_markdown(each)}." for each in facts["merges"]),
        *([""] if facts["merges"] else []),
        f"The end: {facts['ended']}.",
    ]
    return "\n".join(lines) + "\n"


def _row(index: int, each: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        str(index),
        ", ".join(map(str, each["leaves"])),
        str(each["points"]),
        f"{each['width']} x {each['depth']}" if each["depth"] else "linear",
        str(each["parameters"]),
        console.size(each["bytes"]),
        str(each["steps"]),
        console.duration(each["cpu_seconds"]),
        "no points" if each["areas_rmse"] is None else f"{each['areas_rmse']:.4f}",
    )
