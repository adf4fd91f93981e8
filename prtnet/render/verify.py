"""Runs an exported net on the GL driver and compares it with its NumPy twin."""

import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from prtnet import gl, netspec, sh
from prtnet.export import glsl
from prtnet.netspec import NetSpec
from prtnet.render import features

Array = np.ndarray

TOLERANCE = 1e-5  # of each coefficient; more than this and the driver does not compute what was trained
_ATTACHMENTS = 8  # colour outputs that every OpenGL 3.3 has


class Errors(NamedTuple):
    """Of the coefficients' absolute errors."""

    highest: float
    mean: float


def glsl_error(net: NetSpec, source: str, positions: Float[Array, "n 3"], normals: Float[Array, "n 3"]) -> Errors:
    """Errors of the function text `source` (`glsl.emit`) at centred positions and unit normals."""
    found = run(net, source, positions, normals)
    error = np.abs(found - netspec.evaluate_unit(net, positions.astype(np.float64), normals))
    return Errors(float(error.max()), float(error.mean()))


def random_points(count: int, rng: np.random.Generator) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Uniform positions in [-1, 1]^3 and uniform unit normals, float32."""
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return rng.uniform(-1, 1, (count, 3)).astype(np.float32), normals.astype(np.float32)


def run(net: NetSpec, source: str, positions: Float[Array, "n 3"], normals: Float[Array, "n 3"]) -> Float[Array, "n c"]:
    """The coefficients that the function text `source` gives on the driver, one pixel a point."""
    side = math.isqrt(max(len(positions) - 1, 0)) + 1
    textures: dict[str, Any] = {
        "positions": gl.upload(_image(positions, side)),
        "normals": gl.upload(_image(normals, side)),
    }
    textures |= features.upload(net.grids, net.hashes)
    layers = []
    for first in range(0, glsl.vectors(net), _ATTACHMENTS):
        count = min(_ATTACHMENTS, glsl.vectors(net) - first)
        layers += _draw(glsl.around(net, source, first=first), side, textures, count)
    flat = np.concatenate(layers, axis=2).reshape(side * side, net.groups, -1)
    return flat[: len(positions), :, : sh.count(net.bands)].reshape(len(positions), -1)


def _image(points: Float[Array, "n 3"], side: int) -> Float[Array, "s s 4"]:
    image = np.zeros((side * side, 4), np.float32)
    image[: len(points), :3] = points
    return image.reshape(side, side, 4)


def _draw(fragment: str, side: int, textures: dict[str, Any], layers: int) -> list[Float[Array, "s s 4"]]:
    program = gl.program(gl.shader("fullscreen.vert.glsl"), fragment)
    target = gl.target(side, side, layers)
    for unit, (name, texture) in enumerate(textures.items()):
        texture.use(unit)
        gl.put(program, **{name: unit})
    gl.fullscreen(program, target)
    return [target.read(layer) for layer in range(layers)]
