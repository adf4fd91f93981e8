"""Cut surfaces into charts and pack them into one square page, with xatlas.

Charts: LSCM (Levy et al. 2002, *Least Squares Conformal Maps for Automatic Texture Atlas Generation*). xatlas only
approximates a wanted page size, so its charts are packed again, which is cheap, at scales that close in on it.
"""

import logging
import time
from collections.abc import Sequence

import numpy as np
import xatlas
from jaxtyping import Bool, Float, Float32, Int

from prtnet import PrtnetError

log = logging.getLogger(__name__)
Array = np.ndarray

# xatlas leaves this many texels around each chart, so about twice as many between two. A bilinear look-up inside a
# chart reaches the texels it touches and one ring, which 1 keeps apart from the other charts' touched texels.
PADDING = 1
# xatlas takes edges below 1e-4 and areas below 1e-7 for degenerate: it gets unit coordinates times this
ENLARGE = 1000
# page sizes this close to the wanted one end the search
CLOSE = 0.985
TRIES = 10


class DoesNotFit(PrtnetError):
    """The page is too small for the charts."""


def charts(
    vertices: Float[Array, "v 3"],
    normals: Float[Array, "v 3"],
    sheets: Sequence[Int[Array, "_ 3"]],
    size: int,
    padding: int = PADDING,
) -> Float32[Array, "f 3 2"]:
    """Texture coordinates of the corners of all faces, sheet after sheet; sheets never share a chart.

    Chart offsets are whole texels of a `size`^2 page. Raises PrtnetError when the charts do not fit.
    """
    start = time.perf_counter()
    atlas = xatlas.Atlas()
    for faces in sheets:
        used, corner = np.unique(faces, return_inverse=True)
        atlas.add_mesh(
            (ENLARGE * vertices[used]).astype(np.float32),
            corner.reshape(-1, 3).astype(np.uint32),
            normals[used].astype(np.float32),
        )
    atlas.generate(xatlas.ChartOptions(), _packing(padding, resolution=size))
    pages = [_corners(atlas, mesh, len(faces)) for mesh, faces in enumerate(sheets)]
    placed = np.concatenate([page[1] for page in pages])
    corners, kept, packed = _fit(np.concatenate([page[0] for page in pages])[placed], size, padding)
    placed[placed] = kept
    if not placed.any():
        raise DoesNotFit(f"atlas: xatlas placed none of {len(placed)} faces, expected at least one")
    log.info(
        "atlas: %d faces in %d charts on %d x %d texels, %.1f s",
        len(placed), packed.chart_count, packed.width, packed.height, time.perf_counter() - start,
    )  # fmt: skip
    return _fill(vertices[np.concatenate(sheets)], placed, corners[kept] / np.float32(size))


def _packing(padding: int, *, resolution: int = 0, texels_per_unit: float = 0) -> xatlas.PackOptions:
    options = xatlas.PackOptions()
    options.padding, options.resolution, options.texels_per_unit = padding, resolution, texels_per_unit
    options.bilinear = False
    return options


def _corners(atlas: xatlas.Atlas, mesh: int, count: int) -> tuple[Float32[Array, "f 3 2"], Bool[Array, " f"]]:
    """Corners of a mesh's faces in texels, and which faces were placed (not the degenerate ones)."""
    _, faces, uv = atlas.get_mesh(mesh)
    page, _ = atlas.get_mesh_vertex_assignment(mesh)
    corners = (uv * np.array([atlas.width, atlas.height], np.float32))[faces]
    return corners.reshape(count, 3, 2), (page[faces] == 0).all(axis=1) & (uv_areas(corners) > 0)


def _fit(
    corners: Float32[Array, "f 3 2"], size: int, padding: int
) -> tuple[Float32[Array, "f 3 2"], Bool[Array, " f"], xatlas.Atlas]:
    """Pack laid out charts again until the page is just under `size` wide and high."""
    best, best_scale, history, scale = None, 0.0, [], 1.0
    while len(history) < TRIES:
        packed = _pack(corners, scale, padding)
        side = max(packed.width, packed.height)
        history.append((scale, side))
        if packed.atlas_count == 1 and side <= size and scale > best_scale:
            best, best_scale = packed, scale
            if side >= CLOSE * size:
                break
        scale = _next_scale(history, best_scale, size)
    if best is None:
        raise DoesNotFit(
            f"atlas: {len(corners)} faces in charts do not fit, found atlas.size {size}, "
            f"expected about {history[-1][1]}"
        )
    return *_corners(best, 0, len(corners)), best


def _pack(corners: Float32[Array, "f 3 2"], scale: float, padding: int) -> xatlas.Atlas:
    # the charts are told apart by shared vertices
    points, index = np.unique(corners.reshape(-1, 2), axis=0, return_inverse=True)
    atlas = xatlas.Atlas()
    atlas.add_uv_mesh(points, index.reshape(-1, 3).astype(np.uint32))
    atlas.generate(xatlas.ChartOptions(), _packing(padding, texels_per_unit=scale))
    return atlas


def _next_scale(history: list[tuple[float, int]], best: float, size: int) -> float:
    """The page's side is about a straight line over the scale, since padding adds a constant per chart."""
    scale, side = history[-1]
    guess = scale * (size - 0.5) / side
    if len(history) > 1 and (slope := (side - history[-2][1]) / (scale - history[-2][0])) > 0:
        guess = scale + (size - 0.5 - side) / slope
    too_large = min([tried for tried, reached in history if reached > size], default=2 * scale)
    # a line through two noisy points may point anywhere: stay between what fits and what does not
    return min(max(guess, best + 0.1 * (too_large - best)), best + 0.9 * (too_large - best))


def _fill(
    corner_positions: Float[Array, "f 3 3"], placed: Bool[Array, " f"], uv: Float32[Array, "p 3 2"]
) -> Float32[Array, "f 3 2"]:
    """Faces without a place, which have next to no area, take the place of the nearest face that has one."""
    out = np.empty((len(placed), 3, 2), np.float32)
    out[placed] = uv
    middle = corner_positions.mean(axis=1)
    for face in np.flatnonzero(~placed):
        nearest = np.argmin(np.sum((middle[placed] - middle[face]) ** 2, axis=1))
        out[face] = uv[nearest].mean(axis=0)
    if not placed.all():
        log.info("atlas: %d of %d faces too small to unwrap; each uses its neighbour's", np.sum(~placed), len(placed))
    return out


def uv_areas(corners: Float[Array, "f 3 2"]) -> Float[Array, " f"]:
    """Areas of triangles in the plane."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
