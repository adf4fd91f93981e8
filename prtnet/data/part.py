"""A part: one mesh with one material, the raw stuff that files and procedural shapes are turned into before a scene."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

GREY = 0.8


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles under one material. Anything that is None is not known and gets computed or chosen at assembly."""

    name: str
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    normals: Float[np.ndarray, "v 3"] | None = None
    # v up, as in OpenGL
    uv: Float[np.ndarray, "v 2"] | None = None
    # linear RGB
    albedo: Float[np.ndarray, " 3"] = field(default_factory=lambda: np.full(3, GREY))
    # linear RGB that multiplies albedo; row 0 is the top of the image (v = 1)
    texture: Float[np.ndarray, "h w 3"] | None = None
    # in tangent space, x along u, y along v; row 0 is the top
    normal_map: Float[np.ndarray, "_ _ 3"] | None = None
    # one word for all faces, or one for each
    two_sided: bool | Bool[np.ndarray, " f"] | None = None
    # of the vertices; factor and map multiply it, the map as `texture` does
    roughness: Float[np.ndarray, " v"] | None = None
    roughness_factor: float | None = None
    roughness_map: Float[np.ndarray, "h w"] | None = None
