"""Transfer on implicit surfaces: one table and one picture of finished sweeps.

    python experiments/implicit/report.py runs/implicit runs/implicit_spot runs/implicit_rabbit

writes experiments/implicit/results/{transfer.md, score.json, sheet.jpg, command.txt}.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from experiments.collect import commit
from prtnet import PrtnetError, score, store
from prtnet.chart import sheet, tables
from prtnet.score import Row

RESULTS = Path(__file__).parent / "results"
HEAD = ("surface", "material", "k", "PSNR", "worst", "SSIM", "frame", "MACs", "without shadows", "noise floor")
SHOWN = ("traced", "net", "8 x error", "unshadowed")  # columns of a contact sheet, from the left
FIRST_NET = "64"  # whose pictures are shown


def points(sweeps: list[Path]) -> Iterator[tuple[Path, list[Row]]]:
    """Folders of finished points and their rows, in the order of the sweeps."""
    for base in sweeps:
        found = sorted(file.parent for file in base.glob("*=*/**/score.json"))
        if not found:
            raise PrtnetError(f"{base}: found no point with a score.json, expected a finished sweep")
        yield from ((folder, score.read(folder / "score.json")[0]) for folder in found)


def width_of(folder: Path) -> str:
    """k of the point's network."""
    words = dict(word.split("=", 1) for part in folder.parts for word in part.split(",") if "=" in word)
    return words["model.width"]


def line(folder: Path, rows: list[Row]) -> tuple[str, ...]:
    """A row of the table."""
    of = {row.method: row for row in rows if row.reference == "traced"}
    net, bare, floor = of["net"], of["unshadowed"], of[score.NOISE_FLOOR]
    return (
        net.scene,
        net.material,
        width_of(folder),
        f"{net.psnr:.2f}",
        f"{net.psnr_worst:.2f}",
        f"{net.ssim:.4f}",
        f"{net.ms_ratio:.2f}x",
        tables.count(net.macs),
        f"{bare.psnr:.1f}",
        f"{floor.psnr:.1f}",
    )


def pictures(folders: list[Path], path: Path, side: int = 200) -> None:
    """The first view of each surface: `SHOWN` from left to right."""
    made = Image.new("RGB", (side * len(SHOWN), (side + 22) * len(folders) + 22), sheet.PAPER)
    draw, font = ImageDraw.Draw(made), ImageFont.load_default(13)
    for column, word in enumerate(SHOWN):
        draw.text((column * side + 6, 4), word, fill=sheet.INK, font=font)
    for row, folder in enumerate(folders):
        rows, _ = score.read(folder / "score.json")
        source = Image.open(folder / "contact_sheet.png").convert("RGB")
        views = min(rows[0].views or 1, sheet.MOST_VIEWS)
        layout = sheet.layout(views, 2, (256, 256))
        top = 22 + row * (side + 22)
        for column in range(len(SHOWN)):
            x, y = layout.corner(0, column)
            cell = source.crop((x, y, x + layout.width, y + layout.height)).resize((side, side))
            made.paste(cell, (column * side, top))
        psnr = next(each.psnr for each in rows if each.method == "net")
        draw.text((6, top + side + 3), f"{rows[0].scene}, {psnr:.1f} dB in all views", fill=sheet.FAINT, font=font)
    with store.atomic(path) as temporary:
        made.save(temporary, format="JPEG", quality=85)


def main(sweeps: list[Path], results: Path = RESULTS) -> None:
    found = list(points(sweeps))
    lines = sorted((line(folder, rows) for folder, rows in found), key=lambda each: (each[0], each[1], int(each[2])))
    text = [f"| {' | '.join(HEAD)} |", "| :-- | :-- " + "| --: " * (len(HEAD) - 2) + "|"]
    text += [f"| {' | '.join(tables.escape_markdown(word) for word in each)} |" for each in lines]
    store.write_text(results / "transfer.md", "\n".join(text) + "\n")
    kept = [replace(row, point=width_of(folder)) for folder, rows in found for row in rows]
    score.write(results / "score.json", kept, score.versions())
    shown = [folder for folder, rows in found if width_of(folder) == FIRST_NET and rows[0].material == "diffuse"]
    pictures(shown, results / "sheet.jpg")
    commands = [(base / "command.txt").read_text(encoding="utf-8") for base in sweeps]
    store.write_text(results / "command.txt", "".join(commands) + f"# collected at commit {commit()}\n")
    print("\n".join(text))


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main([Path(argument) for argument in sys.argv[1:]])
