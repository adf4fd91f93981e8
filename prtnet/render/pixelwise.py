"""A shader run once at each point of a list, one point a pixel, and what that takes."""

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from prtnet import gl

Array = np.ndarray


class Pass:
    """A fragment shader of points, compiled and drawn. It reads the point of its pixel in the texture `positions` and
    others of that size. `first_draw`: CPU-seconds until the first few pixels are there.
    """

    def __init__(
        self,
        fragment: str,
        textures: Mapping[str, Any],
        uniforms: Mapping[str, object] | None = None,
        *,
        outputs: int = 1,
    ) -> None:
        width, height = textures["positions"].size
        self._target, self._outputs, self._textures = gl.target(width, height, outputs), outputs, textures
        gl.context().finish()
        started = time.process_time()
        self._program = gl.program(gl.shader("fullscreen.vert.glsl"), fragment)
        gl.put(self._program, **(uniforms or {}))
        # drivers compile at the first draw, on the cores of the processor; a few pixels take no time
        self._target.framebuffer.scissor = 0, 0, 4, 4
        self.draw()
        gl.context().finish()
        self.first_draw = time.process_time() - started
        self._target.framebuffer.scissor = 0, 0, width, height
        self.draw()

    def draw(self, **uniforms: object) -> None:
        """Again, with uniforms that are others now."""
        gl.put(self._program, **uniforms)
        for unit, (name, texture) in enumerate(self._textures.items()):
            texture.use(unit)
            gl.put(self._program, **{name: unit})
        gl.fullscreen(self._program, self._target)

    def read(self) -> Float32[Array, "p c"]:
        """What was drawn, the outputs of a pixel one after the other."""
        layers = [self._target.read(layer) for layer in range(self._outputs)]
        return np.concatenate(layers, axis=2).reshape(-1, 4 * self._outputs)

    def milliseconds(self, repeats: int) -> float:
        """Median of a frame."""
        return gl.milliseconds(self.draw, repeats)


def image(points: Float[Array, "n c"]) -> Float32[Array, "s s 4"]:
    """A point a pixel, row by row, in the smallest square."""
    side = math.isqrt(max(len(points) - 1, 0)) + 1
    made = np.zeros((side * side, 4), np.float32)
    made[: len(points), : points.shape[1]] = points
    return made.reshape(side, side, 4)
