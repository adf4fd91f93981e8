"""Exported data-driven transfer run on the driver beside its NumPy twin: the figures of its certificate."""

import time
from dataclasses import replace
from typing import Any

import moderngl
import numpy as np
from jaxtyping import Float, Float64, Int

from prtnet import PrtnetError, data_driven, gl
from prtnet.data_driven import DataDriven
from prtnet.export import data_driven as spelt
from prtnet.render.certify import error_of
from prtnet.render.indirect import Indirect

Array = np.ndarray

TOLERANCE = 1e-6  # of sums of float32, as a share of the sum of what is added, without signs
POWER = 1e-5  # where light goes to another space and back: the drivers' powers


def errors_and_timing(
    spec: DataDriven, direct: Float[Array, "c m 3"], keyframe: Int[Array, " c"] | None = None
) -> dict[str, Any]:
    """Entries `executed` to `timing` of a certificate, under `c` vectors of direct light (`keyframe`: of each).

    Texels are those of the basis as the files have it, in 16-bit floats; what that rounding does is a row of its own.
    """
    if not len(direct):
        raise PrtnetError("data-driven: found no direct light to check the shaders with, expected at least one vector")
    frames = np.zeros(len(direct), np.int64) if keyframe is None else keyframe
    gl.context().finish()
    started = time.process_time()
    drawn = _Drawn(spec)
    drawn.texels(direct[0], int(frames[0]))
    first = time.process_time() - started
    rows = [_errors(drawn, each, int(frame)) for each, frame in zip(direct, frames, strict=True)]
    errors = {what: _worst([row[what] for row in rows]) for what in rows[0]}
    timing = {
        "first_draw_cpu_seconds": first,
        "reduce_milliseconds": gl.milliseconds(drawn.reduce),
        "texels_milliseconds": gl.milliseconds(drawn.blend),
        "note": "u of one light, and all texels of the atlas; first draw with the driver's shader cache as it was",
    }
    device = {"executed": True, "device": gl.context().info["GL_RENDERER"], "language": "GLSL 330 core"}
    return device | {"vectors": len(direct), "errors": errors, "timing": timing}


class _Drawn:
    """The exported texts as programs."""

    def __init__(self, spec: DataDriven):
        self.spec, self.operator = spec, Indirect(spec, texels="float16", held="uniform")
        fragment = spelt.whole(spec, self.operator.text)
        self._program = gl.program(gl.shader("fullscreen.vert.glsl"), fragment)
        self._target = gl.target(spec.size, spec.size)
        self._direct: tuple[moderngl.Texture, int] | None = None

    def texels(self, direct: Float[Array, "m 3"], keyframe: int) -> Float64[Array, "t 3"]:
        self._direct = upload(direct), keyframe
        self.reduce()
        self.blend()
        return self._target.read()[..., :3].reshape(-1, 3)[self.spec.texels].astype(np.float64)

    def reduce(self) -> None:
        assert self._direct
        self.operator.reduce(*self._direct)

    def blend(self) -> None:
        self.operator.bind(self._program)
        gl.fullscreen(self._program, self._target)


def upload(direct: Float[Array, "m 3"]) -> moderngl.Texture:
    """A direct vector as `reduce` reads it."""
    row = np.zeros((1, len(direct), 4), np.float32)
    row[0, :, :3] = direct
    return gl.upload_table(row)


def _errors(drawn: _Drawn, direct: Float[Array, "m 3"], keyframe: int) -> dict[str, dict[str, float]]:
    spec = drawn.spec
    found = drawn.texels(direct, keyframe)
    exact = np.maximum(data_driven.indirect(spec, direct, keyframe), 0)
    kept = replace(spec, basis=_stored(drawn.operator))
    twin = np.maximum(data_driven.indirect(kept, direct, keyframe), 0)
    u = data_driven.coefficients(spec, direct, keyframe)
    # what all terms come to without their signs: rounding is a share of that
    size = replace(kept, matrices=np.abs(kept.matrices), basis=np.abs(kept.basis), gamma=1.0)
    light = np.abs(data_driven.to_space(direct.astype(np.float64), spec.gamma))
    reach, texel_reach = data_driven.coefficients(size, light, keyframe), data_driven.indirect(size, light, keyframe)
    share = TOLERANCE if spec.gamma == 1 else POWER
    of_texels = share + spec.size * 2.0**-23  # their coordinates are rounded as well
    bound = of_texels * float(texel_reach.max())
    if spec.gamma != 1:
        # (a + e)^g - a^g
        most = float(twin.max()) ** (1 / spec.gamma)
        bound = (most + bound) ** spec.gamma - most**spec.gamma
    return {
        "rounding of the basis": error_of(twin - exact),
        "coefficients": error_of(drawn.operator.coefficients() - u) | {"bound": share * float(reach.max())},
        "texels": error_of(found - twin) | {"bound": bound},
    }


def _stored(operator: Indirect) -> Float[Array, "banks n t"]:
    """The basis as the shader reads it."""
    spec = operator.spec
    flat = operator.basis.reshape(spec.size**2, spec.basis.shape[0], -1)[spec.texels, :, : spec.elements]
    return np.moveaxis(flat, 0, 2) / np.float32(spelt.scale_of(spec))


def _worst(rows: list[dict[str, float]]) -> dict[str, float]:
    """Of several lights: that whose error comes nearest to its bound, and the mean of all."""
    found = max(rows, key=lambda row: row["max"] / row.get("bound", 1.0))
    return found | {"mean": float(np.mean([row["mean"] for row in rows]))}
