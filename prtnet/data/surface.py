"""What is known of every surface point, to be found by the rays that hit it: one row of values per texel of an atlas.

The nearest texel answers, without blending: among hundreds of rays the steps between texels average out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32

from prtnet.data.albedo import albedo
from prtnet.data.atlas import Atlas
from prtnet.data.scene import Scene
from prtnet.data.texture import Texels

Array = np.ndarray

# rings that charts grow by, so that rounding at their borders finds a texel
RINGS = 2


@dataclass(frozen=True, eq=False)
class Surface:
    """Where in the rows of a table each point of a scene's surfaces has its own."""

    # atlas coordinates of the corners of the faces of scene.split_sides(); of backs in the order of their fronts, since
    # a ray that hits a back is told the front's barycentric coordinates
    corners: Float32[Array, "f 3 2"]
    # the split face on the back of each face of the scene; -1 where nobody sees the back
    behind: Int32[Array, " s"]
    # per split face: texels along one side of its atlas, and where that atlas starts in `texels`
    place: Int32[Array, "f 2"]
    # row of the table, -1 where no chart is near
    texels: Int32[Array, " t"]

    def rows(self, face: Int[Array, " n"], where: Float[Array, "n 2"], front: Bool[Array, " n"]) -> Int32[Array, " n"]:
        """The row of points (u, v) of faces, seen from their front or back: the plain twin of the kernel's look-up.

        -1 where the ray hit nothing (face -1), the side is never seen, or no chart is near.
        """
        side = np.where(front, face, self.behind[face])
        u, v = where.astype(np.float32).T
        weights = np.stack([np.float32(1) - u - v, u, v], axis=1)
        at = self.corners[side]
        x, y = (weights[:, 0] * at[:, 0, i] + weights[:, 1] * at[:, 1, i] + weights[:, 2] * at[:, 2, i] for i in (0, 1))
        size, start = self.place[side].T
        column, row = (np.clip((each * size).astype(np.int32), 0, size - 1) for each in (x, y))
        found = self.texels[start + (size - 1 - row) * size + column]
        return np.where((face < 0) | (side < 0), -1, found).astype(np.int32)


def of_atlas(scene: Scene, atlas: Atlas, pages: Sequence[Texels]) -> Surface:
    """Rows in the order of the texels of all `pages`, for rays that hit `scene`, of which `atlas` was made."""
    behind = np.full(len(scene.faces), -1, np.int32)
    back = np.flatnonzero(scene.two_sided)
    behind[back] = len(scene.faces) + np.arange(len(back))
    counts = np.cumsum([0] + [len(page.index) for page in pages])
    grown = [_grown(page).ravel() for page in pages]
    texels = [np.where(rows < 0, -1, rows + first) for rows, first in zip(grown, counts, strict=False)]
    starts = np.cumsum([0] + [len(rows) for rows in grown])[: len(pages)]
    place = np.stack([[page.size for page in pages], starts], axis=1)[atlas.page_of_face].astype(np.int32)
    corners = atlas.uv[atlas.scene.faces]
    corners[len(scene.faces) :] = corners[len(scene.faces) :, ::-1].copy()
    return Surface(corners, behind, place, np.concatenate(texels).astype(np.int32))


def _grown(texels: Texels) -> Int32[Array, "size size"]:
    """Which of `texels` each texel of the atlas shows; those just outside of charts show a neighbour's."""
    size = texels.size
    image = np.full((size, size), -1, np.int32)
    image.reshape(-1)[texels.index] = np.arange(len(texels.index))
    for _ in range(RINGS):
        padded = np.pad(image, 1, constant_values=-1)
        for down, across in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            near = padded[1 + down : 1 + down + size, 1 + across : 1 + across + size]
            image = np.where(image < 0, near, image)
    return image


def texel_albedo(atlas: Atlas, pages: Sequence[Texels]) -> Float32[Array, "n 3"]:
    """Linear RGB albedo at the surface point of each texel of all pages."""
    face, positions = (np.concatenate([getattr(page, name) for page in pages]) for name in ("face", "positions"))
    return albedo(atlas.scene, face, _weights(atlas.scene, face, positions))


def _weights(scene: Scene, face: Int[Array, " n"], positions: Float64[Array, "n 3"]) -> Float64[Array, "n 3"]:
    """Barycentric weights of points that lie on their faces, by areas; a face without area is all its first corner."""
    a, b, c = np.moveaxis(scene.vertices[scene.faces[face]], 1, 0)
    normal = np.cross(b - a, c - a)
    area = np.einsum("ni,ni->n", normal, normal)
    safe = np.where(area > 0, area, 1)
    second = np.einsum("ni,ni->n", np.cross(positions - a, c - a), normal) / safe
    third = np.einsum("ni,ni->n", np.cross(b - a, positions - a), normal) / safe
    second, third = (np.clip(np.where(area > 0, each, 0), 0, 1) for each in (second, third))
    return np.stack([1 - second - third, second, third], axis=1)


def outgoing(
    albedo: Float[Array, "n 3"], received: Float[Array, "n k"] | Float[Array, "n k 3"]
) -> Float32[Array, "n k 3"]:
    """albedo / pi times what a point receives, per response or radiance, grey or RGB: what it sends everywhere."""
    coloured = received if received.ndim == 3 else received[:, :, None]
    return (coloured * (albedo / np.pi)[:, None, :]).astype(np.float32)
