"""Albedo at points of surfaces: the part's factor times its texture, as the shaders see it close by (bilinear)."""

import numpy as np
from jaxtyping import Float, Float32, Int

from prtnet.data.bilinear import bilinear
from prtnet.data.scene import Scene

Array = np.ndarray


def albedo(scene: Scene, face: Int[Array, " n"], weights: Float[Array, "n 3"]) -> Float32[Array, "n 3"]:
    """Linear RGB at barycentric weights of faces of `scene`, whole or split into sides."""
    part = scene.part[face]
    out = np.stack([material.albedo for material in scene.materials])[part].astype(np.float32)
    if scene.uv is None:
        return out
    uv = np.einsum("ni,nij->nj", weights, scene.uv[scene.faces[face]].astype(np.float64))
    for index, material in enumerate(scene.materials):
        if material.texture is not None:
            here = part == index
            out[here] *= bilinear(material.texture, uv[here]).astype(np.float32)
    return out
