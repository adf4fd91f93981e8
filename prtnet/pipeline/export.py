"""Stage `export`: the net as a file and as GLSL with their certificate, and the baselines as files."""

import hashlib
import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from prtnet import PrtnetError, netspec, store
from prtnet.export import bundle, certificate, cuda_file, form, gltf, texture_file, vertices
from prtnet.export.bundle import Bundle
from prtnet.export.form import Form
from prtnet.models.inference import Inference
from prtnet.pipeline import drawn_by
from prtnet.pipeline.bake import Baked, BakedMesh, BakedTexture, NetPoints
from prtnet.pipeline.candidates import form_of
from prtnet.pipeline.clusters import ClustersTrained
from prtnet.pipeline.cuda import kernels
from prtnet.pipeline.export_clusters import ClustersExported, export_clusters
from prtnet.pipeline.job import Job
from prtnet.pipeline.lightmap import write_lightmap
from prtnet.pipeline.train import Trained
from prtnet.pipeline.web import write_page
from prtnet.render import certify, verify

log = logging.getLogger(__name__)
Array = np.ndarray

CHECKED_POINTS = 1 << 14  # of the cube, and as many of the scene, of a net of literals
NET = "net.safetensors"
_NAMES = {*bundle.NAMES, *cuda_file.NAMES}
# what is left of earlier versions
_FORMER = ("export.json",)


@dataclass(frozen=True, eq=False)
class Exported:
    """The shaders that methods draw, where there is a net."""

    drawn: Bundle | None
    facts: Mapping[str, Any]
    drawn_by: str = drawn_by.SHADER  # or DEFERRED
    clusters: ClustersExported | None = None


def export(job: Job, baked: Baked, trained: Trained | None, clusters: ClustersTrained | None = None) -> Exported:
    """Write the nets, their shaders, certificate.json and the files of the baselines into the run folder.

    Raises PrtnetError, and leaves nothing of the net behind, when an error is above its bound.
    """
    exported = _net(job, baked.points, trained) if trained and baked.points else Exported(None, {})
    if baked.texture:
        _write_texture(job, baked.texture)
    if baked.mesh:
        _write_vertices(job, baked.mesh)
    if clusters and baked.points:
        exported = replace(exported, clusters=export_clusters(job, baked.points, clusters))
    if baked.texture and job.config.export.lightmap:
        write_lightmap(job, baked.texture)
    if job.config.export.web:
        write_page(job, baked, trained, side=job.config.export.web_texture)
    return exported


def _net(job: Job, points: NetPoints, trained: Trained) -> Exported:
    try:
        made, beyond = drawn_by.shaders(trained.net, form_of(job.config))
        validated = bundle.validate(made)
        count = _checked(made)
        measured = _measured(job, points, trained, made, count)
        certificate.refuse(measured["errors"])
        in_cuda = kernels(job, trained, count, lambda: _points(job, points, count))
    except PrtnetError:
        certificate.remove(job.out, (*_NAMES, NET, *_FORMER))
        raise
    files = made.files | in_cuda.files
    facts = {"net": certificate.of_net(trained.net), "form": asdict(made.form), **measured}
    facts |= {"validated": validated, **({"beyond_minimum": beyond} if beyond else {}), **in_cuda.facts}
    certificate.remove(job.out, (*(_NAMES - set(files)), *_FORMER))
    netspec.save(trained.net, job.out / NET)
    for name, data in files.items():
        store.write_bytes(job.out / name, data)
    certificate.write(job.out, facts, [NET, *files])
    words = "; ".join(f"{what} {each['max']:.1e}" for what, each in measured["errors"].items())
    log.info("export: %s, %s; errors at most: %s", made.form.storage, measured.get("device", "not run"), words)
    # uniform blocks are not run: what is drawn has the same weights
    drawn = made if measured["executed"] else bundle.bundle(trained.net, Form(), drawn_by.driver())
    by = drawn_by.chosen(job.config.render.net, drawn.net)
    return Exported(drawn, {**facts["net"], "agreement": _agreement(measured)}, by)


def _agreement(measured: Mapping[str, Any]) -> str:
    if not measured["executed"]:
        return measured["reason"]
    found = measured["errors"]["coefficients"]
    return f"{found['max']:.1e} (bound {found['bound']:g})"


def _measured(job: Job, points: NetPoints, trained: Trained, made: Bundle, count: int) -> dict[str, Any]:
    """The shaders and torch run against the NumPy twin at `count` random points of the whole cube, and as many test
    points of this scene."""
    texts = hashlib.sha256(b"".join(made.files[name] for name in sorted(made.files))).hexdigest()
    inputs = {"net": trained.key, "shaders": texts, "points": count}

    def make() -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        where = _points(job, points, count)
        facts = certify.errors_and_timing(made, trained.net, where)
        facts["points"] = {"cube": count, "scene": len(where.positions) - count}
        in_torch = Inference(trained.net)(where.positions, where.normals, where.uv)
        facts["errors"]["torch"] = certify.error_of(in_torch - where.evaluated(trained.net))
        return {}, facts

    return dict(job.store.make("export", inputs, make).facts)


def _points(job: Job, points: NetPoints, count: int) -> certify.Points:
    """As many of the cube, and then at most as many of the scene."""
    rng = job.rng("export")
    positions, normals = verify.random_points(count, rng)
    few = rng.permutation(len(points.areas.positions))[:count]
    positions = np.concatenate([positions, points.areas.positions[few]]).astype(np.float32)
    normals = np.concatenate([normals, points.areas.normals[few]]).astype(np.float32)
    places = points.areas.uv
    uv = None if places is None else np.concatenate([rng.random((count, 2), np.float32), places[few]])
    return certify.Points(positions, normals, uv)


def _checked(made: Bundle) -> int:
    """Points of the cube, and of the scene. On a software driver a weight texture is ten times as slow as literals."""
    if made.weights is None:
        return CHECKED_POINTS
    macs = form.padded_macs_of(form.sizes_of(made.net), made.net.groups)
    return int(np.clip(CHECKED_POINTS * form.AUTO_LITERAL_MACS // (4 * macs), 1 << 10, 1 << 12))


def _write_texture(job: Job, baked: BakedTexture) -> None:
    options, stamp = job.config.atlas, job.out / ".transfer_texture.key"
    key = f"{texture_file.FORMAT} {baked.key} {options.dilation} {options.format} {options.mipmaps}"
    names = (texture_file.EXR, texture_file.JSON, texture_file.MESH)
    if stamp.exists() and stamp.read_text() == key and all((job.out / name).exists() for name in names):
        return
    texture_file.write(
        job.out,
        baked.atlas,
        baked.pages,
        job.frame,
        storage=options.format,
        dilation=options.dilation,
        groups=job.groups,
    )
    store.write_text(stamp, key)


def _write_vertices(job: Job, baked: BakedMesh) -> None:
    paths = [job.out / f"transfer_vertices.{suffix}" for suffix in ("safetensors", "glb")]
    stamp = job.out / ".transfer_vertices.key"
    if all(path.exists() for path in paths) and stamp.exists() and stamp.read_text() == baked.key:
        return
    file = vertices.of_mesh(baked.mesh, job.frame, baked.transfer, job.config.transfer.transport)
    vertices.write(paths[0], file)
    gltf.write(paths[1], file, baked.mesh)
    store.write_text(stamp, baked.key)
