"""What gloss loses by a transfer vector cut at b bands: the triple product beside the transfer matrix.

    python experiments/gloss_loss.py

writes results/gloss_loss/loss.csv and chart.png and the table of gloss_loss.md.
"""

import csv
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from prtnet import sh
from prtnet.data import builtin, light, matrix, transfer, vertex
from prtnet.data.tracer import Tracer
from prtnet.render import material

PAGE = Path(__file__).with_name("gloss_loss.md")
RESULTS = PAGE.parent / "results" / "gloss_loss"
MARKS = ("<!-- table -->\n", "<!-- end -->\n")
SCENES = {"tea_set": 0.35, "plants": 0.35}  # and their tessellation
KINDS = ("unshadowed", "shadowed")
BANDS, EXPONENTS = (2, 3, 4, 5, 6), (1, 4, 16, 64, 256)
TICKS = (0.2, 0.5, 1, 2, 5, 10)
DIRECTIONS, EYES, VERTICES = 2048, 16, 1500
Array = np.ndarray
Key = tuple[str, str, str, int, int]  # scene, kind, light, bands, exponent


def studio() -> Array:
    """A dark room with two lamps, 32 x 64, as probes of studios are: most of the light from 2 % of the sphere."""
    towards = light.directions(32, 64)
    image = np.full((32, 64, 3), 0.05, np.float32)
    lamps = ((0.6, 0.7, 0.4), 12, (40.0, 36.0, 30.0)), ((-0.8, 0.3, -0.5), 10, (14.0, 18.0, 30.0))
    for aim, degrees, colour in lamps:
        centre = np.array(aim) / np.linalg.norm(aim)
        image[towards @ centre > np.cos(np.radians(degrees))] = colour
    return image


def lights(bands: int) -> dict[str, Array]:
    return {"sky": light.project(light.sky(), bands), "studio": light.project(studio(), bands)}


def points(name: str) -> tuple[Array, dict[str, Array]]:
    """(normals, transfer of 2 * 6 - 1 bands by kind) of vertices that something of the sky reaches."""
    scene = builtin.make(name, tessellation=SCENES[name]).centred()
    mesh = vertex.mesh(scene)
    found, most = vertex.points(mesh), 2 * max(BANDS) - 1
    few = np.sort(np.random.default_rng(0).permutation(len(found.normals))[:VERTICES])
    baked = transfer.bake(
        Tracer(scene), found.positions[few], found.normals[few], geometric_normals=found.geometric_normals[few],
        bands=most, directions=DIRECTIONS, rng=np.random.default_rng(1),
    )  # fmt: skip
    seeing = baked[:, 0] > 0.05  # the others see next to nothing
    normals = found.normals[few][seeing].astype(np.float64)
    return normals, {"unshadowed": sh.cosine_lobe(normals, most), "shadowed": baked[seeing].astype(np.float64)}


def mirrored(normals: Array) -> Array:
    """Directions "eyes points 3" above each normal, uniform in solid angle: what eyes all around see in the mirror."""
    towards = np.random.default_rng(2).normal(size=(EYES, len(normals), 3))
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    return towards * np.sign(np.einsum("epc,pc->ep", towards, normals))[..., None]


def loss(cut: Array, whole: Array) -> float:
    """RMSE of the triple product over the root mean square of what the matrix gives."""
    return float(np.sqrt(np.mean((cut - whole) ** 2) / np.mean(whole**2)))


def measure() -> dict[Key, float]:
    found: dict[Key, float] = {}
    for name in SCENES:
        normals, kinds = points(name)
        seen = mirrored(normals)
        print(f"{name}: {len(normals)} vertices, {EYES} eyes each")
        for kind, bands in product(KINDS, BANDS):
            whole = matrix.from_transfer(kinds[kind], bands)
            vector = kinds[kind][:, : bands**2]
            basis = sh.evaluate(seen, bands)
            for lamp, coefficients in lights(bands).items():
                arriving = matrix.transferred(whole, coefficients)
                cut = np.stack([vector @ m for m in material.fixed_light_matrix(coefficients, bands)], axis=-1)
                for exponent in EXPONENTS:
                    facing = basis * sh.phong_lobe(float(exponent), bands)[sh.band_index(bands)]
                    pair = (np.einsum("epk,pkc->epc", facing, each) for each in (cut, arriving))
                    found[name, kind, lamp, bands, exponent] = loss(*pair)
    return found


def chart(found: dict[Key, float]) -> None:
    """One panel for each light and kind of transfer, a line for each exponent; scenes by the stroke."""
    figure = Figure(figsize=(10, 6.5), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    shades = ("#9ecae1", "#6baed6", "#3182bd", "#08519c", "#031d44")
    for (row, lamp), (column, kind) in product(enumerate(lights(2)), enumerate(KINDS)):
        panel = axes[row, column]
        strokes = zip(SCENES, "-:", strict=True)
        for (name, stroke), (exponent, shade) in product(strokes, zip(EXPONENTS, shades, strict=True)):
            values = [100 * found[name, kind, lamp, bands, exponent] for bands in BANDS]
            panel.plot(BANDS, values, stroke, color=shade, marker="o", markersize=3.5, label=f"{name}, e = {exponent}")
        panel.set_title(f"{kind}, {lamp}", fontsize=10)
        panel.set(yscale="log", xticks=BANDS)
        panel.set_yticks(TICKS, [f"{tick:g}" for tick in TICKS])
        panel.minorticks_off()
        panel.grid(alpha=0.3)
        panel.set_xlabel("SH bands" * row)
        panel.set_ylabel("loss, %" * (not column))
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside right center", fontsize=8, frameon=False)
    figure.suptitle("What the triple product of a cut transfer vector loses against the transfer matrix", fontsize=11)
    figure.savefig(RESULTS / "chart.png", metadata={"Software": None})


def table(found: dict[Key, float]) -> str:
    lines = ["| scene | transfer | light | bands | " + " | ".join(f"e = {e}" for e in EXPONENTS) + " |"]
    lines.append("|---" * (4 + len(EXPONENTS)) + "|")
    for name, kind, lamp, bands in product(SCENES, KINDS, lights(1), BANDS):
        figures = " | ".join(f"{100 * found[name, kind, lamp, bands, e]:.2g} %" for e in EXPONENTS)
        lines.append(f"| {name} | {kind} | {lamp} | {bands} | {figures} |")
    return "".join(f"{line}\n" for line in lines)


def main() -> None:
    found = measure()
    RESULTS.mkdir(parents=True, exist_ok=True)
    with (RESULTS / "loss.csv").open("w", newline="") as file:
        file.write("# python experiments/gloss_loss.py\n")
        writer = csv.writer(file)
        writer.writerow(["scene", "transfer", "light", "bands", "exponent", "loss"])
        writer.writerows([*key, f"{value:.5f}"] for key, value in found.items())
    chart(found)
    text = table(found)
    print(text)
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(MARKS[0])
    PAGE.write_text(before + MARKS[0] + text + MARKS[1] + rest.partition(MARKS[1])[2], encoding="utf-8")


if __name__ == "__main__":
    main()
