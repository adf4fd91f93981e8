"""Small scenes that tracing tests share, and transfer by brute quadrature where a closed form exists."""

import numpy as np

from prtnet import sh
from prtnet.data.scene import Scene, frame_of


def scene(vertices, faces) -> Scene:
    """A bare scene; the tracer only looks at triangles and frame."""
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int32)
    return Scene(
        name="test",
        vertices=vertices,
        faces=faces,
        normals=np.tile(np.float32([0, 1, 0]), (len(vertices), 1)),
        uv=None,
        part=np.zeros(len(faces), np.int32),
        two_sided=np.zeros(len(faces), bool),
        materials=(),
        frame=frame_of(vertices),
    )


def quad(corner, right, up):
    corner, right, up = (np.asarray(v, np.float64) for v in (corner, right, up))
    return np.array([corner, corner + right, corner + right + up, corner + up]), np.array([[0, 1, 2], [0, 2, 3]])


def join(*meshes) -> Scene:
    vertices, faces, start = [], [], 0
    for v, f in meshes:
        vertices.append(v)
        faces.append(np.asarray(f) + start)
        start += len(v)
    return scene(np.concatenate(vertices), np.concatenate(faces))


def soup(count, seed, size=0.3):
    """Random triangles in the unit cube."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (count, 1, 3)) + rng.normal(size=(count, 3, 3)) * size
    return scene(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def surface_points(mesh: Scene, count, seed):
    """Random points and unit triangle normals."""
    rng = np.random.default_rng(seed)
    corners = mesh.vertices[mesh.faces[rng.integers(len(mesh.faces), size=count)]]
    weights = rng.dirichlet([1, 1, 1], count)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.einsum("ni,nij->nj", weights, corners), normals / np.linalg.norm(normals, axis=1, keepdims=True)


def clipped_lobe(normal, edge, bands):
    """Integral of max(0, n.w) Y over the half of the sphere with edge.w > 0: what a half-space -edge leaves free.

    Polar coordinates about `edge` with nodes that end where either factor clips, so that the quadrature meets no kink.
    `normal` and `edge` are perpendicular.
    """
    normal, edge = np.asarray(normal, np.float64), np.asarray(edge, np.float64)
    side = np.cross(normal, edge)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    angle, angle_weights = (nodes + 1) * np.pi / 4, weights * np.pi / 4  # from the edge
    turn, turn_weights = nodes * np.pi / 2, weights * np.pi / 2  # about the edge, on the normal's side
    a, t = np.meshgrid(angle, turn, indexing="ij")
    towards = (
        np.cos(a)[..., None] * edge
        + (np.sin(a) * np.cos(t))[..., None] * normal
        + (np.sin(a) * np.sin(t))[..., None] * side
    ).reshape(-1, 3)
    area = np.outer(angle_weights * np.sin(angle), turn_weights).ravel()
    return sh.project(np.maximum(towards @ normal, 0)[:, None], towards, area, bands)[:, 0]
