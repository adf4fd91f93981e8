"""Part of stage `export`: the networks of a scene's clusters in the folder `clusters`, as files and as GLSL.

clusters.json        which network counts how much where, and their files, net_00.safetensors, ...
clusters.glsl        prt_cluster_weights and prt_cluster_position
transfer_00.glsl     prt_transfer of each network, of positions in the cluster's own cube; transfer_00.bin: the image of
                     its weight texture, where it has one
stack.glsl           with split.select=fragment: all networks as one prt_transfer of the scene's positions; stack.bin
00/transfer.cu       with export.cuda: the kernels of each network, and transfer_cuda.bin, the numbers that they read
certificate.json     the error of each against NumPy, and checksums
"""

import hashlib
import logging
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError, clusters, store
from prtnet.clusters import ClusterSpec
from prtnet.export import certificate, cuda_file, form
from prtnet.export import clusters as spelt
from prtnet.export.bundle import Bundle
from prtnet.export.clusters import Stack
from prtnet.pipeline import cuda, drawn_by
from prtnet.pipeline.bake import NetPoints, PointSet
from prtnet.pipeline.candidates import form_of
from prtnet.pipeline.clusters import ClustersTrained
from prtnet.pipeline.job import Job
from prtnet.render import certify, cluster_check, verify

log = logging.getLogger(__name__)
Array = np.ndarray

FOLDER = "clusters"
CHECKED_POINTS, CHECKED_IN_TEXTURES = 1 << 12, 1 << 10  # of each cube, and at most as many of its cluster


@dataclass(frozen=True, eq=False)
class ClustersExported:
    """What methods draw: the shaders of each network, or all in one."""

    spec: ClusterSpec  # with the weights that the shaders have
    made: tuple[Bundle, ...]
    stack: Stack | None
    drawn_by: str
    key: str
    facts: Mapping[str, Any]  # of the training


def export_clusters(job: Job, points: NetPoints, trained: ClustersTrained) -> ClustersExported:
    """Write the folder. Raises PrtnetError, and leaves nothing of it behind, when an error is above its bound."""
    folder, options = job.out / FOLDER, job.config.split
    try:
        made = [drawn_by.shaders(net, form_of(job.config)) for net in trained.spec.nets]
        bundles = tuple(each for each, _ in made)
        spec = replace(trained.spec, nets=tuple(each.net for each in bundles))
        stack = None
        if options.select == "fragment":
            stack = spelt.stacked(trained.spec, bundles[0].form, drawn_by.driver(), blended=options.border == "clip")
        measured = _measured(job, points.areas, trained, spec, bundles, stack)
        certificate.refuse(measured["errors"])
        in_cuda, kernels = _kernels(job, trained)
    except PrtnetError:
        _remove(folder)
        raise
    _remove(folder)
    clusters.save(trained.spec, folder)
    files = _files(spec, bundles, stack)
    for name, data in (files | kernels).items():
        store.write_bytes(folder / name, data)
    each = [{"net": certificate.of_net(net)} for net in trained.spec.nets]
    facts = {"clusters": each, "form": asdict(bundles[0].form), "select": options.select, "border": options.border}
    facts |= measured | in_cuda
    written = [clusters.FILE, *files, *kernels, *(path.name for path in sorted(folder.glob("net_*.safetensors")))]
    certificate.write(folder, facts, written)
    words = "; ".join(f"{what} {each['max']:.1e}" for what, each in measured["errors"].items())
    log.info("export: %d clusters in %s; errors at most: %s", len(bundles), folder, words)
    largest = max(spec.nets, key=lambda net: form.padded_macs_of(form.sizes_of(net), net.groups))
    by = drawn_by.chosen(job.config.render.net, largest)
    key = store.content_key({"trained": trained.key, "files": _digest(files), "by": by, "border": options.border})
    return ClustersExported(spec, bundles, stack, by, key, trained.facts)


def _files(spec: ClusterSpec, made: tuple[Bundle, ...], stack: Stack | None) -> dict[str, bytes]:
    files = {"clusters.glsl": spelt.functions(spec).encode()}
    for index, each in enumerate(made):
        files[f"transfer_{index:02d}.glsl"] = each.transfer.encode()
        if each.weights is not None:
            files[f"transfer_{index:02d}.bin"] = each.weights.tobytes()
    if stack:
        files |= {"stack.glsl": stack.text.encode(), "stack.bin": stack.weights.tobytes()}
    return files


def _kernels(job: Job, trained: ClustersTrained) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The entry `cuda` of a certificate, a list, and the files; both empty where none are wanted."""
    if not job.config.export.cuda:
        return {}, {}
    entries, found = [], {}
    for index, (net, facts) in enumerate(zip(trained.spec.nets, trained.facts["clusters"], strict=True)):
        points = certify.Points(*verify.random_points(CHECKED_IN_TEXTURES, job.rng("export")), None)
        entry, files = cuda.measured(job, net, facts["key"], CHECKED_IN_TEXTURES, lambda points=points: points)
        entries.append(entry)
        found |= {f"{index:02d}/{name}": data for name, data in files.items()}
    return {"cuda": entries}, found


def _digest(files: Mapping[str, bytes]) -> str:
    return hashlib.sha256(b"".join(files[name] for name in sorted(files))).hexdigest()


def _remove(folder: Path) -> None:
    """An earlier export: its certificate first."""
    kinds = ("*.glsl", "*.bin", "net_*.safetensors", *(f"[0-9]*/{name}" for name in cuda_file.NAMES))
    names = [str(path.relative_to(folder)) for kind in kinds for path in folder.glob(kind)]
    certificate.remove(folder, [clusters.FILE, *names])


def _measured(
    job: Job,
    areas: PointSet,
    trained: ClustersTrained,
    spec: ClusterSpec,
    made: tuple[Bundle, ...],
    stack: Stack | None,
) -> dict[str, Any]:
    """Each shader against its net in NumPy, at points of its cube and of its cluster; the weights, and all in one,
    against theirs at points of the scene."""
    count = CHECKED_POINTS if all(each.weights is None for each in made) else CHECKED_IN_TEXTURES
    inputs = {"clusters": trained.key, "shaders": _digest(_files(spec, made, stack)), "points": count}

    def make() -> tuple[dict[str, Array], dict[str, Any]]:
        rng = job.rng("export")
        few = np.sort(rng.permutation(len(areas.positions))[:count])
        positions, normals = areas.positions[few], areas.normals[few]
        part = None if areas.part is None else areas.part[few]
        share = clusters.weights(spec, positions, part)
        errors = {}
        for index, each in enumerate(made):
            own, turned = _within(spec, index, share, positions, normals)
            cube = verify.random_points(count, rng)
            points = [np.concatenate(pair) for pair in ((cube[0], own), (cube[1], turned))]
            errors[f"coefficients of {index:02d}"] = cluster_check.net_error(each, *points)
        if not spec.split.parts:
            errors["weights"] = cluster_check.weight_error(spec, positions)
        if stack:
            errors["coefficients of all in one"] = cluster_check.stack_error(
                spec, stack, positions, normals, blended=job.config.split.border == "clip"
            )
        return {}, {"executed": True, "errors": errors, "points": {"cube": count, "scene": len(few)}}

    return dict(job.store.make("export", inputs, make).facts)


def _within(
    spec: ClusterSpec, index: int, share: Array, positions: Array, normals: Array
) -> tuple[Float[Array, "m 3"], Float[Array, "m 3"]]:
    """The points of a cluster, in its own cube."""
    seen = share[:, index] > 0
    centre, scale = clusters.own_frame(spec, index)
    return ((positions[seen].astype(np.float64) - centre) * scale).astype(np.float32), normals[seen]
