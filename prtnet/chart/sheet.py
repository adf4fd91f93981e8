"""The contact sheet: all views and methods with their error maps in one picture, to look at before any number."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib
import numpy as np
from jaxtyping import Bool, Float
from PIL import Image, ImageDraw, ImageFont

from prtnet import PrtnetError, score, store

Array = np.ndarray
Views = Sequence[Float[Array, "h w 3"]]

ERROR_GAIN = 8  # error maps show this many times the absolute difference of the tone-mapped images
MOST_VIEWS = 8
PAPER, INK, FAINT = (22, 24, 29), (236, 238, 242), (150, 156, 168)


@dataclass(frozen=True)
class Layout:
    """Where things lie on the sheet, in pixels."""

    rows: int
    columns: int
    width: int  # of a picture as it is shown
    height: int
    margin: int = 16
    gap: int = 6
    header: int = 64  # above the first row: the title and the names of the columns
    caption: int = 24  # below each picture

    @property
    def sheet(self) -> tuple[int, int]:
        """Width and height of the sheet."""
        wide = 2 * self.margin + self.columns * self.width + (self.columns - 1) * self.gap
        return wide, self.margin + self.header + self.rows * (self.height + self.caption)

    def corner(self, row: int, column: int) -> tuple[int, int]:
        """The top left corner (x, y) of a picture."""
        x = self.margin + column * (self.width + self.gap)
        return x, self.header + row * (self.height + self.caption)


def chosen(views: int, most: int = MOST_VIEWS) -> list[int]:
    """At most `most` of so many views, the first and the last among them, evenly spread."""
    if views <= most:
        return list(range(views))
    return [round(i * (views - 1) / max(most - 1, 1)) for i in range(most)]


def layout(views: int, methods: int, size: tuple[int, ...], cell: int = 256) -> Layout:
    """The layout of a sheet of `methods` beside the reference, for images of a size (height, width). Small images are
    shown at a whole multiple of their size, images wider than `cell` are shrunk to it."""
    height, width = size
    factor = cell // width if width <= cell else cell / width
    shown = max(round(width * factor), 1), max(round(height * factor), 1)
    return Layout(min(views, MOST_VIEWS), 1 + 2 * methods, *shown)


def error_map(image: Float[Array, "h w 3"], reference: Float[Array, "h w 3"]) -> Float[Array, "h w 3"]:
    """ERROR_GAIN times the absolute difference of two tone-mapped images, clipped to 1."""
    return np.clip(ERROR_GAIN * np.abs(image - reference), 0, 1)


def contact_sheet(
    path: Path,
    views: Mapping[str, Sequence[Float[Array, "h w 3"]]],
    *,
    reference: str = "traced",
    covered: Sequence[Bool[Array, "h w"]] | None = None,
    numbers: Sequence[int] | None = None,
    title: str = "",
    cell: int = 256,
) -> None:
    """Write a PNG: a row per view, the reference, then each method with its error map, PSNR under each.

    `views` holds tone-mapped sRGB images in [0, 1] by method; `views[reference]` is what the others are compared
    with. PSNR is of the covered pixels where masks are given. `numbers` are the views' own where these are a choice
    already. At most MOST_VIEWS views are shown, evenly chosen. An image with NaN was not drawn: its place is empty.
    """
    if reference not in views:
        raise PrtnetError(f"contact sheet: no images of {reference!r}, expected them among {', '.join(views)}")
    methods = [method for method in views if method != reference]
    if len({len(images) for images in views.values()}) > 1 or not views[reference]:
        counts = ", ".join(f"{method} {len(images)}" for method, images in views.items())
        raise PrtnetError(f"contact sheet: found {counts} views, expected as many of each and at least one")
    plan = layout(len(views[reference]), len(methods), views[reference][0].shape[:2], cell)
    sheet = Image.new("RGB", plan.sheet, PAPER)
    pen = ImageDraw.Draw(sheet)
    _head(pen, plan, title or "Views", [reference, *(each for method in methods for each in (method, None))])
    for row, view in enumerate(chosen(len(views[reference]))):
        wanted = views[reference][view]
        _cell(sheet, pen, plan, (row, 0), wanted, f"view {view if numbers is None else numbers[view]}")
        for index, method in enumerate(methods):
            image = views[method][view]
            if np.isnan(image).any():
                continue  # a reference that not every view has
            decibels = score.psnr(image, wanted, None if covered is None else covered[view])
            error = error_map(image, wanted)
            _cell(sheet, pen, plan, (row, 1 + 2 * index), image, f"{decibels:.1f} dB")
            _cell(sheet, pen, plan, (row, 2 + 2 * index), error, f"largest {np.abs(image - wanted).max():.2f}")
    with store.atomic(path) as temporary:
        sheet.save(temporary, format="PNG", optimize=True)


def grid(
    path: Path,
    images: Mapping[str, Sequence[Float[Array, "_ _ 3"] | None]],
    columns: Sequence[str],
    *,
    title: str,
    cell: int = 256,
) -> None:
    """Write a PNG or JPEG of tone-mapped sRGB images in [0, 1]: a row by each name, empty places for None."""
    first = next(image for row in images.values() for image in row if image is not None)
    plan = replace(layout(len(images), 0, first.shape[:2], cell), columns=len(columns))
    sheet = Image.new("RGB", plan.sheet, PAPER)
    pen = ImageDraw.Draw(sheet)
    _head(pen, plan, title, columns)
    for row, (name, found) in enumerate(images.items()):
        for column, image in enumerate(found):
            if image is not None:
                _cell(sheet, pen, plan, (row, column), image, name)
    with store.atomic(path) as temporary:
        sheet.save(temporary, format="JPEG" if path.suffix == ".jpg" else "PNG", optimize=True, quality=88)


def _font(height: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    name = f"DejaVuSans{'-Bold' if bold else ''}.ttf"
    return ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name, height)


def _head(pen: ImageDraw.ImageDraw, plan: Layout, title: str, names: Sequence[str | None]) -> None:
    """The title and over each column its name; None stands for the error map of the column before."""
    room = plan.sheet[0] - 2 * plan.margin
    _write(pen, (plan.margin, 12), title, room, _font(17, bold=True), INK)
    for column, name in enumerate(names):
        x, y = plan.corner(0, column)
        text, colour = (f"error ×{ERROR_GAIN}", FAINT) if name is None else (name.replace("_", " "), INK)
        _write(pen, (x, y - 23), text, plan.width, _font(14, bold=name is not None), colour)


def _cell(
    sheet: Image.Image, pen: ImageDraw.ImageDraw, plan: Layout, place: tuple[int, int], image: Array, caption: str
) -> None:
    x, y = plan.corner(*place)
    picture = Image.fromarray(np.round(255 * np.clip(image, 0, 1)).astype(np.uint8))
    enlarge = plan.width >= picture.width
    filter = Image.Resampling.NEAREST if enlarge else Image.Resampling.LANCZOS
    sheet.paste(picture.resize((plan.width, plan.height), filter), (x, y))
    _write(pen, (x, y + plan.height + 3), caption, plan.width, _font(13), FAINT)


def _write(
    pen: ImageDraw.ImageDraw,
    corner: tuple[int, int],
    text: str,
    room: int,
    font: ImageFont.FreeTypeFont,
    colour: tuple[int, int, int],
) -> None:
    """One line of text, cut to `room` pixels."""
    line = " ".join(text.split())
    while len(line) > 1 and font.getlength(line) > room:
        line = line.rstrip("…")[:-1] + "…"
    pen.text(corner, line, colour, font)
