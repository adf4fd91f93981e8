"""Texture sets: an atlas of its own for each part of a scene, as PRTT has one for each object, at equal memory.

Dhawal, Aakash KT and Narayanan 2022, *PRTT: Precomputed Radiance Transfer Textures*. A part gets texels by its share of
the area, both sides counted; one whose charts do not fit gets more, and the largest parts what is left.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace
from math import isqrt

import numpy as np
from jaxtyping import Float32, Int, Int32

from prtnet import PrtnetError, gl
from prtnet.data import atlas as atlases
from prtnet.data.atlas import Atlas
from prtnet.data.scene import Scene
from prtnet.data.unwrap import DoesNotFit

log = logging.getLogger(__name__)
Array = np.ndarray

SETS = ("one", "parts")
LEAST_SIDE, STEP = 16, 4
# texels along a side, and layers that the least number of uniforms and of array layers suffices for
EVERYWHERE = (1024, 64)


def check(sets: str) -> None:
    """Raises PrtnetError, naming the configuration's key, for a choice that there is not."""
    if sets not in SETS:
        raise PrtnetError(f"atlas.sets: found {sets!r}, expected one of {', '.join(SETS)}")


def check_limits(size: int, coefficients: int, texel_bytes: int, limit_gib: float, groups: int = 1) -> None:
    """Raises PrtnetError, naming key and limit, for textures that this driver or `limit_gib` has no room for."""
    needed = groups * gl.layer_count(coefficients)
    # the driver is not started for what every OpenGL 3.3 can do
    small = size <= EVERYWHERE[0] and needed <= EVERYWHERE[1]
    side, layers, matrices = (size, needed, needed) if small else gl.largest_texture()
    if size > side:
        raise PrtnetError(f"atlas.size: found {size}, expected at most {side} (GL_MAX_TEXTURE_SIZE of this driver)")
    for limit, name in ((layers, "GL_MAX_ARRAY_TEXTURE_LAYERS"), (matrices, "GL_MAX_FRAGMENT_UNIFORM_COMPONENTS / 16")):
        if needed > limit:
            most = isqrt(4 * limit // groups)
            raise PrtnetError(
                f"transfer.bands: found {isqrt(coefficients)}, which takes {needed} layers of 4 coefficients; expected "
                f"at most {most} bands in a shader, {limit} layers ({name} of this driver)"
            )
    gib = size * size * 4 * needed * texel_bytes / 2**30
    if gib > limit_gib:
        raise PrtnetError(
            f"atlas.size: found {size}, which takes {gib:.1f} GiB for {coefficients} coefficients of {texel_bytes} "
            f"bytes; expected at most atlas.memory_limit, {limit_gib:g} GiB"
        )


def make(scene: Scene, *, size: int, single_chart: bool, unwrap_mode: str, padding: int) -> Atlas:
    """An atlas with a page for each part, of `size`^2 texels together at the most.

    Sides are multiples of 4, at least 16. Parts get their pages from the smallest to the largest. Raises PrtnetError
    as `atlas.make`, and when the texels do not suffice.
    """
    areas = np.bincount(scene.part, scene.face_areas * (1 + scene.two_sided), len(scene.materials))
    found: dict[int, tuple[Atlas, Array]] = {}
    sides = [0] * len(areas)
    texels, area = size * size, float(areas.sum())
    for part in np.argsort(areas, kind="stable").tolist():
        share = areas[part] / area if area > 0 else 1.0
        faces = np.flatnonzero(scene.part == part)
        wanted = max(LEAST_SIDE, STEP * int(np.sqrt(texels * share) / STEP))
        # the smallest pages leave room for the least page of all the others
        rest = texels - LEAST_SIDE**2 * (len(areas) - len(found) - 1)
        options = {"single_chart": single_chart, "unwrap_mode": unwrap_mode, "padding": padding}
        made, sides[part] = _fitted(_only(scene, faces), wanted, rest, size, options)
        found[part] = made, faces
        texels, area = texels - sides[part] ** 2, area - areas[part]
    log.info("atlas: %d pages of %s texels along a side", len(sides), ", ".join(map(str, sides)))
    return _joined(scene, [found[part] for part in range(len(areas))], tuple(sides))


def _fitted(part: Scene, side: int, rest: int, size: int, options: dict) -> tuple[Atlas, int]:
    """The atlas of one part with the least side from `side` on that its charts fit into."""
    while side * side <= rest:
        try:
            return atlases.make(part, size=side, **options), side
        except DoesNotFit as error:
            log.info("%s: %s", part.name, error)
            side += max(STEP, side // 4 // STEP * STEP)
    raise PrtnetError(
        f"{part.name}: its page does not fit into what atlas.size={size} leaves it, {max(rest, 0)} texels; expected a "
        "larger atlas.size, or atlas.sets=one"
    )


def _only(scene: Scene, faces: Int[Array, " f"]) -> Scene:
    """The scene of some faces, with its own vertices."""
    used, corner = np.unique(scene.faces[faces], return_inverse=True)
    number = int(scene.part[faces[0]])
    return replace(
        scene,
        name=f"{scene.name}, part {scene.materials[number].name}",
        vertices=scene.vertices[used],
        normals=scene.normals[used],
        uv=None if scene.uv is None else scene.uv[used],
        tangents=None if scene.tangents is None else scene.tangents[used],
        faces=corner.reshape(-1, 3).astype(np.int32),
        part=scene.part[faces],
        two_sided=scene.two_sided[faces],
        face_origin=None if scene.face_origin is None else scene.face_origin[faces],
    )


def _joined(scene: Scene, made: Sequence[tuple[Atlas, Int[Array, " _"]]], sides: tuple[int, ...]) -> Atlas:
    """The atlases of the parts as one, with the faces in the order of scene.split_sides()."""
    scenes = [atlas.scene for atlas, _ in made]
    starts = np.cumsum([0] + [len(part.vertices) for part in scenes[:-1]])
    behind = len(scene.faces) + np.cumsum(scene.two_sided) - 1
    place = np.concatenate([np.concatenate([faces, behind[faces[scene.two_sided[faces]]]]) for _, faces in made])
    origins = [faces[np.asarray(atlas.scene.face_origin)] for atlas, faces in made]
    split = replace(
        scene,
        vertices=np.concatenate([part.vertices for part in scenes]),
        normals=np.concatenate([part.normals for part in scenes]),
        uv=None if scene.uv is None else np.concatenate([part.uv for part in scenes if part.uv is not None]),
        tangents=None if scene.tangents is None else np.concatenate([np.asarray(part.tangents) for part in scenes]),
        faces=_at(place, np.concatenate([part.faces + start for part, start in zip(scenes, starts, strict=True)])),
        part=_at(place, np.concatenate([part.part for part in scenes])),
        two_sided=np.zeros(len(place), bool),
        face_origin=_at(place, np.concatenate(origins)),
    )
    sources = sorted({atlas.source for atlas, _ in made})
    overlaps = [atlas.overlap for atlas, _ in made]
    overlap = np.nan if np.isnan(overlaps).any() else max(overlaps)
    uv: Float32[Array, "v 2"] = np.concatenate([atlas.uv for atlas, _ in made])
    return Atlas(split, uv, " and ".join(sources), float(overlap), sides)


def _at(place: Int[Array, " f"], rows: Int[Array, "f *c"]) -> Int32[Array, "f *c"]:
    out = np.empty(rows.shape, np.int32)
    out[place] = rows
    return out
