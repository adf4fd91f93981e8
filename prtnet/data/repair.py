"""Triangles as they should be: degenerate and duplicate ones dropped, normals whole, sides known.

What is dropped or turned is logged with its count. Nothing here moves a vertex.
"""

import logging
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from prtnet import PrtnetError
from prtnet.data.normals import corner_angles, face_cross, unit, weld
from prtnet.data.part import Part

log = logging.getLogger(__name__)
Array = np.ndarray

# in units of the squared diagonal: below it a triangle is lost in float32
LEAST_DOUBLE_AREA = 1e-13
SIDES = ("auto", "all", "none")


def repair(parts: list[Part], *, two_sided: str, source: str) -> list[Part]:
    """Parts without degenerate and duplicate triangles, with unit normals (or None) and sides decided.

    `two_sided`: "auto" takes the file's word, and else a part that is not closed; "all"; "none". `source` names the
    file in messages. A duplicate of opposite winding makes the triangle that stays two-sided ("auto" and "all").
    """
    if two_sided not in SIDES:
        raise PrtnetError(f"scene.two_sided: found {two_sided!r}, expected one of {', '.join(SIDES)}")
    diagonal = np.linalg.norm(np.ptp(np.concatenate([part.vertices for part in parts]), axis=0))
    sound = _drop_degenerate(parts, float(diagonal), source)
    kept, twins = _drop_duplicates(sound, source)
    decided = [
        replace(part, two_sided=_sides(whole, part, twin, two_sided))
        for whole, part, twin in zip(sound, kept, twins, strict=True)
    ]
    return [_follow_normals(_whole_normals(_compact(part), source), source) for part in decided if len(part.faces)]


def _pick(part: Part, mask: Bool[Array, " f"]) -> Part:
    return replace(part, faces=part.faces[mask])


def _drop_degenerate(parts: list[Part], diagonal: float, source: str) -> list[Part]:
    if not diagonal > 0:
        raise PrtnetError(f"{source}: all vertices are in one point, expected a mesh with an extent")
    sizes = [np.linalg.norm(face_cross(part.vertices / diagonal, part.faces), axis=1) for part in parts]
    masks = [size > LEAST_DOUBLE_AREA for size in sizes]
    dropped, total = sum(int((~mask).sum()) for mask in masks), sum(map(len, masks))
    if dropped == total:
        raise PrtnetError(f"{source}: all {total} triangles are degenerate, expected at least one with an area")
    if dropped:
        log.warning("%s: %d degenerate triangles of %d dropped", source, dropped, total)
    return [_pick(part, mask) for part, mask in zip(parts, masks, strict=True)]


def _drop_duplicates(parts: list[Part], source: str) -> tuple[list[Part], list[Bool[Array, " f"]]]:
    """(parts with the last of equal triangles, as depth tests leave it; which had a twin of opposite winding)."""
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    _, position = weld(np.concatenate([part.vertices for part in parts]))
    corners = np.concatenate([position[part.faces + start] for part, start in zip(parts, starts, strict=False)])
    last, inverse, odd = _equal_triangles(corners)
    group_odd = np.bincount(inverse, odd) > 0
    group_even = np.bincount(inverse, ~odd) > 0
    keep = np.zeros(len(corners), bool)
    keep[last] = True
    twin = (group_odd & group_even)[inverse]
    dropped = int((~keep).sum())
    if dropped:
        log.warning("%s: %d duplicate triangles of %d dropped", source, dropped, len(corners))
    cuts = np.cumsum([len(part.faces) for part in parts])[:-1]
    masks, twins = np.split(keep, cuts), np.split(twin, cuts)
    return [_pick(part, mask) for part, mask in zip(parts, masks, strict=True)], [
        t[mask] for t, mask in zip(twins, masks, strict=True)
    ]


def _equal_triangles(
    corners: Int[Array, "f 3"],
) -> tuple[Int[Array, " g"], Int[Array, " f"], Bool[Array, " f"]]:
    """(last face of each set of equal corners, set of each face, whether its winding is an odd permutation)."""
    order = np.argsort(corners, axis=1, kind="stable")
    sets = np.take_along_axis(corners, order, axis=1)
    odd = (order[:, 1] - order[:, 0]) % 3 == 2
    rank = np.lexsort((np.arange(len(sets)), sets[:, 2], sets[:, 1], sets[:, 0]))
    fresh = np.ones(len(sets), bool)
    fresh[1:] = np.any(sets[rank[1:]] != sets[rank[:-1]], axis=1)
    inverse = np.empty(len(sets), np.int64)
    inverse[rank] = np.cumsum(fresh) - 1
    last = np.append(np.flatnonzero(fresh)[1:], len(sets)) - 1
    return rank[last], inverse, odd


def _sides(whole: Part, part: Part, twin: Bool[Array, " f"], rule: str) -> Bool[Array, " f"]:
    """Which faces of `part` are two-sided; `whole` still has its duplicates."""
    if rule != "auto":
        return np.full(len(part.faces), rule == "all")
    base = part.two_sided
    if base is None:
        base = not is_closed(whole.vertices, whole.faces)
    return np.broadcast_to(base, len(part.faces)) | twin


def is_closed(vertices: Float[Array, "v 3"], faces: Int[Array, "f 3"]) -> bool:
    """Whether every edge is used as often in one direction as in the other: no border, one consistent winding."""
    _, position = weld(vertices)
    start = position[faces].ravel()
    end = np.roll(position[faces], -1, axis=1).ravel()
    key = np.minimum(start, end) * (position.max(initial=0) + 1) + np.maximum(start, end)
    _, edge = np.unique(key, return_inverse=True)
    return not np.any(np.bincount(edge, np.where(start < end, 1.0, -1.0)))


def _compact(part: Part) -> Part:
    """Without the vertices that no face uses."""
    used, corner = np.unique(part.faces, return_inverse=True)
    normals = None if part.normals is None else part.normals[used]
    uv = None if part.uv is None else part.uv[used]
    faces = corner.reshape(-1, 3).astype(np.int32)
    rough = None if part.roughness is None else part.roughness[used]
    return replace(part, vertices=part.vertices[used], faces=faces, normals=normals, uv=uv, roughness=rough)


def _whole_normals(part: Part, source: str) -> Part:
    """Unit normals; the mean of the faces around stands in for those that are zero or not finite."""
    if part.normals is None:
        return part
    length = np.linalg.norm(np.nan_to_num(part.normals, posinf=0, neginf=0), axis=1)
    bad = ~np.isfinite(part.normals).all(axis=1) | (length < 1e-6)
    normals = unit(np.where(bad[:, None], 0, part.normals))
    if bad.any():
        log.warning("%s: %s: %d of %d normals are unusable and computed anew", source, part.name, bad.sum(), len(bad))
        normals[bad] = _mean_normals(part)[bad]
    return replace(part, normals=normals)


def _mean_normals(part: Part) -> Float[Array, "v 3"]:
    flat = unit(face_cross(part.vertices, part.faces))
    weighted = (corner_angles(part.vertices, part.faces)[..., None] * flat[:, None]).reshape(-1, 3)
    count, corner = len(part.vertices), part.faces.ravel()
    mean = unit(np.stack([np.bincount(corner, weighted[:, i], count) for i in range(3)], axis=1))
    some = np.zeros((count, 3))
    some[corner] = np.repeat(flat, 3, axis=0)
    return np.where(mean.any(axis=1, keepdims=True), mean, some)


def _follow_normals(part: Part, source: str) -> Part:
    """Faces whose three normals all point behind them are wound the other way: viewers trust the normals, too."""
    if part.normals is None:
        return part
    facing = np.einsum("fki,fi->fk", part.normals[part.faces], face_cross(part.vertices, part.faces))
    behind = (facing < 0).all(axis=1)
    if behind.any():
        log.info("%s: %s: %d of %d faces wound to match their normals", source, part.name, behind.sum(), len(behind))
    return replace(part, faces=np.where(behind[:, None], part.faces[:, ::-1], part.faces))
