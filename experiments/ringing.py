"""What windows do to ringing: the table of experiments/ringing.md, made again.

    python experiments/ringing.py [PROBE ...]

A light is taken as 64 x 128 directions with their flux, so that its irradiance can be summed without SH; the same
directions are traced from points of the `plants` scene for the shadowed case.
"""

import sys
from pathlib import Path

import numpy as np

from prtnet import sh
from prtnet.data import builtin, light, samples
from prtnet.data.light import Light
from prtnet.data.tracer import Tracer

PAGE = Path(__file__).with_name("ringing.md")
MARKS = ("<!-- table -->\n", "<!-- end -->\n")
BANDS, HEIGHT, POINTS = 5, 64, 600
WINDOWS = (("none", 5), ("lanczos", 10), ("hann", 10), ("lanczos", 5), ("hann", 5))
Array = np.ndarray


def flux(chosen: Light) -> tuple[Array, Array]:
    """Directions "n 3" and flux "n 3" (radiance times sr): texels of an image, averaged, or one direction."""
    if chosen.image is None:
        first = chosen.coefficients(2)
        towards = first[[3, 1, 2]].mean(axis=1)  # band 1 is (y, z, x)
        return (towards / np.linalg.norm(towards))[None], first[:1] * np.sqrt(4 * np.pi)
    height, width = chosen.image.shape[:2]
    fine = chosen.image * light.solid_angles(height, width)[:, None, None]
    rows, columns = np.arange(height) * HEIGHT // height, np.arange(width) * 2 * HEIGHT // width
    coarse = np.zeros((HEIGHT, 2 * HEIGHT, 3))
    np.add.at(coarse, (rows[:, None], columns[None]), fine)
    return light.directions(HEIGHT, 2 * HEIGHT).reshape(-1, 3), coarse.reshape(-1, 3)


def receivers(towards: Array) -> Array:
    """Clamped cosine times visibility in each direction, "points directions", in the plants."""
    scene = builtin.make("plants", tessellation=0.5).centred()
    points = samples.area_uniform(scene, POINTS, np.random.default_rng(0))
    tracer = Tracer(scene)
    starts = tracer.origins(points.positions, points.geometric_normals)
    cosine = np.clip(points.normals @ towards.T, 0, None) * (points.geometric_normals @ towards.T > 0)
    for index in range(POINTS):
        above = np.flatnonzero(cosine[index])
        aim = np.ascontiguousarray(towards[above], np.float32)
        cosine[index, above] *= ~tracer.trace(np.repeat(starts[index : index + 1], len(aim), axis=0), aim)
    return cosine


def share_negative(values: Array, weights: Array) -> float:
    return float(((values < 0).mean(axis=1) * weights).sum() / weights.sum())


def error(values: Array, exact: Array, weights: Array) -> float:
    """RMSE of what is shown, that is of values clipped at 0, over the root mean square of what should be."""
    off = (((np.maximum(values, 0) - exact) ** 2).mean(axis=1) * weights).sum()
    return float(np.sqrt(off / ((exact**2).mean(axis=1) * weights).sum()))


def measure(lights: list[Light]) -> list[str]:
    """The rows of the table."""
    grid = light.directions(HEIGHT, 2 * HEIGHT).reshape(-1, 3)
    angles = np.repeat(light.solid_angles(HEIGHT, 2 * HEIGHT), 2 * HEIGHT)
    single = [flux(chosen)[0] for chosen in lights if chosen.image is None]
    seen = receivers(np.concatenate([grid, *single]))
    shadowed = seen[:, : len(grid)] @ (angles[:, None] * sh.evaluate(grid, BANDS))
    open_points = shadowed[:, 0] > 0.05  # the others see next to nothing
    normals, weights = sh.quadrature(40)
    rows, alone = [], len(grid)
    for chosen in lights:
        towards, arriving = flux(chosen)
        columns = slice(0, len(grid)) if chosen.image is not None else slice(alone, alone + 1)
        alone += chosen.image is None
        exact = np.clip(normals @ towards.T, 0, None) @ arriving
        exact_shadowed = seen[open_points, columns] @ arriving
        plain = sh.evaluate(towards, BANDS).T @ arriving
        for window, size in WINDOWS:
            coefficients = plain * sh.window(window, size, BANDS)[sh.band_index(BANDS)][:, None]
            lit, level = sh.cosine_lobe(normals, BANDS) @ coefficients, np.ones(open_points.sum())
            under = shadowed[open_points] @ coefficients
            figures = [
                share_negative(sh.evaluate(normals, BANDS) @ coefficients, weights),
                share_negative(lit, weights),
                error(lit, exact, weights),
                share_negative(under, level),
                error(under, exact_shadowed, level),
            ]
            label = window if window == "none" else f"{window} {size}"
            rows.append(
                f"| {chosen.name} | {label} | " + " | ".join(f"{100 * figure:.1f} %" for figure in figures) + " |"
            )
    return rows


def main(probes: list[str]) -> None:
    lights = [light.by_name(name) for name in ("sky", "green", "directional")]
    lights += [light.from_file(path) for path in probes]
    head = [
        "| light | window | radiance < 0 | irradiance < 0 | its error | shadowed < 0 | its error |",
        "|---|---|---|---|---|---|---|",
    ]
    table = "".join(f"{line}\n" for line in head + measure(lights))
    print(table)
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(MARKS[0])
    PAGE.write_text(before + MARKS[0] + table + MARKS[1] + rest.partition(MARKS[1])[2], encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
