"""Mappings of the sphere onto images: the world direction and exact solid angle of each texel, and the way back.

An image is a stack of panels "p h w", row 0 on top, texel centres at half-integers:

* `lat_long`, 1 panel: u = 1/2 + atan2(x, -z) / 2pi and v = 0 at +y. The centre looks down -z, +x is at u = 3/4.
* `angular`, 1 square panel: a disc whose centre looks down -z, with +y up, +x to the right and +z all around its rim;
  the distance from the centre is the angle from -z, r = acos(-z) / pi of the disc's radius (Debevec's light probes).
* `cube`, 6 square panels in the order +x -x +y -y +z -z, each as `texture(samplerCube, w)` of OpenGL finds it: OpenGL
  4.6 table 8.19, with the first row at t = 0. On the four sides +y is up; +x is to the right on +z.
"""

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

Array = np.ndarray
MAPPINGS = ("lat_long", "angular", "cube")

# OpenGL 4.6, table 8.19: w is along FORWARD + sc RIGHT + tc DOWN, with sc and tc in [-1, 1]
FORWARD = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
RIGHT = np.array([[0, 0, -1], [0, 0, 1], [1, 0, 0], [1, 0, 0], [1, 0, 0], [-1, 0, 0]], float)
DOWN = np.array([[0, -1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [0, -1, 0], [0, -1, 0]], float)


def directions(mapping: str, height: int, width: int) -> Float64[Array, "p h w 3"]:
    """World direction of each texel's centre. Outside the disc of an angular map: +z, its rim."""
    if mapping == "lat_long":
        return lat_long_directions(height, width)[None]
    right, down = _centres(width), _centres(height)
    if mapping == "angular":
        return _angular_directions(*np.meshgrid(right, -down))[None]
    sideways = RIGHT[:, None, None] * right[:, None] + DOWN[:, None, None] * down[:, None, None]
    towards = FORWARD[:, None, None] + sideways
    return towards / np.linalg.norm(towards, axis=-1, keepdims=True)


def solid_angles(mapping: str, height: int, width: int) -> Float64[Array, "p h w"]:
    """Exact solid angle of each texel, in sr: they sum to 4 pi. Texels outside the disc of an angular map have none."""
    if mapping == "lat_long":
        return np.broadcast_to(lat_long_solid_angles(height, width)[:, None], (1, height, width))
    right, down = np.linspace(-1, 1, width + 1), np.linspace(-1, 1, height + 1)[:, None]
    if mapping == "angular":
        return _angular_solid_angles(right, down[:, 0])[None]
    # of the rectangle from the middle of the face to (x, y): Driscoll 2012, "Cubemap Texel Solid Angle"
    corner = np.arctan2(right * down, np.sqrt(right**2 + down**2 + 1))
    face = corner[1:, 1:] - corner[1:, :-1] - corner[:-1, 1:] + corner[:-1, :-1]
    return np.broadcast_to(face, (6, height, width))


def lat_long_directions(height: int, width: int) -> Float64[Array, "h w 3"]:
    """World direction of each texel's centre of a lat-long image."""
    angle = ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi
    elevation = (0.5 - (np.arange(height) + 0.5) / height) * np.pi
    level = np.cos(elevation)[:, None]
    up = np.broadcast_to(np.sin(elevation)[:, None], (height, width))
    return np.stack([level * np.sin(angle), up, -level * np.cos(angle)], -1)


def lat_long_solid_angles(height: int, width: int) -> Float64[Array, " h"]:
    """Exact solid angle, in sr, of one texel of each row: a band between two latitudes, cut into `width`."""
    edges = np.sin((0.5 - np.arange(height + 1) / height) * np.pi)
    return -np.diff(edges) * 2 * np.pi / width


def locate(
    mapping: str, towards: Float[Array, "*n 3"], height: int, width: int
) -> tuple[Int[Array, "*n"], Float64[Array, "*n"], Float64[Array, "*n"]]:
    """Panel, row and column of each unit direction, whole numbers at texel centres: the inverse of `directions`."""
    x, y, z = np.moveaxis(np.asarray(towards, np.float64), -1, 0)
    panel = np.zeros(x.shape, int)
    if mapping == "lat_long":
        right, down = np.arctan2(x, -z) / np.pi, -np.arcsin(np.clip(y, -1, 1)) * 2 / np.pi
    elif mapping == "angular":
        level = np.hypot(x, y)
        radius, length = np.arctan2(level, -z) / np.pi, np.maximum(level, 1e-300)
        # +z itself is the whole rim: its right end
        right, down = np.where(level > 0, x / length, 1) * radius, -y / length * radius
    else:
        along = np.asarray(towards, np.float64) @ FORWARD.T
        panel = np.argmax(along, -1)
        depth = np.take_along_axis(along, panel[..., None], -1)[..., 0]
        right = (towards * RIGHT[panel]).sum(-1) / depth
        down = (towards * DOWN[panel]).sum(-1) / depth
    return panel, (down + 1) / 2 * height - 0.5, (right + 1) / 2 * width - 0.5


def sample(mapping: str, radiance: Float[Array, "p h w c"], towards: Float[Array, "*n 3"]) -> Float32[Array, "*n c"]:
    """Bilinear look-up in each direction. Lat-long columns wrap; elsewhere the edges of a panel are clamped.

    In angular maps the last texels before the rim stand for the rim: beyond it files hold anything.
    """
    _, height, width, _ = radiance.shape
    panel, row, column = locate(mapping, towards, height, width)
    if mapping == "angular":
        middle = (width - 1) / 2
        away = np.hypot(row - middle, column - middle)
        shrink = np.minimum(1, max(width / 2 - np.sqrt(2), 0) / np.maximum(away, 1e-30))
        row, column = middle + (row - middle) * shrink, middle + (column - middle) * shrink
    top, left = np.floor(row).astype(int), np.floor(column).astype(int)
    total = np.zeros((*panel.shape, radiance.shape[3]))
    for step_down, step_right in ((0, 0), (0, 1), (1, 0), (1, 1)):
        share = np.abs(1 - step_down - (row - top)) * np.abs(1 - step_right - (column - left))
        i, j = np.clip(top + step_down, 0, height - 1), left + step_right
        j = j % width if mapping == "lat_long" else np.clip(j, 0, width - 1)
        total += share[..., None] * radiance[panel, i, j]
    return total.astype(np.float32)


def to_lat_long(mapping: str, radiance: Float[Array, "p h w c"]) -> Float32[Array, "rows columns c"]:
    """A lat-long image with about as many texels per degree, by bilinear look-up; lat-long images as they are."""
    if mapping == "lat_long":
        return np.asarray(radiance[0], np.float32)
    # an angular map has its width on 360 degrees, a cube map four faces
    height = max(1, radiance.shape[1] // 2) if mapping == "angular" else 2 * radiance.shape[1]
    return sample(mapping, radiance, lat_long_directions(height, 2 * height))


def _centres(count: int) -> Float64[Array, " n"]:
    return (np.arange(count) + 0.5) / count * 2 - 1


def _angular_directions(right: Float64[Array, "h w"], up: Float64[Array, "h w"]) -> Float64[Array, "h w 3"]:
    radius = np.hypot(right, up)
    angle = np.pi * np.minimum(radius, 1)
    level = np.sin(angle) / np.maximum(radius, 1e-30)
    return np.stack([level * right, level * up, -np.cos(angle)], -1)


def _angular_solid_angles(right: Float64[Array, " w1"], down: Float64[Array, " h1"]) -> Float64[Array, "h w"]:
    """Each square's share of the sphere, cut by the rim.

    dw = sin(theta) dtheta dphi = d(1 - cos theta) dphi, so that by Green's theorem a square's solid angle is the
    integral of (1 - cos theta) dphi around it, with theta = pi from the rim on: nothing is left to cut out there.
    """
    along_columns = _edges(right[:, None], down[None, :])  # "w1 h", the vertical edges
    along_rows = _edges(down[:, None], right[None, :])  # "h1 w", the level ones
    angles = along_columns[1:].T - along_columns[:-1].T + along_rows[1:] - along_rows[:-1]
    # the corner that is nearest to the centre: beyond the rim only rounding is left
    nearest = np.hypot(np.minimum(abs(right[1:]), abs(right[:-1])), np.minimum(abs(down[1:]), abs(down[:-1]))[:, None])
    return np.where(nearest < 1, angles, 0)


def _edges(fixed: Float64[Array, "a 1"], moving: Float64[Array, "1 b1"]) -> Float64[Array, "a b"]:
    """Integral of (1 - cos theta) dphi along the edges from one `moving` to the next, at a `fixed` other coordinate."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    middle, half = (moving[:, 1:] + moving[:, :-1]) / 2, np.diff(moving) / 2
    total = np.zeros((fixed.shape[0], middle.shape[1]))
    for node, weight in zip(nodes, weights, strict=True):
        square = fixed**2 + (middle + node * half) ** 2
        angle = np.pi * np.minimum(np.sqrt(square), 1)
        # (1 - cos) / r^2 as 2 sin^2(theta / 2) / r^2: no digits are lost near the centre
        total += weight * half * fixed * 2 * np.sin(angle / 2) ** 2 / np.maximum(square, 1e-300)
    return total
