"""The picture of docs/deploying.md: axes, spherical harmonics, and how a light lies on its image.

    python experiments/conventions.py

A sphere under a red light from +x, a green one from +y and a blue one from +z, drawn by the exported function; written
to docs/images/conventions.png.
"""

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from prtnet import score, sh
from prtnet.chart import plot
from prtnet.data import light, shapes
from prtnet.data.atlas import Atlas
from prtnet.data.part import Part
from prtnet.data.scene import assemble
from prtnet.export import glsl
from prtnet.netspec import NetSpec
from prtnet.render.camera import Camera
from prtnet.render.method import NetMethod
from prtnet.render.raster import Raster

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "conventions.png"
BANDS, SHOWN_BANDS, SIZE = 5, 3, 420
CAMERA = Camera((1.9, 1.5, 3.2), (0.0, 0.0, 0.0), fov_y=42.0)
AXES = {"+x\nred": (1, 0, 0), "+y green, up": (0, 1, 0), "+z blue,\nthe SH pole": (0, 0, 1)}
COLOURS = ("#c03028", "#1f8a3b", "#2457c5")
FORMULAS = ("1", "y", "z", "x", "x y", "y z", "3 z$^2$ - 1", "x z", "x$^2$ - y$^2$")
Array = np.ndarray


def lobes() -> Array:
    """SH coefficients "k 3" of three lights, one for each colour, each from an axis of its own with irradiance 1."""
    return sh.evaluate(np.eye(3), BANDS).T.astype(np.float32)


def lit_sphere(size: int = SIZE) -> tuple[Array, Array]:
    """(Image "h w 3", what it covers "h w") of a white sphere: a net without layers but the last, which is 0, adds the
    transfer of an open point to nothing."""
    ball = shapes.ellipsoid(np.ones(3), 96)
    part = Part("sphere", ball.vertices, ball.faces, normals=ball.vertices, albedo=np.ones(3), two_sided=False)
    scene = assemble("sphere", [part], camera="orbit").centred()
    raster = Raster(Atlas(scene, np.zeros((len(scene.vertices), 2), np.float32), "none", math.nan), size)
    count = sh.count(BANDS)
    nothing = np.zeros((count, 6), np.float32), np.zeros(count, np.float32)
    net = NetSpec((nothing[0],), (nothing[1],), 0, 0, output="linear", residual=True, bands=BANDS)
    image = NetMethod(raster, glsl.emit(net)).draw(CAMERA, lobes())
    return image, raster.faces(CAMERA)[..., 0] > 0


def on_screen(points: Array, size: int = SIZE) -> Array:
    """Pixels, x to the right and y down, of points in unit coordinates."""
    clip = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ CAMERA.matrix().T
    return (clip[:, :2] / clip[:, 3:] * [1, -1] + 1) / 2 * size - 0.5


def _sphere(axes: Axes) -> None:
    image, covered = lit_sphere()
    shown = np.where(covered[..., None], score.srgb_encode(np.clip(image * math.pi, 0, 1)), 1)
    axes.imshow(shown, interpolation="bilinear")
    for (label, direction), colour in zip(AXES.items(), COLOURS, strict=True):
        tail, head = on_screen(np.array([np.multiply(direction, 1.0), np.multiply(direction, 1.4)], float))
        axes.annotate("", head, tail, arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 2.5})
        across, shift = {0: ("left", (6, 6)), 1: ("center", (0, -14)), 2: ("right", (0, 16))}[int(np.argmax(direction))]
        axes.text(*(head + shift), label, color=colour, weight="bold", ha=across, va="center", fontsize=11)


def _harmonics(figure: Figure) -> None:
    """Y_0 to Y_8 on the same sphere: orange above 0, blue below."""
    size = 130
    rays, eye = CAMERA.rays(size).reshape(-1, 3), np.array(CAMERA.eye)
    along = -rays @ eye
    inside = along**2 - eye @ eye + 1
    hit = inside > 0
    points = eye + (along - np.sqrt(np.maximum(inside, 0)))[:, None] * rays
    values = sh.evaluate(points, SHOWN_BANDS)
    for i, band in enumerate(sh.band_index(SHOWN_BANDS)):
        order = i - band * band - band
        axes = figure.add_axes((0.345 + 0.066 * (order + 2), 0.62 - 0.275 * band, 0.062, 0.2))
        strength = np.abs(values[:, i]) / np.abs(values[hit, i]).max()
        tint = np.where(values[:, i : i + 1] > 0, [[0.80, 0.36, 0.05]], [[0.05, 0.40, 0.72]])
        colour = np.where(hit[:, None], 1 - strength[:, None] * (1 - tint), 1)
        axes.imshow(colour.reshape(size, size, 3), interpolation="bilinear")
        axes.set_title(f"{i}:  {FORMULAS[i]}", fontsize=9, color=plot.INK, pad=2)
        axes.set_axis_off()
    words = "i = l$^2$ + l + m; orange above 0; no Condon-Shortley phase: $Y_1 = \\sqrt{3/4\\pi}\\,(y, z, x)$"
    figure.text(0.508, 0.035, words, ha="center", fontsize=9.5, color=plot.FAINT)


def _lat_long(axes: Axes) -> None:
    """The three lights as they lie on a light's image, a little wider than they are."""
    towards = light.directions(128, 256)
    image = np.clip(towards, 0, 1) ** 8
    axes.imshow(score.srgb_encode(0.06 + 0.94 * image), extent=(0, 1, 1, 0), aspect=0.5)
    for u, v, label in ((0.012, 0.5, "+z"), (0.25, 0.5, "-x"), (0.5, 0.5, "-z"), (0.75, 0.5, "+x"), (0.5, 0.08, "+y")):
        axes.text(
            u, v, label, color="white", ha="left" if u < 0.1 else "center", va="center", fontsize=12, weight="bold"
        )
    axes.annotate("", (0.06, 0.8), (0.4, 0.8), arrowprops={"arrowstyle": "-|>", "color": "white", "linewidth": 1.5})
    axes.text(0.23, 0.9, "light.rotation > 0", color="white", ha="center", va="center", fontsize=10)
    axes.set_xticks([0, 0.25, 0.5, 0.75, 1], ["0", "1/4", "1/2", "3/4", "u = 1"])
    axes.set_yticks([0, 0.5, 1], ["v = 0", "1/2", "1"])
    axes.tick_params(colors=plot.FAINT, labelsize=9)


def draw(path: Path) -> None:
    """Write the picture."""
    figure = plot.canvas(13.0, 4.2)
    axes = figure.add_axes((0.0, 0.0, 0.32, 0.88))
    _sphere(axes)
    axes.set_axis_off()
    axes.set_xlim(-75, SIZE + 65)
    axes.set_ylim(SIZE - 10, -15)
    _harmonics(figure)
    _lat_long(figure.add_axes((0.715, 0.14, 0.27, 0.68)))
    titles = "The world: right-handed, y up", "Spherical harmonics on it", "A light's image: centre -z, first row +y"
    for x, title in zip((0.16, 0.508, 0.85), titles, strict=True):
        figure.text(x, 0.92, title, ha="center", fontsize=12, color=plot.INK)
    plot.save(figure, path)


if __name__ == "__main__":
    draw(PICTURE)
