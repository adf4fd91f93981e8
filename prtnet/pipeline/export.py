"""Stage `export`: the net as a file and as GLSL, the baselines as files, and the shader's error against its twin."""

import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from prtnet import PrtnetError, gl, netspec, store
from prtnet.export import glsl, gltf, texture_file, vertices
from prtnet.pipeline.bake import Baked, BakedMesh, BakedTexture, NetPoints
from prtnet.pipeline.job import Job
from prtnet.pipeline.train import Trained
from prtnet.render import verify

log = logging.getLogger(__name__)

CHECKED_POINTS = 1 << 14


@dataclass(frozen=True)
class Exported:
    """The net's shader, where there is a net."""

    shader: str | None  # the function prt_transfer
    facts: Mapping[str, Any]


def export(job: Job, baked: Baked, trained: Trained | None) -> Exported:
    """Write the net, its shaders, export.json and the files of the baselines into the run folder.

    Raises PrtnetError, and leaves no shader behind, when its error against the NumPy twin is above 1e-5.
    """
    exported = _net(job, baked.points, trained) if trained and baked.points else Exported(None, {})
    _write_texture(job, baked.texture)
    if baked.mesh:
        _write_vertices(job, baked.mesh)
    return exported


def _net(job: Job, points: NetPoints, trained: Trained) -> Exported:
    shader = glsl.emit(trained.net)
    whole = glsl.fragment_shader(trained.net)
    complaint = glsl.validate(whole)
    if complaint:
        raise PrtnetError(f"export: glslang refuses the shader: {complaint}")
    facts = _measured(job, points, trained, shader)
    if facts["error_max"] > verify.TOLERANCE:
        raise PrtnetError(
            f"export: the shader differs from the net by {facts['error_max']:.2g} in a coefficient, expected at most "
            f"{verify.TOLERANCE:g}; no shader was written"
        )
    facts |= {"macs": netspec.macs(trained.net), "bytes": netspec.byte_count(trained.net), "glsl_bytes": len(shader)}
    netspec.save(trained.net, job.out / "net.safetensors")
    store.write_text(job.out / "transfer.glsl", shader)
    store.write_text(job.out / "transfer.frag", whole)
    store.write_text(job.out / "export.json", json.dumps(facts, indent=1, sort_keys=True) + "\n")
    log.info("export: shader against NumPy: %.1e at most, %.1e on average", facts["error_max"], facts["error_mean"])
    return Exported(shader, facts)


def _measured(job: Job, points: NetPoints, trained: Trained, shader: str) -> dict[str, Any]:
    """The shader run against the NumPy twin at test points of this scene and at random points of the whole cube."""
    inputs = {"net": trained.key, "shader": shader, "points": CHECKED_POINTS}

    def make() -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        rng = job.rng("export")
        positions, normals = verify.random_points(CHECKED_POINTS, rng)
        few = rng.permutation(len(points.areas.positions))[:CHECKED_POINTS]
        positions = np.concatenate([positions, points.areas.positions[few]])
        normals = np.concatenate([normals, points.areas.normals[few]])
        error = verify.glsl_error(trained.net, shader, positions, normals)
        return {}, {"error_max": error.highest, "error_mean": error.mean, "driver": gl.context().info["GL_RENDERER"]}

    return dict(job.store.make("export", inputs, make).facts)


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
