"""What the sweep of baselines found, and what its rows cannot tell: frame times side by side, and memory.

    prtnet -m experiment=baselines
    python experiments/baselines.py [runs/baselines]

Reads the points' config.yaml and score.json and finds their bakes in the cache. All programs of a scene, vertices as
they are and cut finer, three materials, are timed in turns in one process. Writes the tables of baselines.md and, into
results/baselines/, times.csv, memory.csv, cost.png and the sweep's score.json and chart.png.
"""

import csv
import gc
import shutil
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from omegaconf import OmegaConf

from prtnet import gl, netspec, score, sh
from prtnet.chart import tables
from prtnet.config import Config
from prtnet.data import matrix
from prtnet.pipeline.bake import Baked, bake
from prtnet.pipeline.export import Exported
from prtnet.pipeline.job import Job, open_job
from prtnet.pipeline.methods import make_all
from prtnet.render import camera
from prtnet.render.camera import Camera
from prtnet.render.method import Shaded
from prtnet.render.raster import Raster
from prtnet.render.vertex import pack

PAGE = Path(__file__).with_name("baselines.md")
RESULTS = Path(__file__).parent / "results" / "baselines"
MATERIALS = {"diffuse": "diffuse", "glossy": "TPFL", "glossy_full": "TP"}
SCENES = ("tea_set", "dining_table", "room", "plants_dense")
DISTANCES, ROUNDS, SIZE, GRID = (1.0, 1.5, 2.5, 4.0), 5, 512, 512  # SIZE: pixels along the side of what is timed
Row = dict[str, Any]


def point(base: Path, scene: str, material: str) -> Path:
    """The folder of a point of the sweep."""
    return base / f"material={material},scene={scene}"


def config_of(folder: Path) -> Config:
    """The configuration of a point. What it baked is found in the cache that this names."""
    plain = OmegaConf.merge(OmegaConf.structured(Config), OmegaConf.load(folder / "config.yaml"))
    config = OmegaConf.to_object(plain)
    assert isinstance(config, Config)
    return config


@dataclass(frozen=True)
class Form:
    """A way to keep a scene's transfer: how many values, and the bytes of the real arrays where there are such."""

    name: str
    values: int  # float32
    real: int | None  # bytes: what is uploaded or baked, padding included

    @property
    def bytes(self) -> int:
        return 4 * self.values if self.real is None else self.real


def forms(vertices: int, texels: int, bands: int, net: netspec.NetSpec, real: Mapping[str, int]) -> list[Form]:
    """All of them for a mesh of so many vertices and a texture of so many texels. A vector has k = bands^2 values at
    each point, a matrix k^2; a grid has a vector in each of its GRID^3 cells."""
    count = sh.count(bands)
    values = {
        "vertex vector": vertices * count,
        "vertex matrix": vertices * count**2,
        "texel vector": texels * count,
        "texel matrix": texels * count**2,
        f"{GRID}^3 grid of vectors": GRID**3 * count,
        "net": sum(array.size for array in (*net.weights, *net.biases)),
    }
    return [Form(name, number, real.get(name)) for name, number in values.items()]


def memory(job: Job, baked: Baked, drawn: Mapping[str, Shaded], net: netspec.NetSpec) -> list[Form]:
    """The forms of one scene; vectors are those on the graphics card, matrices are made where they fit."""
    assert baked.mesh is not None
    mesh, bands, texels = baked.mesh.mesh, job.config.transfer.bands, job.config.atlas.size**2
    real = {
        "vertex vector": pack(baked.mesh.transfer, gl.context().info["GL_MAX_TEXTURE_SIZE"]).nbytes,
        "texel vector": drawn["texture"].bytes,  # pyright: ignore[reportAttributeAccessIssue]
        "net": netspec.byte_count(net),
    }
    if len(mesh.vertices) * 4 * sh.count(bands) ** 2 <= matrix.MEMORY:
        # its size is what matters here: few rays are enough
        made = matrix.bake(
            job.tracer, mesh.vertices, mesh.normals, bands=bands, directions=16, rng=np.random.default_rng(0)
        )
        real["vertex matrix"] = made.nbytes
    return forms(len(mesh.vertices), texels, bands, net, real)


def default_net(bands: int) -> netspec.NetSpec:
    """The network of the defaults, untrained: its size does not depend on what it learns."""
    import torch

    from prtnet.models.mlp import Mlp

    config = Config()
    return Mlp(config.model, config.train, bands, torch.Generator().manual_seed(0)).spec()


def eyes(job: Job) -> list[tuple[float, Camera]]:
    """The first view from several distances, in lengths of its own; rooms are seen from inside, from one."""
    first = camera.path(job.scene, job.tracer, job.config.render.views, kind=job.config.scene.camera)[0]
    if camera.kind_of(job.scene, job.tracer, job.config.scene.camera) == "inside":
        return [(1.0, first)]
    towards = np.subtract(first.eye, first.target)
    moved = ((times, tuple((np.array(first.target) + times * towards).tolist())) for times in DISTANCES)
    return [(times, replace(first, eye=eye, far=first.far * times)) for times, eye in moved]


def programs(base: Path, scene: str) -> Iterator[tuple[Job, Baked, str, str, Shaded]]:
    """(job, bake, material, method) of a scene: the texture, and vertices coarse and fine."""
    for name in (scene, f"{scene}_fine"):
        folder = point(base, name, "diffuse")
        job = open_job(config_of(folder), "", folder.name)
        baked = bake(job)
        drawing = Raster(baked.texture.atlas, SIZE)
        for material in MATERIALS:
            config = replace(job.config, material=config_of(point(base, name, material)).material)
            config = replace(config, render=replace(config.render, size=SIZE))
            made = make_all(replace(job, config=config), baked, None, Exported(None, {}), drawing)
            for method, each in made.items():
                fine = " fine" if name != scene else ""
                if method != "texture" or not fine:
                    yield job, baked, material, method + fine, each.shaded


def times(jobs: Sequence[tuple[Job, Baked, str, str, Shaded]], scene: str) -> Iterator[Row]:
    """A row for each program and distance: the least of ROUNDS, all in turns, over the diffuse texture's at 1."""
    job = jobs[0][0]
    light, views = job.light.coefficients(job.config.transfer.bands), eyes(job)
    taken = np.empty((ROUNDS, len(views), len(jobs)))
    # the least, and not the median: others may use the machine
    for turn, view, program in np.ndindex(*taken.shape):
        taken[turn, view, program] = jobs[program][-1].milliseconds(views[view][1], light, repeats=1)
    least = taken.min(axis=0)
    # the first program is the diffuse texture, the first distance its own
    base = least[0, 0]
    for (distance, eye), own in zip(views, least, strict=True):
        covered = float(np.mean(jobs[0][-1].raster.faces(eye)[..., 0] > 0))
        for ms, (_, _, material, method, shaded) in zip(own, jobs, strict=True):
            drawn = shaded.raster.scene
            yield {
                "scene": scene, "method": method, "material": material, "distance": distance,
                "covered": round(covered, 4), "vertices": len(drawn.vertices), "triangles": len(drawn.faces),
                "ms": round(float(ms), 3), "ratio": round(float(ms / base), 4),
            }  # fmt: skip


def study(base: Path) -> tuple[list[Row], list[Row]]:
    """Rows of times and of memory, scene by scene."""
    timed: list[Row] = []
    kept: list[Row] = []
    for scene in SCENES:
        started = time.perf_counter()
        jobs = list(programs(base, scene))
        timed += times(jobs, scene)
        for method in ("vertex", "vertex fine"):
            job, baked = next((job, baked) for job, baked, _, name, _ in jobs if name == method)
            drawn = {name: each for _, _, material, name, each in jobs if material == "diffuse"}
            found = memory(job, baked, drawn, default_net(job.config.transfer.bands))
            # the texture, the grid and the net are the same for both meshes
            found = found if method == "vertex" else [form for form in found if form.name.startswith("vertex")]
            kept += [
                {
                    "scene": scene, "mesh": "fine" if "fine" in method else "", "form": form.name,
                    "vertices": len(baked.mesh.mesh.vertices) if baked.mesh and "vertex" in form.name else "",
                    "bytes": form.bytes, "from": "computed" if form.real is None else "arrays",
                }
                for form in found
            ]  # fmt: skip
        print(f"{scene}: {time.perf_counter() - started:.0f} s", flush=True)
        del jobs
        gc.collect()
    return timed, kept


def chart(path: Path, timed: Sequence[Row]) -> None:
    """Ratios against the covered share, a panel for each orbit, and against vertices, all scenes at distance 1."""
    orbits = [scene for scene in SCENES if len({row["distance"] for row in timed if row["scene"] == scene}) > 1]
    figure = Figure(figsize=(4.4 * (len(orbits) + 1), 4.2), dpi=110, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(orbits) + 1)
    colours = dict(zip(MATERIALS, ("#0b6fb8", "#2a8a5b", "#c8501e"), strict=True))
    styles = {"texture": "-o", "vertex": "--s", "vertex fine": ":^"}
    for axes, scene in zip(panels, orbits, strict=False):
        for material, colour in colours.items():
            for method, style in styles.items():
                rows = [r for r in timed if (r["scene"], r["material"], r["method"]) == (scene, material, method)]
                places = [r["covered"] for r in rows], [r["ratio"] for r in rows]
                axes.plot(*places, style, color=colour, markersize=4, label=f"{method}, {MATERIALS[material]}")
        _dress(axes, scene, "covered share of the frame")
    axes = panels[-1]
    for material, colour in colours.items():
        for method in ("vertex", "vertex fine"):
            rows = [r for r in timed if (r["distance"], r["material"], r["method"]) == (1.0, material, method)]
            places = [r["vertices"] for r in rows], [r["ratio"] for r in rows]
            axes.plot(*places, styles[method][-1], color=colour, markersize=5)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: tables.count(value)))
    axes.xaxis.set_minor_formatter(NullFormatter())
    _dress(axes, "vertices, all scenes, distance 1", "vertices drawn")
    panels[0].set_ylabel("frame time over the diffuse texture's at distance 1")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=9, frameon=False, fontsize=8)
    figure.savefig(path, format="png", metadata={"Software": None})


def _dress(axes: Axes, title: str, label: str) -> None:
    axes.set_title(title, loc="left", size=10)
    axes.set_xlabel(label)
    axes.set_ylim(bottom=0)
    axes.grid(True, color="#e4e7ec")


def quality_table(rows: Sequence[score.Row]) -> str:
    """PSNR against `traced` of the sweep's own rows: the texture, and vertices at both tessellations."""
    lines = ["| scene | material | covered | texture | vertex | vertex fine | noise floor |", "|---" * 7 + "|"]
    for scene in SCENES:
        for material, name in MATERIALS.items():
            found = {}
            for row in rows:
                fine = " fine" if row.point == f"material={material},scene={scene}_fine" else ""
                if fine or row.point == f"material={material},scene={scene}":
                    found[row.method + fine] = row
            cells = [f"{found[k].psnr:.1f}" for k in ("texture", "vertex", "vertex fine", score.NOISE_FLOOR)]
            lines.append(f"| {scene} | {name} | {found['texture'].covered:.0%} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def time_table(timed: Sequence[Row]) -> str:
    """Ratios at distance 1: a line for each scene and method, a column for each material."""
    lines = [f"| scene | method | vertices | {' | '.join(MATERIALS.values())} |", "|---|---|---|---|---|---|"]
    for scene in SCENES:
        near = [row for row in timed if row["scene"] == scene and row["distance"] == 1.0]
        for method in dict.fromkeys(row["method"] for row in near):
            own = {row["material"]: row for row in near if row["method"] == method}
            cells = [f"{own[material]['ratio']:.2f}" for material in MATERIALS]
            lines.append(f"| {scene} | {method} | {tables.count(own['diffuse']['vertices'])} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def memory_table(kept: Sequence[Row]) -> str:
    """A column for each form; what was computed in italics."""
    names = list(dict.fromkeys(row["form"] for row in kept))
    lines = ["| scene | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for scene, mesh in dict.fromkeys((row["scene"], row["mesh"]) for row in kept):
        own = {row["form"]: row for row in kept if (row["scene"], row["mesh"]) == (scene, mesh)}
        texts = {name: tables.size(row["bytes"]) for name, row in own.items()}
        texts |= {name: f"*{texts[name]}*" for name, row in own.items() if row["from"] == "computed"}
        lines.append(
            f"| {scene}{' fine' if mesh else ''} | " + " | ".join(texts.get(name, "") for name in names) + " |"
        )
    return "\n".join(lines) + "\n"


def write(base: Path, timed: Sequence[Row], kept: Sequence[Row]) -> None:
    """Everything into the study's page and its results."""
    RESULTS.mkdir(parents=True, exist_ok=True)
    for name, rows in (("times", timed), ("memory", kept)):
        with (RESULTS / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    chart(RESULTS / "cost.png", timed)
    for name in ("score.json", "chart.png"):
        shutil.copyfile(base / name, RESULTS / name)
    rows, _ = score.read(base / "score.json")
    text = PAGE.read_text(encoding="utf-8")
    for name, table in (("quality", quality_table(rows)), ("times", time_table(timed)), ("memory", memory_table(kept))):
        before, _, rest = text.partition(f"<!-- {name} -->\n")
        text = f"{before}<!-- {name} -->\n{table}<!-- end -->\n{rest.partition('<!-- end -->' + chr(10))[2]}"
        print(table)
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    folder = Path(sys.argv[1] if sys.argv[1:] else "runs/baselines")
    write(folder, *study(folder))
