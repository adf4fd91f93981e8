"""Where vertices, textures and nets fail, on purpose: one difficulty at a time, made worse step by step.

    python experiments/stability/run.py                  # all cases, the table, the chart and the sheet
    python experiments/stability/run.py contact holes    # some of them; the rows of the others stay
    python experiments/stability/run.py --list

Each value of a case is baked, trained and drawn by the pipeline and held against traced pixels. What was baked and
trained is kept below --out, so a killed study goes on where it was. Nets are trained for a fixed number of steps and
evaluated in NumPy, so that neither the load of the machine nor its compiler of shaders plays a part.
"""

import argparse
import csv
import logging
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from omegaconf import OmegaConf

from experiments.stability import meshes, report
from experiments.stability.cases import CASES, Case, Value
from prtnet import netspec, score
from prtnet.config import Config
from prtnet.netspec import NetSpec
from prtnet.pipeline.bake import bake
from prtnet.pipeline.export import Exported
from prtnet.pipeline.job import Job, open_job
from prtnet.pipeline.methods import make_all
from prtnet.pipeline.train import train
from prtnet.pipeline.views import View, reference_of, views_of
from prtnet.render.gbuffer import shade
from prtnet.render.raster import Raster
from prtnet.render.vertex import VertexMethod

Array = np.ndarray
Image = Float[Array, "h w 3"]
RESULTS = Path(__file__).parent / "results"
METHODS = ("vertex", "texture", "net")
COLUMNS = ("case", "value", "method", "psnr", "worst", "p999", "floor", "other_part")


@dataclass(frozen=True)
class Sizes:
    """How large the study is; `steps` of training, and not seconds, so that a busy machine finds the same."""

    atlas: int = 512
    pixels: int = 128
    views: int = 3
    traced: int = 1024
    samples: int = 100_000
    directions: int = 256
    steps: int = 1500
    width: int = 64
    depth: int = 4
    test: int = 2000

    def settings(self) -> dict[str, Any]:
        return {
            "atlas.size": self.atlas,
            "render.size": self.pixels,
            "render.views": self.views,
            "render.traced_directions": self.traced,
            "samples.count": self.samples,
            "samples.test_count": self.test,
            "transfer.directions": self.directions,
            "train.steps": self.steps,
            # the net alone is studied, and 100 000 points are too few for hashed grids
            "train.grid_cells": [],
            "train.hash_cells": [],
            "samples.directions": None,  # as texels, by the case
            "model.width": self.width,
            "model.depth": self.depth,
        }


@dataclass(frozen=True)
class Measured:
    """Tone-mapped views of each method and of `traced`, and what their differences come to."""

    rows: list[dict[str, Any]]
    frames: dict[str, list[Image]]
    covered: list[Bool[Array, "h w"]]


def config_of(case: Case, value: Value, sizes: Sizes, out: Path) -> Config:
    """The configuration of one value, its mesh written where it has one of its own."""
    settings = sizes.settings() | dict(value.settings)
    settings |= {"out": str(out / case.name / value.label.replace(" ", "_")), "cache": str(out / "cache")}
    if value.parts is not None:
        folder = out / "meshes"
        folder.mkdir(parents=True, exist_ok=True)
        name = f"{case.name}_{case.values.index(value)}.obj"
        settings["scene.path"] = str(meshes.write(folder / name, value.parts))
    made = OmegaConf.structured(Config)
    for key, setting in settings.items():
        OmegaConf.update(made, key, setting)
    config = OmegaConf.to_object(made)
    assert isinstance(config, Config)
    return config


def measure(case: Case, value: Value, sizes: Sizes, out: Path) -> Measured:
    """Bake, train, draw and compare one value of a case."""
    job = open_job(config_of(case, value, sizes, out), "", None)
    baked = bake(job)
    assert baked.points is not None
    net = quantised(train(job, baked.points).net, value.weights)
    coefficients = job.light.coefficients(job.config.transfer.bands)
    drawing = Raster(baked.texture.atlas, sizes.pixels)
    views = views_of(job, drawing, coefficients, None)
    methods = make_all(job, baked, None, Exported(None, {}), drawing)
    assert isinstance(methods["vertex"].shaded, VertexMethod)
    covered = [view.covered & methods["vertex"].shaded.covers(view.camera) for view in views]
    linear = {name: [each.shaded.draw(view.camera, coefficients) for view in views] for name, each in methods.items()}
    linear["net"] = [shade(view.gbuffer, transfer_of(net, view), coefficients) for view in views]
    linear["traced"] = [view.reference for view in views]
    exposure = score.exposure(linear["traced"], covered)
    frames = {name: [score.tone_map(image, exposure) for image in images] for name, images in linear.items()}
    again = reference_of(job, "traced again", views[0].camera, views[0].gbuffer, coefficients, None, repeat=1)
    floor = score.psnr(score.tone_map(again, exposure), frames["traced"][0], covered[0])
    head = {"case": case.name, "value": value.label}
    tail = {"floor": floor, "other_part": other_part(job, views)}
    rows = [head | {"method": name} | errors(frames[name], frames["traced"], covered) | tail for name in METHODS]
    return Measured([{key: _rounded(entry) for key, entry in row.items()} for row in rows], frames, covered)


def transfer_of(net: NetSpec, view: View) -> Float[Array, "n k"]:
    return netspec.evaluate_unit(net, view.gbuffer.positions, view.gbuffer.normals)


def errors(images: Sequence[Image], references: Sequence[Image], covered: Sequence[Array]) -> dict[str, float]:
    """Of tone-mapped images: mean PSNR of the views; the largest difference of a channel of any covered pixel of all
    views, and what one pixel in a thousand exceeds, since a single one on an outline says little."""
    pairs = list(zip(images, references, covered, strict=True))
    worst = np.concatenate([np.abs(image - wanted)[mask].max(axis=-1) for image, wanted, mask in pairs])
    return {
        "psnr": float(np.mean([score.psnr(image, wanted, mask) for image, wanted, mask in pairs])),
        "worst": float(worst.max()),
        "p999": float(np.percentile(worst, 99.9)),
    }


def other_part(job: Job, views: Iterable[View]) -> float:
    """Share of the covered pixels whose face belongs to another part than the one that a ray from the eye hits first:
    what the depth buffer could not tell apart. Methods and reference share that mistake, so no PSNR shows it."""
    wrong = []
    for view in views:
        seen = view.gbuffer
        directions = view.camera.rays(seen.size).reshape(-1, 3)[seen.pixel]
        face, _, _ = job.tracer.hits(np.broadcast_to(view.camera.eye, directions.shape), directions)
        wrong.append(job.scene.part[face] != seen.part)
    return float(np.mean(np.concatenate(wrong)))


def quantised(net: NetSpec, kind: str) -> NetSpec:
    """The net with its matrices as they come back from `kind`: float32, float16, or int8 in 127 steps to either side
    of zero, up to the largest weight of each row. float16 rounds biases too; bytes leave them as they are."""
    if kind == "float32":
        return net
    if kind == "float16":
        weights, biases = (
            tuple(a.astype(np.float16).astype(np.float32) for a in arrays) for arrays in (net.weights, net.biases)
        )
        return replace(net, weights=weights, biases=biases)
    assert kind == "int8", kind
    return replace(net, weights=tuple(int8_by_row(weight) for weight in net.weights))


def int8_by_row(weight: Float[Array, "r c"]) -> Float[Array, "r c"]:
    """A matrix after a way through bytes, each row by a step of its own: 1 / 127 of its largest absolute value."""
    step = np.abs(weight).max(axis=1, keepdims=True).astype(np.float64) / 127
    whole = np.rint(weight / np.where(step > 0, step, 1)).astype(np.int8)
    return (whole * step).astype(np.float32)


def _rounded(entry: Any) -> Any:
    return float(f"{entry:.4g}") if isinstance(entry, float) else entry


def read(path: Path) -> list[dict[str, Any]]:
    """The rows of an earlier run. Inverse of `write`."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return [
            {key: text if key in COLUMNS[:3] else float(text) for key, text in row.items()}
            for row in csv.DictReader(file)
        ]


def write(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def study(cases: Sequence[Case], sizes: Sizes, out: Path, results: Path, *, order: Sequence[Case] = CASES) -> None:
    """Measure cases. Rows of others of `order` stay, and the chart and the table of the page show them all."""
    results.mkdir(parents=True, exist_ok=True)
    table, names = results / "stability.csv", [case.name for case in order]
    for case in cases:
        new = []
        for value in case.values:
            found = measure(case, value, sizes, out)
            new += found.rows
            print(report.line(found.rows), flush=True)
            if value.label == case.shown:
                report.keep(out, case, report.crop(found.frames, found.covered))
        rows = [row for row in read(table) if row["case"] != case.name] + new
        write(table, sorted(rows, key=lambda row: names.index(row["case"])))
    rows = read(table)
    report.chart(results / "chart.png", order, rows)
    report.sheet(results / "sheet.jpg", order, out)
    page = results.parent / "README.md"
    if page.exists():
        report.update(page, order, rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE", help="names as --list gives them; all when left out")
    parser.add_argument("--list", action="store_true", help="say what there is, and why")
    parser.add_argument("--out", type=Path, default=Path("runs/stability"), help="meshes, bakes and nets")
    for name, default in asdict(Sizes()).items():
        parser.add_argument(f"--{name}", type=int, default=default)
    chosen = parser.parse_args()
    unknown = set(chosen.cases) - {case.name for case in CASES}
    if unknown:
        parser.error(f"found {', '.join(sorted(unknown))}, expected some of {', '.join(c.name for c in CASES)}")
    if chosen.list:
        for case in CASES:
            print(f"{case.name}: {case.reason}\n    {case.axis}: {', '.join(value.label for value in case.values)}")
        return
    logging.basicConfig(level=logging.WARNING)
    sizes = Sizes(**{name: getattr(chosen, name) for name in asdict(Sizes())})
    study([case for case in CASES if not chosen.cases or case.name in chosen.cases], sizes, chosen.out, RESULTS)


if __name__ == "__main__":
    main()
