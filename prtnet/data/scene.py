"""Scenes: triangles, shading normals, parts with materials, and the frame that centres them.

Coordinates are right-handed with y up, in the file's units, float64. `Scene.centred()` moves them into [-1, 1]^3, where
everything after loading works.
"""

import hashlib
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int32

from prtnet import PrtnetError
from prtnet.data.meshfile import read
from prtnet.data.normals import crease_normals, face_cross, unit
from prtnet.data.part import GREY, Part
from prtnet.data.repair import repair
from prtnet.data.tangent import vertex_tangents

log = logging.getLogger(__name__)
Array = np.ndarray

# of the area, above which a part is worth a warning
LARGEST_SHARE = 0.95


@dataclass(frozen=True, eq=False)
class Frame:
    """A uniform scale and a centre, kept in float64: unit = (p - centre) * scale."""

    centre: Float64[Array, " 3"]
    scale: float

    def to_unit(self, positions: Float[Array, "*n 3"]) -> Float64[Array, "*n 3"]:
        """Scene coordinates to unit coordinates. Inverse: `from_unit`."""
        return (np.asarray(positions, np.float64) - self.centre) * self.scale

    def from_unit(self, positions: Float[Array, "*n 3"]) -> Float64[Array, "*n 3"]:
        """Unit coordinates to scene coordinates. Inverse: `to_unit`."""
        return np.asarray(positions, np.float64) / self.scale + self.centre


IDENTITY = Frame(np.zeros(3), 1.0)


def frame_of(vertices: Float[Array, "v 3"]) -> Frame:
    """The frame whose longest axis fills [-1, 1]."""
    low, high = (np.asarray(bound, np.float64) for bound in (vertices.min(axis=0), vertices.max(axis=0)))
    return Frame(low + (high - low) / 2, float(2 / (high - low).max()))


@dataclass(frozen=True, eq=False)
class Material:
    """A diffuse surface: `albedo` (linear RGB) times the texture where there is one."""

    name: str
    albedo: Float32[Array, " 3"] = field(default_factory=lambda: np.full(3, GREY, np.float32))
    # linear RGB; row 0 is the top of the image (v = 1)
    texture: Float32[Array, "h w 3"] | None = None
    # of the file, 0 to 1, and what multiplies it; None where it has none
    roughness: float | None = None
    roughness_map: Float32[Array, "h w"] | None = None
    # vectors in tangent space, x along u, y along v upwards
    normal_map: Float32[Array, "_ _ 3"] | None = None


@dataclass(frozen=True, eq=False)
class Scene:
    """Triangles with shading normals; every face belongs to one part, and every part has one material."""

    name: str
    vertices: Float64[Array, "v 3"]
    faces: Int32[Array, "f 3"]
    # unit shading normals
    normals: Float32[Array, "v 3"]
    # v up, as in OpenGL
    uv: Float32[Array, "v 2"] | None
    # index into `materials`
    part: Int32[Array, " f"]
    two_sided: Bool[Array, " f"]
    materials: tuple[Material, ...]
    # scene coordinates to [-1, 1]^3
    frame: Frame
    # where the scene wants to be seen from: "orbit", "inside" or "auto"
    camera: str = "auto"
    # after `split_sides`: the face of the unsplit scene that each face comes from
    face_origin: Int32[Array, " f"] | None = None
    # of the vertices, multiplies the materials'; below 0 where the file has none, None where it has none at all
    roughness: Float32[Array, " v"] | None = None
    # unit, with the sign of the bitangent; 0 where a part has no normal map; None where no part has one
    tangents: Float32[Array, "v 4"] | None = None

    @cached_property
    def face_normals(self) -> Float64[Array, "f 3"]:
        """Unit geometric normals, by the right-hand rule."""
        return unit(face_cross(self.vertices, self.faces))

    @cached_property
    def face_areas(self) -> Float64[Array, " f"]:
        """Areas of one side, in squared scene units."""
        return np.linalg.norm(face_cross(self.vertices, self.faces), axis=1) / 2

    def centred(self) -> "Scene":
        """The same scene in unit coordinates, with the identity frame."""
        if self.frame is IDENTITY:
            return self
        return replace(self, vertices=self.frame.to_unit(self.vertices), frame=IDENTITY)

    def split_sides(self) -> "Scene":
        """Every two-sided face as two one-sided faces.

        The back copies stand after all front faces, with vertices of their own, reversed winding and negated normals.
        """
        back = np.flatnonzero(self.two_sided)
        origin = np.arange(len(self.faces), dtype=np.int32) if self.face_origin is None else self.face_origin
        if not len(back):
            return self if self.face_origin is not None else replace(self, face_origin=origin)
        used, corner = np.unique(self.faces[back], return_inverse=True)
        behind = corner.reshape(-1, 3)[:, ::-1] + len(self.vertices)
        return replace(
            self,
            vertices=np.concatenate([self.vertices, self.vertices[used]]),
            normals=np.concatenate([self.normals, -self.normals[used]]),
            uv=None if self.uv is None else np.concatenate([self.uv, self.uv[used]]),
            roughness=None if self.roughness is None else np.concatenate([self.roughness, self.roughness[used]]),
            faces=np.concatenate([self.faces, behind]).astype(np.int32),
            part=np.concatenate([self.part, self.part[back]]),
            two_sided=np.zeros(len(self.faces) + len(back), bool),
            face_origin=np.concatenate([origin, origin[back]]),
            # the same relief from behind: n' turns with n
            tangents=None if self.tangents is None else np.concatenate([self.tangents, -self.tangents[used]]),
        )

    def digest(self) -> str:
        """sha256 of everything but the name: the content key of the scene."""
        total = hashlib.sha256()
        # what most scenes lack does not stand in their digest
        apart = {"name", "materials", "frame", "roughness", "tangents"}
        values = [getattr(self, f.name) for f in fields(self) if f.name not in apart]
        values += [self.frame.centre, self.frame.scale]
        for material in self.materials:
            values += [material.name, material.albedo, material.texture]
            values += [v for v in (material.roughness, material.roughness_map) if v is not None]
        values += [] if self.roughness is None else [self.roughness]
        if self.tangents is not None:
            values += [self.tangents, *(material.normal_map for material in self.materials)]
        for value in values:
            head = f"{value.dtype} {value.shape}" if isinstance(value, Array) else repr(value)
            total.update(head.encode() + b"\n")
            if isinstance(value, Array):
                total.update(np.ascontiguousarray(value).tobytes())
        return total.hexdigest()


def load(
    path: str | Path,
    *,
    two_sided: str = "auto",
    name: str | None = None,
    without: Sequence[str] = (),
    normal_maps: Mapping[str, Array] | None = None,
) -> Scene:
    """The scene of a mesh file (OBJ, PLY, STL, OFF, glTF, GLB) or of a folder of them, in the file's coordinates.

    `two_sided`: "auto" (glTF's doubleSided; in other formats a part that is not closed), "all" or "none". Degenerate
    and duplicate triangles are dropped with a count in the log, missing normals are computed. `without` names parts
    (materials) to leave out: a sea of a thousand times the area takes a thousand times the samples.
    `normal_maps` gives parts normal maps, or others than the file does.
    Raises PrtnetError, with the name of the file, for whatever cannot be drawn.
    """
    path = Path(path)
    found = read(path)
    names = [part.name for part in found]
    unknown = set(without) - set(names)
    if unknown:
        raise PrtnetError(f"{path}: scene.without: found {sorted(unknown)}, expected some of {names}")
    kept = [part for part in found if part.name not in without]
    if not kept:
        raise PrtnetError(f"{path}: scene.without leaves no part out of {names}, expected at least one")
    maps = normal_maps or {}
    if set(maps) - set(names):
        raise PrtnetError(
            f"{path}: scene.normal_maps: found {sorted(set(maps) - set(names))}, expected some of {names}"
        )
    kept = [replace(part, normal_map=maps.get(part.name, part.normal_map)) for part in kept]
    scene = assemble(name or path.stem, repair(kept, two_sided=two_sided, source=str(path)), source=str(path))
    _report(scene, path)
    return scene


def _report(scene: Scene, path: Path) -> None:
    log.info(
        "%s: %d triangles (%d two-sided), %d parts, size %s",
        path,
        len(scene.faces),
        scene.two_sided.sum(),
        len(scene.materials),
        " x ".join(f"{extent:.4g}" for extent in np.ptp(scene.vertices, axis=0)),
    )
    share = np.bincount(scene.part, scene.centred().face_areas, len(scene.materials))
    largest, share = int(share.argmax()), share.max() / share.sum()
    if len(scene.materials) > 1 and share > LARGEST_SHARE:
        message = (
            "%s: part %s holds %.2f %% of the area and gets that share of the samples; scene.without leaves it out"
        )
        log.warning(message, path, scene.materials[largest].name, 100 * share)


def assemble(name: str, parts: Sequence[Part], *, camera: str = "auto", source: str | None = None) -> Scene:
    """One scene from parts, each with its own material. Missing normals are computed, missing uv become zero.

    `source` names the file in messages. Raises PrtnetError for a normal map on a part that can have no tangents.
    """
    if camera not in ("auto", "orbit", "inside"):
        raise PrtnetError(f"{name}: camera: found {camera!r}, expected auto, orbit or inside")
    if not sum(len(part.faces) for part in parts):
        raise PrtnetError(f"{name}: no triangles found, expected at least one")
    parts = [part if part.normals is not None else _with_normals(part) for part in parts]
    parts, tangents = zip(*(_with_tangents(part, source or name) for part in parts), strict=True)
    mapped = any(part.normal_map is not None for part in parts)
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    sizes = [len(part.faces) for part in parts]
    vertices = np.concatenate([part.vertices for part in parts]).astype(np.float64)
    textured = any(part.uv is not None for part in parts)
    coordinates = [np.zeros((len(part.vertices), 2)) if part.uv is None else part.uv for part in parts]
    return Scene(
        name=name,
        vertices=vertices,
        faces=np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]).astype(np.int32),
        normals=np.concatenate([part.normals for part in parts if part.normals is not None]).astype(np.float32),
        uv=np.concatenate(coordinates).astype(np.float32) if textured else None,
        part=np.repeat(np.arange(len(parts), dtype=np.int32), sizes),
        two_sided=np.concatenate([_sides(part) for part in parts]),
        materials=tuple(_material(part) for part in parts),
        frame=frame_of(vertices),
        camera=camera,
        roughness=_roughness(parts),
        tangents=np.concatenate(tangents) if mapped else None,
    )


def _roughness(parts: Sequence[Part]) -> Float32[Array, " v"] | None:
    """Of all vertices, -1 in parts that have none."""
    if all(part.roughness is None for part in parts):
        return None
    found = [np.full(len(part.vertices), -1.0) if part.roughness is None else part.roughness for part in parts]
    return np.concatenate(found).astype(np.float32)


def _sides(part: Part) -> Bool[Array, " f"]:
    return np.broadcast_to(np.asarray(False if part.two_sided is None else part.two_sided), len(part.faces))


def _material(part: Part) -> Material:
    texture = None if part.texture is None else np.asarray(part.texture, np.float32)
    rough, normal_map = (
        None if image is None else np.asarray(image, np.float32) for image in (part.roughness_map, part.normal_map)
    )
    return Material(part.name, np.asarray(part.albedo, np.float32), texture, part.roughness_factor, rough, normal_map)


def _with_normals(part: Part) -> Part:
    source, faces, normals = crease_normals(part.vertices, part.faces, part.uv)
    uv = None if part.uv is None else part.uv[source]
    rough = None if part.roughness is None else part.roughness[source]
    return replace(part, vertices=part.vertices[source], faces=faces, normals=normals, uv=uv, roughness=rough)


def _with_tangents(part: Part, source: str) -> tuple[Part, Float32[Array, "v 4"]]:
    """The part with vertices split where its coordinates are mirrored, and their tangents; 0 without a normal map."""
    if part.normal_map is None:
        return part, np.zeros((len(part.vertices), 4), np.float32)
    assert part.normals is not None
    if part.uv is None:
        raise PrtnetError(
            f"{source}: part {part.name} has a normal map but no texture coordinates, expected some: its tangents "
            "follow from them"
        )
    at, faces, tangents = vertex_tangents(part.vertices, part.faces, part.normals, part.uv)
    without = int(np.sum(~tangents[:, :3].any(axis=1)))
    if without == len(tangents):
        raise PrtnetError(
            f"{source}: part {part.name} has a normal map but no tangents: its texture coordinates have no area, "
            "expected coordinates laid out over an image"
        )
    if without:
        log.warning("%s: %s: %d of %d vertices have no tangent: smooth there", source, part.name, without, len(at))
    rough = None if part.roughness is None else part.roughness[at]
    split = replace(
        part, vertices=part.vertices[at], faces=faces, normals=part.normals[at], uv=part.uv[at], roughness=rough
    )
    return split, tangents
