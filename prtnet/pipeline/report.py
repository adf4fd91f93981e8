"""The end of a run: score.json, the table on the terminal, pictures, card.md and report.html."""

import logging
from typing import Any

import numpy as np

from prtnet import netspec, score, sh, store
from prtnet.chart import lobes, plot, sheet, tables
from prtnet.chart import report as pages
from prtnet.pipeline import drawn_by, seams
from prtnet.pipeline.bake import Baked, BakedTexture, NetPoints
from prtnet.pipeline.export import Exported
from prtnet.pipeline.job import Job
from prtnet.pipeline.score import Scored
from prtnet.pipeline.train import Trained

log = logging.getLogger(__name__)

FILES = {
    "net.safetensors": "the network, for prtnet.netspec.load",
    "transfer.glsl": "the function prt_transfer with the weights in it, to paste into a shader",
    "transfer.frag": "the same as a whole fragment shader",
    "shading.glsl": "prt_shade_diffuse and prt_shade_glossy, to paste below it",
    "shading.frag": "both as a whole fragment shader",
    "irradiance.glsl": "prt_irradiance, with the light folded into the last layer, in place of the others",
    "irradiance.frag": "the same as a whole fragment shader",
    "transfer_weights.bin": "the weights of the shaders' texture or uniform blocks",
    "transfer.cu": "the same network as CUDA kernels",
    "transfer_cuda.bin": "the numbers that they read",
    "transfer_texture.exr": "the baseline: transfer in the atlas, one channel per coefficient",
    "transfer_texture.json": "what the channels are, for readers of the texture",
    "transfer_texture_mesh.safetensors": "the mesh with its coordinates in the texture",
    "transfer_vertices.safetensors": "the mesh of the method vertex and the transfer of its vertices",
    "transfer_vertices.glb": "the same mesh for other programs, transfer as attributes _PRT_0, _PRT_1, ...",
    "clusters": "the networks of the clusters, for prtnet.clusters.load, their shaders and certificate",
    "clusters.md": "what the clusters are, why leaves were merged, what each network takes",
    "pictures": "the first view of each method as the display options of this run show it",
    "clusters.png": "the clusters in the first view, and the error there",
    "lobes.png": "transfer of four held-out points on the sphere: the truth, the net's, their difference",
    "score.json": "the scores below, for programs",
    "certificate.json": "measured errors and times of the shaders, and checksums",
    "config.yaml": "every key of this run",
}


def report(job: Job, baked: Baked, trained: Trained | None, exported: Exported, scored: Scored) -> None:
    """Write what is missing of the run folder's pages, and print the table."""
    out, page = job.out, job.out / "report.html"
    stamp = out / ".report.key"
    written = [page, out / "score.json", out / "card.md", out / "contact_sheet.png", out / "chart.png"]
    written += [out / "lobes.png"] if trained and baked.points else []
    if not (stamp.exists() and stamp.read_text() == scored.key and all(path.exists() for path in written)):
        _write(job, baked, trained, exported, scored)
        store.write_text(stamp, scored.key)
    print(tables.table(scored.rows))
    print(f"\n{page}")


def _write(job: Job, baked: Baked, trained: Trained | None, exported: Exported, scored: Scored) -> None:
    out, rows = job.out, scored.rows
    versions = score.versions()
    score.write(out / "score.json", rows, versions, **({"seams": scored.facts["seams"]} if exported.clusters else {}))
    title = f"{job.scene.name}: transfer"
    if trained:
        title += f" in a network of {job.config.model.words()}"
    frames = {name: list(images) for name, images in scored.frames.items() if name not in ("covered", "cluster")}
    covered = list(scored.frames["covered"])
    numbers = scored.facts["shown_views"]
    sheet.contact_sheet(out / "contact_sheet.png", frames, covered=covered, numbers=numbers, title=title)
    plot.pareto(out / "chart.png", rows, title=job.scene.name)
    pictures = {
        "Views, methods and 8 x their errors": out / "contact_sheet.png",
        "Accuracy against cost": out / "chart.png",
    }
    if trained and baked.points:
        _lobes(job, baked.points, trained)
        caption = "Transfer of held-out points: the sphere about the normal, the horizon dashed"
        pictures[caption] = out / "lobes.png"
    if exported.clusters:
        cluster = scored.frames["cluster"][0]
        seams.write_picture(out / seams.PICTURE, frames["clusters"][0], frames["traced"][0], cluster)
        pictures["Clusters in the first view, and 8 x the error of the method clusters"] = out / seams.PICTURE
    facts = _facts(job, baked, trained, exported, scored)
    files = {name: words for name, words in FILES.items() if (out / name).exists() or name == "score.json"}
    pages.card(out / "card.md", rows, facts, pictures, title=title, files=files)
    history = [(int(step), float(loss)) for step, loss in trained.facts["history"]] if trained else []
    pages.report(
        out / "report.html",
        rows,
        facts,
        pictures,
        title=title,
        history=history,
        versions=versions,
        command=job.command,
    )


def _lobes(job: Job, points: NetPoints, trained: Trained) -> None:
    """Direct transfer of the held-out points at which the net is best and worst, and of two between."""
    areas, count = points.areas, sh.count(job.config.transfer.bands)
    predicted = netspec.evaluate_unit(trained.net, areas.positions, areas.normals, uv=areas.uv)[:, :count]
    truth = areas.transfer[:, :count]
    errors = lobes.rmse(predicted, truth)
    shown = lobes.chosen(errors)
    title = f"{job.scene.name}: transfer of held-out points, RMSE of all {np.sqrt(np.mean(errors**2)):.4f}"
    names, few = list(shown), list(shown.values())
    lobes.picture(job.out / "lobes.png", predicted[few], truth[few], areas.normals[few], names=names, title=title)


def _facts(job: Job, baked: Baked, trained: Trained | None, exported: Exported, scored: Scored) -> dict[str, Any]:
    transfer, render = job.config.transfer, job.config.render
    facts = {
        "scene": job.scene.name,
        "triangles": len(job.scene.faces),
        "SH bands (coefficients)": f"{transfer.bands} ({transfer.bands**2})",
        "transport": f"{transfer.transport}, {job.bounces} bounces" if job.bounces else transfer.transport,
        "rays per point": transfer.directions,
        "tracer": job.tracer.kind,
        **job.scene_facts,
    }
    if trained and baked.points:
        facts |= _net_facts(baked.points, trained, exported)
    if baked.mesh:
        facts["vertices"] = f"{len(baked.mesh.mesh.vertices)} ({_cuts(job)})"
    if baked.texture:
        facts |= _texture_facts(job, baked.texture)
    facts |= scored.facts.get("linear", {})
    return facts | {
        "light": job.light_name,
        "material": job.material.words(),
        "exposure": scored.facts["exposure"],
        "frame covered": f"{scored.facts['covered']:.0%}",
        **seams.words(scored.facts.get("seams", {})),
        "rays per pixel of the reference": render.traced_directions,
        "image": f"{render.views} views of {render.size} x {render.size}",
        "centre and scale": f"{job.frame.centre.tolist()}, {job.frame.scale:.9g}",
    }


def _net_facts(points: NetPoints, trained: Trained, exported: Exported) -> dict[str, Any]:
    return {
        "training points": points.training.facts["points"],
        "of them enclosed, left out": points.training.facts["enclosed"],
        **({} if points.strayed is None else {"their rays, against the surface itself": f"{points.strayed:.2%} off"}),
        "recipe": trained.facts["recipe"],
        "training steps": trained.facts["steps"],
        "training CPU-seconds": trained.facts["cpu_seconds"],
        "transfer RMSE, held-out points": trained.facts["areas_rmse"],
        "transfer RMSE, vertices": trained.facts["vertices_rmse"],
        "multiply-adds of the net": exported.facts["macs"],
        "bytes of the net": exported.facts["bytes"],
        "net drawn by": "its shader" if exported.drawn_by == drawn_by.SHADER else "the CPU, from the G-buffer",
        "shader against NumPy, worst coefficient": exported.facts["agreement"],
    }


def _cuts(job: Job) -> str:
    options = job.config.vertex
    cut = bool(options.subdivide and options.level)
    return f"{', '.join(options.subdivide)} cut {options.level} times" if cut else "as the scene has them"


def _texture_facts(job: Job, baked: BakedTexture) -> dict[str, Any]:
    return {
        "texture texels in use": baked.facts["texels"],
        "texture coordinates": baked.facts["uv"],
        "texture": _texture(job, baked),
    }


def _texture(job: Job, baked: BakedTexture) -> str:
    options, sides = job.config.atlas, baked.atlas.sides
    words = f"{options.size}^2" if sides is None else f"{len(sides)} of {min(sides)}^2 to {max(sides)}^2, one per part"
    count = len(baked.pages[0].levels)
    levels = f", {count} mip levels by {options.level_of_detail}" if count > 1 else ""
    return f"{words}, {options.format}{levels}, dilated by {options.dilation}"
