"""Small scenes to draw, and an independent bilinear look-up."""

import numpy as np

from prtnet.data.atlas import Atlas
from prtnet.data.part import Part
from prtnet.data.scene import Scene, assemble


def sphere(rows: int = 24, *, radius: float = 1.0, normals: bool = True) -> Part:
    """A latitude-longitude sphere about the origin with its smooth normals and a uv of one chart."""
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, 2 * rows + 1), indexing="ij")
    theta, phi = np.pi * v, 2 * np.pi * u
    points = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1).reshape(-1, 3)
    index = np.arange(points.shape[0]).reshape(rows + 1, 2 * rows + 1)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    # no zero-area faces at the poles
    faces = np.concatenate([np.stack([a, b, c], -1)[:-1].reshape(-1, 3), np.stack([a, c, d], -1)[1:].reshape(-1, 3)])
    uv = np.stack([u, 1 - v], -1).reshape(-1, 2)
    return Part("sphere", radius * points, faces, normals=points if normals else None, uv=uv, two_sided=False)


def quad(corner, right, up, **more) -> Part:
    """A rectangle that faces right x up, with uv from 0 to 1."""
    corner, right, up = (np.asarray(v, np.float64) for v in (corner, right, up))
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float64)
    vertices = corner + uv[:, :1] * right + uv[:, 1:] * up
    more.setdefault("two_sided", False)
    return Part(more.pop("name", "quad"), vertices, np.array([[0, 1, 2], [0, 2, 3]]), uv=uv, **more)


def scene(*parts: Part) -> Scene:
    return assemble("test", parts, camera="orbit").centred()


def bilinear(texture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """The texture at uv (v up, row 0 on top), clamped at the border."""
    size = texture.shape[0]
    x, y = uv[:, 0] * size - 0.5, (1 - uv[:, 1]) * size - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - column)[:, None], (y - row)[:, None]

    def texel(r, c):
        return texture[np.clip(r, 0, size - 1), np.clip(c, 0, size - 1)]

    top = (1 - fx) * texel(row, column) + fx * texel(row, column + 1)
    bottom = (1 - fx) * texel(row + 1, column) + fx * texel(row + 1, column + 1)
    return (1 - fy) * top + fy * bottom


def barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Weights "n 3" of points in the planes of triangles "n 3 d"."""
    first, second, to = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    aa, ab, bb = (np.einsum("ij,ij->i", u, v) for u, v in ((first, first), (first, second), (second, second)))
    pa, pb = np.einsum("ij,ij->i", to, first), np.einsum("ij,ij->i", to, second)
    determinant = aa * bb - ab * ab
    b1, b2 = (bb * pa - ab * pb) / determinant, (aa * pb - ab * pa) / determinant
    return np.stack([1 - b1 - b2, b1, b2], axis=1)


def atlas_uv(atlas: Atlas, face: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """The atlas coordinates of points on faces of atlas.scene."""
    index = atlas.scene.faces[face]
    weights = barycentric(atlas.scene.vertices[index], positions)
    return np.einsum("ni,nij->nj", weights, atlas.uv[index])


def chart_of_face(atlas: Atlas) -> np.ndarray:
    """Charts as sets of faces that share points of the atlas."""
    _, corner = np.unique(atlas.uv, axis=0, return_inverse=True)
    faces = corner.reshape(-1)[atlas.scene.faces]
    label = np.arange(faces.max() + 1)
    while True:
        low = label[faces].min(axis=1)
        again = label.copy()
        np.minimum.at(again, faces.ravel(), np.repeat(low, 3))
        again = again[again]
        if (again == label).all():
            return label[faces[:, 0]]
        label = again
