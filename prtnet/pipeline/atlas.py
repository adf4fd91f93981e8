"""The atlas of a job: unwrapped once, kept as arrays."""

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from prtnet.config import AtlasOptions
from prtnet.data import atlas as atlases
from prtnet.data import atlas_set
from prtnet.data.atlas import Atlas
from prtnet.pipeline.job import Job

Array = np.ndarray

# keys of configurations that are in an artifact's inputs only where they say something else, so that what was baked
# before there was a choice is found again
DEFAULTS = {"sets": "one", "unwrap": "auto", "padding": 1}


# of atlases with mip levels that say nothing else: levels of half and a quarter of the side
MIPMAP_PADDING = 4


def padding_of(options: AtlasOptions) -> int:
    """Texels around each chart."""
    return options.padding or (MIPMAP_PADDING if options.mipmaps else DEFAULTS["padding"])


def inputs_of(job: Job) -> dict[str, Any]:
    """What the texels of the job's textures depend on."""
    options = job.config.atlas
    inputs = job.scene_key | {"size": options.size, "single_chart": options.single_chart, "seed": job.config.seed}
    values = {"sets": options.sets, "unwrap": options.unwrap, "padding": padding_of(options)}
    return inputs | {name: value for name, value in values.items() if value != DEFAULTS[name]}


def atlas_of(job: Job) -> tuple[Atlas, float]:
    """The atlas and the seconds it took: its mesh is kept as arrays, its materials come from the scene."""
    kept = job.store.make("atlas", inputs_of(job), lambda: _make(job))
    arrays, facts = kept.arrays, kept.facts
    mesh = replace(
        job.scene,
        vertices=arrays["vertices"],
        faces=arrays["faces"],
        normals=arrays["normals"],
        part=arrays["part"],
        uv=arrays.get("material_uv"),
        tangents=arrays.get("tangents"),
        roughness=arrays.get("roughness"),
        two_sided=np.zeros(len(arrays["faces"]), bool),
    )
    overlap = np.nan if facts["overlap"] is None else facts["overlap"]
    sides = tuple(facts["sides"]) if facts.get("sides") else None
    return Atlas(mesh, arrays["uv"], facts["source"], overlap, sides), facts["seconds"]


def _make(job: Job) -> tuple[dict[str, Array], Mapping[str, Any]]:
    options, start = job.config.atlas, time.perf_counter()
    make = atlas_set.make if options.sets == "parts" else atlases.make
    made = make(
        job.scene,
        size=options.size,
        single_chart=options.single_chart,
        unwrap_mode=options.unwrap,
        padding=padding_of(options),
    )
    mesh = made.scene
    arrays = {"vertices": mesh.vertices, "faces": mesh.faces, "normals": mesh.normals, "part": mesh.part}
    arrays |= {"uv": made.uv} | ({} if mesh.uv is None else {"material_uv": mesh.uv})
    arrays |= {} if mesh.tangents is None else {"tangents": mesh.tangents}
    arrays |= {} if mesh.roughness is None else {"roughness": mesh.roughness}
    overlap = None if np.isnan(made.overlap) else made.overlap
    facts = {"source": made.source, "overlap": overlap, "seconds": time.perf_counter() - start}
    return arrays, facts | ({} if made.sides is None else {"sides": made.sides})
