"""The end of a run of data-driven transfer by itself: score.json, the table, pictures, card.md and report.html."""

import logging
from typing import Any

import numpy as np
from jaxtyping import Float

from prtnet import data_driven, score, store
from prtnet.chart import report as pages
from prtnet.chart import sheet, tables
from prtnet.pipeline.data_driven.learn import Operator
from prtnet.pipeline.data_driven.score import METHOD, REFERENCE, Scored
from prtnet.pipeline.job import Job

log = logging.getLogger(__name__)
Array = np.ndarray

SHOWN_ELEMENTS = 16
FILES = {
    "data_driven.safetensors": "basis, matrices and measurement points, for prtnet.data_driven.load",
    "reduce.frag": "a shader that multiplies the direct light by the matrix",
    "indirect.glsl": "the function prt_indirect, which blends the basis textures, to paste into a shader",
    "indirect.frag": "the same as a whole shader that writes a lightmap",
    "indirect_basis.exr": "the basis textures, one channel per element",
    "data_driven.html": "the scene with a light to move, one file that opens without a network",
    "curves.json": "errors against elements, points, lambda and size of the database",
    "contact_sheet.png": "views under unseen lights, methods and errors",
    "basis.png": "the elements of the basis over the atlas",
    "certificate.json": "measured errors and times of the shaders, and checksums",
    "score.json": "the scores below, for programs",
    "config.yaml": "every key of this run",
}
USAGE = """Per frame: shade the measurement points as the scene is shaded, multiply by the matrix (`reduce.frag`), and
blend the basis textures at each pixel (`prt_indirect(uv)`): albedo / pi times it joins what is lit directly. In Python:
`spec = prtnet.data_driven.load(file)`, then `prtnet.data_driven.indirect(spec, direct)`."""
LIMITS = (
    "Lights like those it learned from: another scenario's are extrapolated, see experiments/data_driven.",
    "What does not light a measurement point lights nothing: more points, or other places for them.",
    "The scene stands in the poses of its keyframes.",
    "Indirect light is diffuse (or of the medium or the hair that was rendered), blurred by the lightmap's texels.",
)


def report(job: Job, made: Operator, scored: Scored) -> None:
    """Write what is missing of the run folder's pages, and print the table."""
    out, page = job.out, job.out / "report.html"
    stamp = out / ".report.key"
    written = [page, *(out / name for name in ("score.json", "card.md", "contact_sheet.png", "basis.png"))]
    if not (stamp.exists() and stamp.read_text() == scored.key and all(path.exists() for path in written)):
        _write(job, made, scored)
        store.write_text(stamp, scored.key)
    print(tables.table(scored.rows))
    unseen = made.facts["unseen"]
    print(
        f"\nUnseen lights: RMSE {unseen['rmse']:.4g} of lightmaps of {unseen['level']:.4g}, "
        f"{unseen['ratio']:.2f} times that of the projection onto the basis"
    )
    print(f"\n{page}")


def _write(job: Job, made: Operator, scored: Scored) -> None:
    out, rows = job.out, scored.rows
    versions, facts = score.versions(), _facts(job, made, scored)
    numbers = {key: made.facts[key] for key in ("training", "unseen", "noise", "level", "training_seconds")}
    score.write(out / "score.json", rows, versions, data_driven=numbers)
    options = job.config.data_driven
    title = f"{job.scene.name}: light between surfaces in {options.elements} textures"
    frames = {name: list(images) for name, images in scored.frames.items() if name != "covered"}
    covered = list(scored.frames["covered"])
    sheet.contact_sheet(out / "contact_sheet.png", frames, reference=REFERENCE, covered=covered, title=title)
    few = min(made.spec.elements, SHOWN_ELEMENTS)
    shown = {f"from {first + 1} on": elements(made, range(first, min(first + 4, few))) for first in range(0, few, 4)}
    sheet.grid(out / "basis.png", shown, ["", "", "", ""], title="The mean of the lightmaps, and what varies about it")
    pictures = {
        "Views under unseen lights, methods and 8 x their errors": out / "contact_sheet.png",
        "Elements of the basis over the atlas, orange above 0 and blue below": out / "basis.png",
    }
    files = {name: what for name, what in FILES.items() if (out / name).exists() or name == "score.json"}
    pages.card(out / "card.md", rows, facts, pictures, title=title, files=files, usage=USAGE, limits=LIMITS)
    pages.report(
        out / "report.html", rows, facts, pictures, title=title, history=[], versions=versions, command=job.command
    )


def elements(made: Operator, which: range) -> list[Float[Array, "s s 3"] | None]:
    """Elements of the first bank as pictures, four to a row, the last ones empty."""
    found: list[Array | None] = []
    for number in which:
        values = made.spec.basis[0, number]
        image = data_driven.image(made.spec, values[:, None])[..., 0]
        image = image / max(float(np.quantile(np.abs(values), 0.99)), 1e-30)
        warm, cold = np.clip(image, 0, 1)[..., None], np.clip(-image, 0, 1)[..., None]
        found.append(np.sqrt(warm) * [1.0, 0.6, 0.2] + np.sqrt(cold) * [0.2, 0.55, 1.0])
    return found + [None] * (4 - len(found))


def _facts(job: Job, made: Operator, scored: Scored) -> dict[str, Any]:
    options, facts = job.config.data_driven, made.facts
    unseen, training = facts["unseen"], facts["training"]
    frames = len(made.ground.keyframes)
    return {
        "scene": job.scene.name,
        "triangles": len(job.scene.faces),
        "scenario": ", ".join(options.scenario),
        "lit by": ", ".join(options.lit_by or options.scenario),
        "configurations learned from": options.configurations * frames,
        "keyframes": f"{frames}, matrices: {options.matrices}" if frames > 1 else 1,
        "unseen configurations": options.unseen * frames,
        "measurement points": f"{options.points} x {options.supersampling} on the {options.place}",
        "elements": f"{options.elements}, {options.channels}",
        "lambda": options.ridge,
        "space": "linear" if options.gamma == 1 else f"gamma {options.gamma:g}",
        "lightmaps": f"{options.size}^2 texels, {len(made.ground.texels.index)} in use",
        "renderer": f"{options.renderer}, {options.bounces} bounces, {options.directions} rays",
        "noise of a texel, standard error": f"{facts['noise'] / max(facts['level'], 1e-30):.2%} of their RMS",
        "seconds of the database": facts["training_seconds"],
        "CPU-seconds of basis and operator": facts["cpu_seconds"],
        "lights in a colour that measurement points miss": facts["dark"],
        "RMSE on the lights learned from": training["rmse"],
        "RMSE on unseen lights": unseen["rmse"],
        "of the projection onto the basis": unseen["projection"],
        "their ratio": unseen["ratio"],
        "RMS of the lightmaps": unseen["level"],
        "exposure": scored.facts["exposure"],
        f"cost of {METHOD}": f"{_ratio(scored):.2f} x the direct shading's time",
        "paths per pixel of the reference": options.samples,
        "centre and scale": f"{job.frame.centre.tolist()}, {job.frame.scale:.9g}",
    }


def _ratio(scored: Scored) -> float:
    return next((row.ms_ratio or 0.0) for row in scored.rows if row.method == METHOD)
