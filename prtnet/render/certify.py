"""The figures of a certificate: the shaders of a bundle run on the driver beside the net in NumPy."""

from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

from prtnet import gl, netspec, sh
from prtnet.data import light as lights
from prtnet.export import bundle, fold, glsl, shading, uniform_block
from prtnet.export.bundle import Bundle
from prtnet.netspec import NetSpec
from prtnet.render import material, verify
from prtnet.render.pixelwise import Pass

Array = np.ndarray

EYE, EXPONENT = (0.0, 0.0, 4.0), 20.0
FRAMES = 3
SLOW = 1.0  # CPU-seconds of a frame from which on one is enough


@dataclass(frozen=True, eq=False)
class Points:
    """Where a net is measured: unit coordinates."""

    positions: Float[Array, "n 3"]
    normals: Float[Array, "n 3"]
    uv: Float[Array, "n 2"] | None = None  # in the atlas, where the net has texels

    def evaluated(self, net: NetSpec) -> Float64[Array, "n c"]:
        """The twin."""
        return netspec.evaluate_unit(net, self.positions.astype(np.float64), self.normals, uv=self.uv)


def errors_and_timing(made: Bundle, exact: NetSpec, points: Points) -> dict[str, Any]:
    """Entries `executed` to `timing` of a certificate. `exact`: the net before its weights were rounded.

    Shading is that of a white surface under the built-in sky; its bound is that of the coefficients carried through.
    """
    twin = points.evaluated(made.net)
    errors: dict[str, Any] = {}
    if made.form.precision != "float32" or (made.form.storage == "literal" and made.form.digits < 9):
        errors["rounding of the weights"] = error_of(points.evaluated(exact) - twin)
    if made.form.storage == "ubo":
        return {"executed": False, "reason": uniform_block.NOT_RUN, "errors": errors}
    textures = verify.textures(made.net, points.positions, points.normals, made.weights, points.uv)
    passes = verify.passes(made.net, made.transfer, textures)
    found = verify.coefficients(made.net, passes, len(twin))
    errors["coefficients"] = error_of(found - twin) | {"bound": verify.TOLERANCE}
    for what, difference, reach in _shading(made, points, twin, passes, textures):
        errors[what] = error_of(difference) | {"bound": verify.TOLERANCE * max(1.0, float(reach.max()))}
    # one frame tells how dear the others are
    first = sum(each.milliseconds(1) for each in passes)
    frame = first if first > 1000 * SLOW else sum(each.milliseconds(FRAMES) for each in passes)
    side = textures["positions"].size
    timing = {
        "first_draw_cpu_seconds": sum(each.first_draw for each in passes),
        "milliseconds": frame,
        "frame": list(side),
        "passes": len(passes),
        "note": "all coefficients written; first draw with the driver's shader cache as it was",
    }
    device = {"executed": True, "device": gl.context().info["GL_RENDERER"], "language": "GLSL 330 core"}
    return device | {"errors": errors, "timing": timing}


def _shading(
    made: Bundle, points: Points, twin: Array, passes: list[Pass], textures: dict[str, Any]
) -> list[tuple[str, Array, Array]]:
    """What is compared, radiance on the driver less that of NumPy, and what an error of 1 in all coefficients does to
    it. `passes` have drawn the coefficients."""
    net, known = made.net, lights.project(lights.sky(), made.net.bands)
    diffuse = material.irradiance(twin, known, net.groups) / pi
    reach = np.abs(known).sum(axis=0) / pi
    white: dict[str, Any] = {"prt_light": known, "albedo": (1.0, 1.0, 1.0), "eye": EYE, "exponent": EXPONENT}
    source, images = _found_transfer(net, passes)
    black = white | {"specular": (0.0, 0.0, 0.0)}
    drawn = Pass(bundle.shaded(net, source + made.shading), textures | images, black)
    rows = [("diffuse shading", drawn.read()[: len(twin), :3] - diffuse, reach)]
    if shading.has_gloss(net):
        gloss, own_reach = _gloss(net, points, twin, known)
        drawn.draw(specular=(1.0, 1.0, 1.0))
        rows.append(("glossy shading", drawn.read()[: len(twin), :3] - diffuse - gloss, reach + own_reach))
    if made.irradiance:
        folded = Pass(shading.around(net, made.irradiance), textures, white | fold.uniforms(net, known))
        rows.append(("diffuse shading, light folded", folded.read()[: len(twin), :3] - diffuse, reach))
    return rows


def _found_transfer(net: NetSpec, passes: list[Pass]) -> tuple[str, dict[str, Any]]:
    """A prt_transfer that reads what the exported one gave, and its texture: the driver need not compile the net again
    for the functions on top of it."""
    layers = np.split(np.concatenate([each.read() for each in passes], axis=1), glsl.vectors(net), axis=1)
    side = int(np.sqrt(len(layers[0])))
    # rows of images are counted from the top, those of pixels from the bottom
    image = np.concatenate([layer.reshape(side, side, 4) for layer in reversed(layers)])
    outputs = ", ".join(f"out vec4 t{i}" for i in range(len(layers)))
    lines = ["uniform sampler2D found;", f"void prt_transfer({glsl.parameters(net)}, {outputs}) {{"]
    lines += [
        f"  t{i} = texelFetch(found, ivec2(gl_FragCoord.xy) + ivec2(0, {i * side}), 0);" for i in range(len(layers))
    ]
    return "\n".join(lines) + "\n}\n", {"found": gl.upload(image)}


def _gloss(net: NetSpec, points: Points, twin: Array, known: Array) -> tuple[Float64[Array, "n 3"], Array]:
    """The lobe's part, and what it makes of an error of 1 in all coefficients."""
    towards = np.array(EYE) - points.positions
    seen = material.lobe(material.mirrored(towards, points.normals), EXPONENT, net.bands)
    matrix = material.fixed_light_matrix(known, net.bands)
    direct = twin[:, : sh.count(net.bands)]
    shone = np.stack([np.sum((direct @ colour) * seen, axis=1) for colour in matrix], axis=1)
    reach = np.stack([np.abs(seen @ colour.T).sum(axis=1) for colour in matrix], axis=1)
    return shone, reach


def error_of(difference: Float[Array, "..."]) -> dict[str, float]:
    """The largest and the mean absolute difference."""
    size = np.abs(difference)
    return {"max": float(size.max()), "mean": float(size.mean())}
