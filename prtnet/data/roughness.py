"""Roughness of surfaces as files give it, and the Phong exponent that follows.

A part's factor (1 where only the others are there) times what its vertices have times the G channel of its map: glTF's
metallicRoughness, linear. The B channel, metalness, is not used.
"""

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32

from prtnet.data.bilinear import bilinear
from prtnet.data.scene import Scene

Array = np.ndarray

# the exponents that roughness is held to: from 0.904 up it is 1, from 0.119 down 10 000
LEAST, MOST = 1.0, 1e4
# what stands for parts of which the file says nothing
UNKNOWN = -1.0


def exponent(roughness: Float[Array, "*n"]) -> Float64[Array, "*n"]:
    """e = 2 / r^4 - 2, held to LEAST .. MOST: alpha = r^2 and e = 2 / alpha^2 - 2.

    Walter et al. 2007, *Microfacet Models for Refraction through Rough Surfaces*, section 5.2, gives it for lobes about
    the half vector; here the lobe about the mirrored direction takes it as it is.
    """
    fourth = np.maximum(np.asarray(roughness, np.float64) ** 4, 1e-6)
    return np.clip(2 / fourth - 2, LEAST, MOST)


def known(scene: Scene) -> bool:
    """Whether the scene's file says anything of roughness."""
    parts = (m.roughness is not None or m.roughness_map is not None for m in scene.materials)
    return scene.roughness is not None or any(parts)


def at_vertices(scene: Scene) -> Float32[Array, " v"]:
    """Factor times roughness of the vertices, without the maps; UNKNOWN where the file says nothing."""
    part = part_of_vertices(scene)
    factor = np.array([1.0 if m.roughness is None else m.roughness for m in scene.materials])[part]
    said = np.array([m.roughness is not None or m.roughness_map is not None for m in scene.materials])[part]
    if scene.roughness is not None:
        has = scene.roughness >= 0
        factor, said = np.where(has, factor * scene.roughness, factor), said | has
    return np.where(said, factor, UNKNOWN).astype(np.float32)


def sampled(scene: Scene) -> Float32[Array, " v"]:
    """As `at_vertices`, with the maps looked up at the vertices: bilinear, repeated."""
    found, part = at_vertices(scene), part_of_vertices(scene)
    for index, material in enumerate(scene.materials):
        own = np.flatnonzero(part == index)
        if material.roughness_map is not None and scene.uv is not None and len(own):
            found[own] *= bilinear(material.roughness_map[..., None], scene.uv[own])[:, 0]
    return found


def part_of_vertices(scene: Scene) -> Int32[Array, " v"]:
    """The part of each vertex: a vertex has one."""
    part = np.zeros(len(scene.vertices), np.int32)
    part[scene.faces.ravel()] = np.repeat(scene.part, 3)
    return part
