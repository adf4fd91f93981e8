"""Texture atlases: every point of every one-sided face gets a place of its own in [0, 1]^2.

A file's own coordinates serve where they already do that. Otherwise xatlas cuts the surface into charts and packs
them. Both sides of a two-sided face see different light, so each side gets its own chart.
"""

import logging
from dataclasses import dataclass, replace

import moderngl
import numpy as np
from jaxtyping import Float, Float32, Int, Int32

from prtnet import PrtnetError, gl
from prtnet.data import unwrap
from prtnet.data.scene import Scene

log = logging.getLogger(__name__)
Array = np.ndarray

# rounding along shared edges hits a few texel centres twice
MAX_OVERLAP = 1e-3
UV_SLACK = 1e-6
UNWRAP = ("auto", "never")


@dataclass(frozen=True, eq=False)
class Atlas:
    """A scene ready to be baked into, and drawn from, a square texture."""

    # one-sided faces in the order of scene.split_sides().faces; a vertex has one place in the atlas and one part
    scene: Scene
    # in [0, 1], v up
    uv: Float32[Array, "v 2"]
    # "file" or "xatlas"
    source: str
    # fraction of the area the file's coordinates cover that they cover more than once; nan without coordinates
    overlap: float
    # texels along one side of each part's own texture; None where one texture holds the whole scene
    sides: tuple[int, ...] | None = None

    @property
    def page_of_face(self) -> Int32[Array, " f"]:
        """Which texture each face of `scene` reads: that of its part, or the only one."""
        return np.zeros_like(self.scene.part) if self.sides is None else self.scene.part


def make(
    scene: Scene,
    *,
    size: int,
    single_chart: bool = False,
    unwrap_mode: str = "auto",
    padding: int = unwrap.PADDING,
) -> Atlas:
    """An atlas for textures of `size`^2 texels.

    With `single_chart` both sides of a two-sided face share one place, as textures do that know nothing of sides: the
    front decides for both, which is wrong on leaves. `unwrap_mode` "never" keeps xatlas away; `padding` is the number
    of texels that xatlas leaves around each chart. Raises PrtnetError when the charts do not fit, and when the file's
    coordinates cannot serve but must.
    """
    check(unwrap_mode, padding)
    if size < 16:
        raise PrtnetError(f"atlas.size: found {size}, expected at least 16")
    split = scene.split_sides()
    sides = len(split.faces) > len(scene.faces)
    overlap = np.nan if scene.uv is None else file_overlap(scene, size)
    reason = _unfit(scene, overlap)
    if reason is None and sides and not single_chart:
        reason = "two-sided faces need a chart for each side"
    if reason is None:
        assert split.uv is not None
        log.info("atlas: the file's coordinates, %.3f %% overlap", 100 * overlap)
        return Atlas(split, np.clip(split.uv, 0, 1), "file", float(overlap))
    if unwrap_mode == "never":
        raise PrtnetError(
            f"{scene.name}: atlas.unwrap: found never, but {reason}; expected coordinates in [0, 1] with a place for "
            "every face, or atlas.unwrap=auto"
        )
    log.info("atlas: xatlas, since %s", reason)
    back = np.flatnonzero(scene.two_sided)
    sheets = [split.faces[: len(scene.faces)]]
    if sides and not single_chart:
        sheets.append(split.faces[len(scene.faces) :])
    corner_uv = unwrap.charts(split.frame.to_unit(split.vertices), split.normals, sheets, size, padding)
    if single_chart:
        corner_uv = np.concatenate([corner_uv, corner_uv[back][:, ::-1]])
    return _indexed(split, corner_uv, float(overlap))


def check(unwrap_mode: str, padding: int) -> None:
    """Raises PrtnetError, naming the configuration's key, for what there is not."""
    if unwrap_mode not in UNWRAP:
        raise PrtnetError(f"atlas.unwrap: found {unwrap_mode!r}, expected one of {', '.join(UNWRAP)}")
    if not 1 <= padding <= 64:
        raise PrtnetError(f"atlas.padding: found {padding}, expected 1 to 64 texels")


def _unfit(scene: Scene, overlap: float) -> str | None:
    """Why the file's coordinates cannot be an atlas, or None."""
    if scene.uv is None:
        return "the scene has no texture coordinates"
    low, high = float(scene.uv.min()), float(scene.uv.max())
    if low < -UV_SLACK or high > 1 + UV_SLACK:
        return f"the file's coordinates leave [0, 1] ({low:.3g} to {high:.3g})"
    flat = int(np.sum((unwrap.uv_areas(scene.uv[scene.faces]) == 0) & (scene.face_areas > 0)))
    if flat:
        return f"{flat} faces have no area in the file's coordinates"
    if overlap > MAX_OVERLAP:
        return f"{100 * overlap:.2f} % of the file's coordinates overlap"
    return None


def file_overlap(scene: Scene, size: int) -> float:
    """Fraction of the texels that the file's coordinates cover that several faces cover; [0, 1] only."""
    if scene.uv is None:
        return float("nan")
    counts = coverage(scene.uv[scene.faces], size)
    covered = np.count_nonzero(counts)
    return float(np.count_nonzero(counts > 1) / covered) if covered else 0.0


def coverage(corner_uv: Float[Array, "f 3 2"], size: int) -> Int[Array, "size size"]:
    """How many faces cover each texel centre, row 0 on top. Faces that share an edge never both count."""
    context, target = gl.context(), gl.target(size, size)
    shader = gl.program(gl.shader("uv.vert.glsl"), gl.shader("uv_count.frag.glsl"))
    gl.put(shader, size=float(size))
    buffer = context.buffer(np.ascontiguousarray(corner_uv, np.float32).tobytes())
    target.clear()
    context.disable(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
    context.enable(moderngl.BLEND)
    context.blend_func = moderngl.ONE, moderngl.ONE
    context.vertex_array(shader, [(buffer, "2f", "atlas_uv")]).render(moderngl.TRIANGLES)
    context.disable(moderngl.BLEND)
    return target.read()[..., 0].astype(np.int64)


def _indexed(scene: Scene, corner_uv: Float32[Array, "f 3 2"], overlap: float) -> Atlas:
    """Vertices split where they have several places in the atlas."""
    rows = np.empty((scene.faces.size, 3), np.int32)
    rows[:, 0] = scene.faces.ravel()
    rows[:, 1:] = np.clip(corner_uv, 0, 1).astype(np.float32).reshape(-1, 2).view(np.int32)
    _, first, corner = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    indexed = _with_vertices(scene, rows[first, 0], corner)
    return Atlas(indexed, rows[first, 1:].copy().view(np.float32), "xatlas", overlap)


def _with_vertices(scene: Scene, vertex: Int[Array, " v"], corner: Int[Array, " c"]) -> Scene:
    """The same faces on copies of the vertices numbered `vertex`; `corner` is which of them each corner has."""
    return replace(
        scene,
        vertices=scene.vertices[vertex],
        normals=scene.normals[vertex],
        uv=None if scene.uv is None else scene.uv[vertex],
        roughness=None if scene.roughness is None else scene.roughness[vertex],
        faces=corner.reshape(-1, 3).astype(np.int32),
        tangents=None if scene.tangents is None else scene.tangents[vertex],
    )


def joined(atlas: Atlas, other: Atlas) -> tuple[Atlas, Float32[Array, "v 2"]]:
    """One mesh for two atlases of a scene: `atlas` with its vertices split where they have several places in `other`,
    and these places."""
    pairs = np.stack([atlas.scene.faces.ravel(), other.scene.faces.ravel()], axis=1)
    vertex, corner = np.unique(pairs, axis=0, return_inverse=True)
    split = _with_vertices(atlas.scene, vertex[:, 0], corner.ravel())
    return replace(atlas, scene=split, uv=atlas.uv[vertex[:, 0]]), other.uv[vertex[:, 1]]
