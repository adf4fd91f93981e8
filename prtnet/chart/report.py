"""The pages of a run: card.md beside the exported net, and report.html, one file that opens without a network."""

import base64
import os
from collections.abc import Mapping, Sequence
from html import escape
from io import BytesIO
from pathlib import Path

from prtnet import PrtnetError, store
from prtnet.chart import plot, tables
from prtnet.score import Row

Facts = Mapping[str, str | int | float | None]

STYLE = """
:root { color-scheme: light dark; --paper: #fbfbfc; --sheet: #fff; --ink: #1c2026; --faint: #616977; --line: #e1e4ea;
  --accent: #0b6fb8; }
@media (prefers-color-scheme: dark) { :root { --paper: #14161a; --sheet: #1c1f25; --ink: #e6e8ec; --faint: #9aa2b0;
  --line: #30353e; --accent: #6bb6ee; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink); font: 16px/1.55 system-ui, sans-serif; }
main { max-width: 76rem; margin: 0 auto; padding: 2.5rem 1.25rem 4rem; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .3rem; overflow-wrap: anywhere; }
h2 { font-size: 1.2rem; margin: 2.8rem 0 .8rem; }
h3 { font-size: 1rem; font-weight: 600; margin: 1.4rem 0 .5rem; }
p, figcaption { color: var(--faint); margin: .5rem 0; max-width: 60rem; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(11rem, 1fr)); gap: .8rem; margin-top: 1.6rem; }
.tile { background: var(--sheet); border: 1px solid var(--line); border-radius: 8px; padding: .8rem 1rem; }
.tile b { display: block; font-size: 1.6rem; line-height: 1.25; font-weight: 600; font-variant-numeric: tabular-nums; }
.tile span { color: var(--faint); font-size: .85rem; display: block; overflow-wrap: anywhere; }
.wide { overflow-x: auto; border: 1px solid var(--line); border-radius: 8px; background: var(--sheet); }
table { border-collapse: collapse; width: 100%; font-size: .88rem; font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .42rem .7rem; border-bottom: 1px solid var(--line); white-space: nowrap; }
tr:last-child td { border-bottom: 0; }
th { color: var(--faint); font-weight: 500; }
th.name, td.name { text-align: left; }
td.best { color: var(--accent); font-weight: 700; }
tr.floor td { color: var(--faint); font-style: italic; }
table.facts { width: auto; min-width: 50%; }
table.facts td { text-align: left; white-space: normal; overflow-wrap: anywhere; }
table.facts td:first-child { color: var(--faint); width: 15rem; }
figure { margin: 1.2rem 0 0; }
figure button { display: block; padding: 0; border: 1px solid var(--line); border-radius: 8px; overflow: hidden;
  background: #fff; cursor: zoom-in; width: 100%; }
figure img { display: block; width: 100%; height: auto; }
dialog { padding: 0; border: 0; max-width: 98vw; max-height: 98vh; overflow: auto; background: #16181d;
  cursor: zoom-out; }
dialog::backdrop { background: #000c; }
dialog img { display: block; }
pre { background: var(--sheet); border: 1px solid var(--line); border-radius: 8px; padding: .8rem 1rem; margin: 0;
  overflow-x: auto; white-space: pre-wrap; overflow-wrap: anywhere; font-size: .88rem; }
"""
SCRIPT = """
const box = document.querySelector("dialog"), large = box.querySelector("img");
for (const button of document.querySelectorAll("figure button")) button.onclick = () => {
  large.src = button.firstElementChild.src; large.alt = button.firstElementChild.alt; box.showModal(); };
box.onclick = () => box.close();
"""
# nothing may be fetched, whatever stands in the page
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"

USAGE = """Paste the function into a fragment shader and call `prt_transfer(position, normal, t0, t1, ...)`.
`position` is the *centred* position, `(p - centre) * scale`, subtracted in float64 on the CPU before the upload;
`normal` is the unit shading normal, turned to the viewer on two-sided surfaces; the `vec4`s `t0, t1, ...` are the SH
coefficients of the transfer in order, the last one padded with 0. Diffuse shading is `albedo / pi * dot(t, light)` for
each colour channel, with the light's SH coefficients in the same order, then exposure and sRGB."""
LIMITS = (
    "The scene stands still: the net knows the occlusion of this geometry only.",
    "The light is distant and low in frequency: SH of these few bands blur hard shadows, and may ring below zero.",
    "Diffuse transfer of direct light; light between surfaces is not in it.",
    "Off the surfaces it was trained on the net's answer has no meaning.",
)


def fact(value: str | int | float | None) -> str:
    """A fact as it is shown: thin groups of thousands, four digits of a fraction."""
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    return f"{value:,}".replace(",", " ") if isinstance(value, int) and not isinstance(value, bool) else str(value)


def card(
    path: Path,
    rows: Sequence[Row],
    facts: Facts,
    pictures: Mapping[str, Path],
    *,
    title: str = "Transfer network",
    files: Mapping[str, str] | None = None,
    usage: str = USAGE,
    limits: Sequence[str] = LIMITS,
) -> None:
    """Write a page in Markdown on a net: its facts, scores, pictures (by caption), files (name to what it is), use and
    limits. Pictures are linked relative to the page."""
    plain = tables.escape_markdown
    parts = [f"# {plain(title)}", "## Facts", _markdown_table({plain(k): plain(fact(v)) for k, v in facts.items()})]
    parts += ["## Scores", tables.markdown(rows).strip()]
    for caption, picture in pictures.items():
        link = Path(os.path.relpath(picture.absolute(), path.parent.absolute())).as_posix()
        parts.append(f"![{plain(caption)}](<{link}>)")
    if files:
        parts += ["## Files", _markdown_table({f"`{name}`": plain(what) for name, what in files.items()})]
    parts += ["## Use", usage, "## Limits", "\n".join(f"- {limit}" for limit in limits)]
    store.write_text(path, "\n\n".join(parts) + "\n")


def _markdown_table(lines: Mapping[str, str]) -> str:
    return "\n".join(["| | |", "| :-- | :-- |", *(f"| {name} | {value} |" for name, value in lines.items())])


def report(
    path: Path,
    rows: Sequence[Row],
    facts: Facts,
    pictures: Mapping[str, Path],
    *,
    title: str = "prtnet report",
    history: Sequence[tuple[int, float]] = (),
    versions: Mapping[str, str | None] | None = None,
    command: str = "",
) -> None:
    """Write one HTML file with everything in it: headline figures, table, pictures (PNG files by caption), the training
    curve of `history` (step, loss), facts, versions and the command that makes it again. All text is escaped."""
    figures = [_figure(caption, _read(picture)) for caption, picture in pictures.items()]
    sections = [
        _tiles(rows),
        _section("Scores", *(_score_table(grid) for grid in tables.grids(rows)), f"<p>{escape(tables.LEGEND)}</p>"),
        _section("Pictures", *figures),
    ]
    if history:
        curve = BytesIO()
        plot.training_curve(curve, history)
        sections.append(_section("Training", _figure(f"Loss over {history[-1][0]} steps", curve.getvalue())))
    sections.append(_section("Facts", *([_fact_table(facts)] if facts else [])))
    sections.append(_section("Versions", *([_fact_table(versions)] if versions else [])))
    sections.append(_section("Run it again", *([f"<pre>{escape(command)}</pre>"] if command else [])))
    store.write_text(path, _page(title, rows, "\n".join(section for section in sections if section)))


def _page(title: str, rows: Sequence[Row], body: str) -> str:
    groups = ", ".join(dict.fromkeys(" · ".join(tables.group_of(row)) for row in tables.ordered(rows)))
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<title>{escape(title)}</title>
<style>{STYLE}</style>
</head>
<body>
<main>
<h1>{escape(title)}</h1>
<p>{escape(groups)}</p>
{body}
</main>
<dialog aria-label="Picture, enlarged"><img alt=""></dialog>
<script>{SCRIPT}</script>
</body>
</html>
"""


def _section(heading: str, *parts: str) -> str:
    return f"<section>\n<h2>{escape(heading)}</h2>\n{chr(10).join(parts)}\n</section>" if parts else ""


def _read(picture: Path) -> bytes:
    try:
        return picture.read_bytes()
    except OSError as error:
        raise PrtnetError(f"{picture}: picture not readable ({error.strerror}), expected a PNG file") from None


def _figure(caption: str, png: bytes) -> str:
    source = base64.b64encode(png).decode()
    image = f'<img alt="{escape(caption)}" src="data:image/png;base64,{source}">'
    button = f'<button type="button" title="Enlarge">{image}</button>'
    return f"<figure>{button}<figcaption>{escape(caption)}</figcaption></figure>"


def _score_table(grid: tables.Grid) -> str:
    names = [title in ("method", "against") for title in grid.titles]
    head = "".join(f"<th{' class=name' * name}>{escape(t)}</th>" for t, name in zip(grid.titles, names, strict=True))
    lines = [f"<tr>{head}</tr>"]
    for row, line in zip(grid.rows, grid.lines, strict=True):
        classes = ["name" if name else "best" if cell.best else "" for cell, name in zip(line, names, strict=True)]
        cells = "".join(f'<td class="{c}">{escape(cell.text)}</td>' for cell, c in zip(line, classes, strict=True))
        lines.append(f"<tr{' class=floor' * row.is_noise_floor}>{cells}</tr>")
    return f"<h3>{escape(grid.heading)}</h3>\n<div class=wide><table>\n{chr(10).join(lines)}\n</table></div>"


def _fact_table(facts: Facts) -> str:
    lines = "\n".join(f"<tr><td>{escape(k)}</td><td>{escape(fact(v))}</td></tr>" for k, v in facts.items())
    return f"<div class=wide><table class=facts>\n{lines}\n</table></div>"


def _tiles(rows: Sequence[Row]) -> str:
    """The headline figures: those of the one scene, or each scene's best method when there are several."""
    groups: dict[tables.Group, list[Row]] = {}
    for row in tables.ordered(rows):
        if row.reference == "traced" and row.psnr is not None:
            groups.setdefault(tables.group_of(row), []).append(row)
    make = _headlines if len(groups) == 1 else _summary
    tiles = [tile for members in groups.values() for tile in make(members)]
    cells = "".join(f"<div class=tile><b>{escape(value)}</b><span>{escape(name)}</span></div>" for value, name in tiles)
    return f'<div class="tiles">{cells}</div>' if tiles else ""


def _headlines(rows: Sequence[Row]) -> list[tuple[str, str]]:
    tiles = [(_decibels(row), _against(row)) for row in rows]
    net = next((row for row in rows if row.method.startswith("net")), None)
    texture = next((row for row in rows if row.method == "texture"), None)
    if net and net.bytes and texture and texture.bytes:
        share = f"1/{texture.bytes / net.bytes:.0f} of the texture's {tables.size(texture.bytes)}"
        tiles.append((tables.size(net.bytes), f"size of {tables.method_name(net)}, {share}"))
    if net and net.ms_ratio:
        over = "the texture's" if texture else "what has no shadows"
        tiles.append((tables.ratio(net.ms_ratio), f"time of {tables.method_name(net)}, over {over}"))
    return tiles


def _summary(rows: Sequence[Row]) -> list[tuple[str, str]]:
    best = max(rows, key=lambda row: (not row.is_noise_floor, row.psnr or 0.0))
    return [(_decibels(best), f"{best.scene}: best, {_against(best)}")]


def _decibels(row: Row) -> str:
    return f"{row.psnr:.1f} dB"


def _against(row: Row) -> str:
    return "noise floor" if row.is_noise_floor else f"{tables.method_name(row)} against {row.reference}"
