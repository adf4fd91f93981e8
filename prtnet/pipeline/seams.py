"""Seams of a run with clusters: the metric of every method on the same borders, and the picture clusters.png."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from PIL import Image

from prtnet import score, seam, store
from prtnet.clusters import ClusterSpec
from prtnet.pipeline.job import Job
from prtnet.pipeline.views import View
from prtnet.render.clusters import shares
from prtnet.render.raster import Raster
from prtnet.seam import Surface

Array = np.ndarray

PICTURE = "clusters.png"
ERRORS = 8  # times as bright as the picture
_GOLDEN = 0.618034  # of the hue circle from one cluster to the next


def surfaces(job: Job, spec: ClusterSpec, drawing: Raster, views: Sequence[View]) -> list[Surface]:
    """What the pixels of each view show, and in which cluster."""
    options, found = job.config.split, []
    for view in views:
        share, covered = shares(spec, drawing.scene, view.gbuffer, options.border, options.select), view.covered
        shape = covered.shape
        images = [np.zeros((*shape, 3)), np.zeros((*shape, 3)), np.full(shape, -1)]
        values = (view.gbuffer.positions, view.gbuffer.normals, share.argmax(axis=1))
        for image, each in zip(images, values, strict=True):
            image.reshape(covered.size, *image.shape[2:])[view.gbuffer.pixel] = each
        images[2][~covered] = -1
        found.append(Surface(images[0], images[1], images[2]))
    return found


def seams(
    places: Sequence[Surface], frames: Mapping[str, Sequence[Array]], exposure: float, methods: Sequence[str]
) -> dict[str, Any]:
    """By method: `seam.Seams.facts` of its pictures against `traced`."""
    shown = {name: [score.tone_map(each, exposure) for each in frames[name]] for name in (*methods, "traced")}
    errors = {
        name: [a.astype(np.float64) - b for a, b in zip(shown[name], shown["traced"], strict=True)] for name in methods
    }
    return {name: found.facts() for name, found in seam.measure(errors, places).items()}


def words(found: Mapping[str, Any]) -> dict[str, str]:
    """For the report: a line for each method."""
    said = {}
    for name, each in found.items():
        if each["worst"] is None:
            said[f"seams of {name}"] = "no border is long enough in these views"
            continue
        worst = max(each["borders"], key=lambda border: border["ratio"])
        pair = " and ".join(str(index) for index in worst["clusters"])
        said[f"seams of {name}"] = (
            f"errors jump {each['mean']:.2f} times as far across borders as beside them, at worst"
            f" {each['worst']:.2f} times, between clusters {pair}"
        )
    return said


def write_picture(
    path: Path, shown: Float[Array, "h w 3"], reference: Float[Array, "h w 3"], cluster: Int[Array, "h w"]
) -> None:
    """The clusters in false colours over a view, and the method's error beside it, both tone-mapped."""
    grey = reference.astype(np.float64).mean(axis=2, keepdims=True)
    tinted = np.where(cluster[..., None] < 0, grey, (0.25 + 0.75 * grey) * colours(cluster))
    error = np.clip(ERRORS * np.abs(shown.astype(np.float64) - reference), 0, 1)
    image = np.rint(255 * np.clip(np.concatenate([tinted, error], axis=1), 0, 1)).astype(np.uint8)
    with store.atomic(path) as temporary:
        Image.fromarray(image).save(temporary, format="PNG")


def colours(cluster: Int[Array, "h w"]) -> Float[Array, "h w 3"]:
    """Of neighbouring numbers as different as hues can be."""
    hue = 6 * ((cluster * _GOLDEN) % 1)[..., None]
    return 0.35 + 0.65 * np.clip(np.abs((hue + np.array([0.0, 4.0, 2.0])) % 6 - 3) - 1, 0, 1)
