"""Runs an exported net on the GL driver and compares it with its NumPy twin."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from prtnet import gl, netspec, sh
from prtnet.export import glsl, weight_texture
from prtnet.netspec import NetSpec
from prtnet.render import features, pixelwise
from prtnet.render.pixelwise import Pass

Array = np.ndarray

TOLERANCE = 1e-5  # of each coefficient; more than this and the driver does not compute what was trained
_ATTACHMENTS = 8  # colour outputs that every OpenGL 3.3 has


class Errors(NamedTuple):
    """Of the coefficients' absolute errors."""

    highest: float
    mean: float


def glsl_error(
    net: NetSpec,
    source: str,
    positions: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    uv: Float[Array, "n 2"] | None = None,
    *,
    weights: Float[Array, "h w 4"] | None = None,
) -> Errors:
    """Errors of the function text `source` (`glsl.emit`) at centred positions, unit normals and, where the net takes
    them, coordinates in the atlas.

    `weights`: the image of its weight texture, where it has one.
    """
    found = run(net, source, positions, normals, uv, weights=weights)
    error = np.abs(found - netspec.evaluate_unit(net, positions.astype(np.float64), normals, uv=uv))
    return Errors(float(error.max()), float(error.mean()))


def random_points(count: int, rng: np.random.Generator) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Uniform positions in [-1, 1]^3 and uniform unit normals, float32."""
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return rng.uniform(-1, 1, (count, 3)).astype(np.float32), normals.astype(np.float32)


def run(
    net: NetSpec,
    source: str,
    positions: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    uv: Float[Array, "n 2"] | None = None,
    *,
    weights: Float[Array, "h w 4"] | None = None,
) -> Float[Array, "n c"]:
    """The coefficients that the function text `source` gives on the driver, one pixel a point."""
    return coefficients(net, passes(net, source, textures(net, positions, normals, weights, uv)), len(positions))


def textures(
    net: NetSpec,
    positions: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    weights: Float[Array, "h w 4"] | None = None,
    uv: Float[Array, "n 2"] | None = None,
) -> dict[str, Any]:
    """What the samplers of a shader about a function of the net read: the points, one a pixel, and the net's own."""
    found: dict[str, Any] = {
        "positions": gl.upload(pixelwise.image(positions)),
        "normals": gl.upload(pixelwise.image(normals)),
    }
    if uv is not None and net.texels:
        found["uvs"] = gl.upload(pixelwise.image(uv))
    if weights is not None:
        found[weight_texture.NAME] = gl.upload_table(weights)
    return found | features.upload(net.grids, net.hashes, net.texels)


def passes(net: NetSpec, source: str, found: dict[str, Any]) -> list[Pass]:
    """The function text `source` drawn once, in as many passes as its outputs take. `found`: `textures`."""
    count = glsl.vectors(net)
    return [
        Pass(glsl.around(net, source, first=first), found, outputs=min(_ATTACHMENTS, count - first))
        for first in range(0, count, _ATTACHMENTS)
    ]


def coefficients(net: NetSpec, drawn: list[Pass], points: int) -> Float[Array, "n c"]:
    """What `passes` has drawn, without the padding."""
    flat = np.concatenate([each.read() for each in drawn], axis=1)[:points].reshape(points, net.groups, -1)
    return flat[:, :, : sh.count(net.bands)].reshape(points, -1)
