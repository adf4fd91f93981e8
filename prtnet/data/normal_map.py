"""Normal maps in tangent space: shading normals that vary within a triangle.

A texel (x, y, z) bends the interpolated normal n to n' = unit(x t + y b + z n), with the interpolated tangent t and
b = w cross(n, t) (`prtnet.data.tangent`). Red is x, along u; green is y, along v upwards, as in glTF and OpenGL.
Transfer and gloss are those of n'; the visibility and the origins of rays stay those of the triangle.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int
from PIL import Image, UnidentifiedImageError

from prtnet import PrtnetError
from prtnet.data.bilinear import bilinear
from prtnet.data.materials import vectors
from prtnet.data.scene import Scene

Array = np.ndarray


def perturbed(
    scene: Scene, face: Int[Array, " n"], weights: Float[Array, "n 3"], normals: Float32[Array, "n 3"]
) -> Float32[Array, "n 3"]:
    """n' of points on faces, of any length; `normals` are the interpolated ones, and stay where there is no map."""
    if scene.tangents is None or scene.uv is None:
        return normals
    out = normals.copy()
    for number, material in enumerate(scene.materials):
        rows = np.flatnonzero(scene.part[face] == number)
        if material.normal_map is None or not len(rows):
            continue
        corner = scene.faces[face[rows]]
        mixed = np.einsum("ni,nij->nj", weights[rows], scene.tangents[corner].astype(np.float64))
        uv = np.einsum("ni,nij->nj", weights[rows], scene.uv[corner].astype(np.float64))
        bent, normal = bilinear(material.normal_map, uv), normals[rows].astype(np.float64)
        across = mixed[:, 3:] * np.cross(normal, mixed[:, :3])
        out[rows] = bent[:, :1] * mixed[:, :3] + bent[:, 1:2] * across + bent[:, 2:] * normal
    return out


def read(path: Path) -> Float32[Array, "h w 3"]:
    """A normal map from an image file. Raises PrtnetError when there is none."""
    if not path.is_file():
        raise PrtnetError(f"scene.normal_maps: {path}: no such file, expected an image")
    try:
        with Image.open(path) as image:
            return vectors(image)
    except (UnidentifiedImageError, OSError) as error:
        raise PrtnetError(f"scene.normal_maps: {path} cannot be read as an image: {error}") from None
