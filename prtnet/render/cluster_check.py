"""Exported clusters run on the driver beside their NumPy twins: the figures of their certificate."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from prtnet import clusters, gl, netspec
from prtnet.clusters import ClusterSpec
from prtnet.export import clusters as spelt
from prtnet.export.bundle import Bundle
from prtnet.export.clusters import Stack
from prtnet.render import pixelwise, verify
from prtnet.render.certify import error_of

Array = np.ndarray


def net_error(made: Bundle, positions: Float[Array, "n 3"], normals: Float[Array, "n 3"]) -> dict[str, float]:
    """Of one net's coefficients at positions in its own cube."""
    found = verify.glsl_error(made.net, made.transfer, positions, normals, weights=made.weights)
    return {"max": found.highest, "mean": found.mean, "bound": verify.TOLERANCE}


def weight_error(spec: ClusterSpec, positions: Float[Array, "n 3"]) -> dict[str, float]:
    """Of the weights at unit positions; of hard borders, at those that are not a rounding away from one."""
    count = len(spec.nets)
    lines = ["uniform sampler2D positions;", "uniform int first;", "out vec4 colour;", spelt.functions(spec)]
    lines += ["void main() {", f"  float weights[{count + 3}];", f"  float found[{count}];"]
    lines += ["  prt_cluster_weights(texelFetch(positions, ivec2(gl_FragCoord.xy), 0).xyz, found);"]
    lines += [f"  for (int i = 0; i < {count + 3}; ++i) weights[i] = i < {count} ? found[min(i, {count - 1})] : 0.0;"]
    lines += ["  colour = vec4(weights[first], weights[first + 1], weights[first + 2], weights[first + 3]);", "}"]
    drawn = pixelwise.Pass("\n".join(lines), {"positions": gl.upload(pixelwise.image(positions))}, {"first": 0})
    parts = []
    for first in range(0, count, 4):
        drawn.draw(first=first)
        parts.append(drawn.read()[: len(positions)])
    error = np.concatenate(parts, axis=1)[:, :count] - clusters.weights(spec, positions)
    if spec.delta == 0:
        error = error[_away(spec, positions)]
    # the slope of a step is at most 3 / (4 delta): it carries the rounding of the plane's place
    return error_of(error) | {"bound": verify.TOLERANCE + (1e-6 / spec.delta if spec.delta else 0.0)}


def _away(spec: ClusterSpec, positions: Float[Array, "n 3"]) -> Array:
    """Which points are not on a plane."""
    away = np.ones(len(positions), bool)
    for plane in spec.split.planes:
        away &= np.abs(positions[:, plane.axis] - plane.at) > 1e-6
    return away


def stack_error(
    spec: ClusterSpec, stack: Stack, positions: Float[Array, "n 3"], normals: Float[Array, "n 3"], *, blended: bool
) -> dict[str, float]:
    """Of the coefficients that one program for all nets gives at unit positions, against the nets at the positions in
    their cubes that float32 gives."""
    away = _away(spec, positions) if spec.delta == 0 or not blended else np.ones(len(positions), bool)
    positions, normals = positions[away], normals[away]
    one = replace(spec.nets[0], grids=stack.grids, hashes=stack.hashes)
    found = verify.run(one, stack.text, positions, normals, weights=stack.weights)
    share = clusters.weights(spec, positions)
    if not blended:
        share = np.eye(len(spec.nets))[share.argmax(axis=1)]
    expected = np.zeros(found.shape)
    for index, net in enumerate(spec.nets):
        centre, scale = clusters.own_frame(spec, index)
        own = (positions - centre.astype(np.float32)) * np.float32(scale)
        expected += share[:, index, None] * netspec.evaluate_unit(net, own.astype(np.float64), normals)
    return error_of(found - expected) | {"bound": verify.TOLERANCE}
