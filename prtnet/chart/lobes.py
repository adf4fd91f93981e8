"""Transfer of single points as a function on the sphere: T(w) = sum_i t_i Y_i(w), of the truth and of a net.

The whole sphere lies on a disc, in Lambert's azimuthal equal-area projection about the normal: the normal in the
middle, the horizon on the dashed circle, the direction into the surface all along the rim, world +y upwards.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.image import AxesImage

from prtnet import PrtnetError, sh
from prtnet.chart.plot import FAINT, INK, canvas, plain, save

Array = np.ndarray

GAIN = 8  # differences are shown so many times larger, in the same colours
PLACES = {"best": 0.0, "median": 0.5, "90 %": 0.9, "worst": 1.0}  # of the points shown, by growing error
PIXELS = 160  # across a disc


def evaluate(transfer: Float[Array, "n k"], directions: Float[Array, "*m 3"]) -> Float[Array, "n *m"]:
    """T(w) of each point at unit world directions w."""
    values = sh.evaluate(directions, sh.bands_of(transfer.shape[1]))
    return np.moveaxis(values @ np.asarray(transfer, np.float64).T, -1, 0)


def rmse(predicted: Float[Array, "n k"], truth: Float[Array, "n k"]) -> Float[Array, " n"]:
    """Root mean square error of each point's coefficients."""
    return np.sqrt(np.mean(np.square(np.asarray(predicted, np.float64) - truth), axis=1))


def chosen(errors: Float[Array, " n"]) -> dict[str, int]:
    """The points to show, by PLACES: where each stands in the order of errors."""
    order = np.argsort(errors, kind="stable")
    return {name: int(order[round(share * (len(order) - 1))]) for name, share in PLACES.items()}


def disc(normal: Float[Array, " 3"], pixels: int) -> tuple[Float[Array, "p p 3"], Bool[Array, "p p"]]:
    """Unit world directions of the pixels of a disc about a unit normal, row 0 on top, and which pixels lie on it."""
    side = (2 * np.arange(pixels) + 1) / pixels - 1
    x, y = np.meshgrid(side, -side)
    squared = x * x + y * y
    inside = squared <= 1
    # Lambert: a radius r shows the angle whose cosine is 1 - 2 r^2
    cosine = 1 - 2 * np.minimum(squared, 1)
    stretch = 2 * np.sqrt(np.maximum(1 - squared, 0))
    normal = np.asarray(normal, np.float64)
    up = np.array([0.0, 1.0, 0.0]) if abs(normal[1]) < 0.99 else np.array([0.0, 0.0, -1.0])
    up = up - (up @ normal) * normal
    up /= np.linalg.norm(up)
    right = np.cross(up, normal)
    local = np.stack([x * stretch, y * stretch, cosine], axis=-1)
    return local @ np.stack([right, up, normal]), inside


def picture(
    path: Path,
    predicted: Float[Array, "n k"],
    truth: Float[Array, "n k"],
    normals: Float[Array, "n 3"],
    *,
    names: Sequence[str],
    title: str = "",
) -> None:
    """Write a PNG: a line for each point, named, with truth, net and GAIN times their difference in one colour scale,
    and the RMSE of its coefficients."""
    if not len(predicted) == len(truth) == len(normals) == len(names) > 0:
        counts = f"{len(predicted)} predictions, {len(truth)} truths, {len(normals)} normals and {len(names)} names"
        raise PrtnetError(f"lobes: found {counts}, expected as many of each and at least one")
    errors = rmse(predicted, truth)
    rows = [_discs(*each) for each in zip(predicted, truth, normals, strict=True)]
    reach = max(float(np.nanmax(np.abs(disc))) for discs in rows for disc in discs[:2]) or 1.0
    figure = canvas(7.4, 0.75 + 2.05 * len(rows))
    height = figure.get_figheight()
    figure.suptitle(plain(title), x=0.03, y=1 - 0.12 / height, ha="left", color=INK, weight="bold", size=12)
    shown = None
    for line, (discs, name, error) in enumerate(zip(rows, names, errors, strict=True)):
        low = (height - 0.75 - 2.05 * (line + 1) + 0.1) / height
        words = f"{plain(name)}\nRMSE {error:.4f}"
        figure.text(0.03, low + 0.95 / height, words, color=INK, size=10, va="center", linespacing=1.6)
        for column, (values, head) in enumerate(zip(discs, ("truth", "net", f"difference × {GAIN}"), strict=True)):
            axes = figure.add_axes((0.2 + 0.235 * column, low, 0.225, 1.95 / height))
            shown = _draw(axes, values, reach)
            axes.set_title(head if line == 0 else "", color=INK, size=10, pad=2)
    assert shown is not None
    bar = figure.colorbar(shown, cax=figure.add_axes((0.925, 0.25, 0.015, 0.5)))
    bar.ax.tick_params(labelsize=8, colors=FAINT)
    save(figure, path)


def _discs(
    predicted: Float[Array, " k"], truth: Float[Array, " k"], normal: Float[Array, " 3"]
) -> tuple[Float[Array, "p p"], ...]:
    """Truth, prediction and GAIN times their difference on the disc about the normal, NaN outside of it."""
    directions, inside = disc(normal, PIXELS)
    lobes = evaluate(np.stack([truth, predicted, GAIN * (predicted - truth)]), directions)
    return tuple(np.where(inside, lobe, np.nan) for lobe in lobes)


def _draw(axes: Axes, values: Float[Array, "p p"], reach: float) -> AxesImage:
    """A disc with its rim and the horizon."""
    axes.set(xlim=(-1.06, 1.06), ylim=(-1.06, 1.06), aspect="equal")
    axes.set_axis_off()
    turn = np.linspace(0, 2 * np.pi, 181)
    for radius, style in ((1.0, "-"), (0.5**0.5, (0, (4, 3)))):
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), color=FAINT, linewidth=0.8, linestyle=style)
    return axes.imshow(values, cmap="RdBu_r", vmin=-reach, vmax=reach, extent=(-1, 1, -1, 1))
