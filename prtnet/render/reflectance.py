"""What each point reflects where that differs: by its part, and by the roughness of its file.

`of_points` gives it in NumPy, `attributes` as vertex attributes for shaders/reflectance.vert.glsl.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int

from prtnet import PrtnetError
from prtnet.data import roughness as roughnesses
from prtnet.data.scene import Scene
from prtnet.render.material import Material, OfPart, Reflectance

Array = np.ndarray
# texture unit of the roughness maps
UNIT = 6


def check(material: Material, scene: Scene) -> None:
    """Raises PrtnetError for parts that the scene lacks, and for roughness from a file that has none."""
    names = list(dict.fromkeys(found.name for found in scene.materials))
    unknown = [name for name in material.parts if name not in names]
    if unknown:
        raise PrtnetError(f"material.parts: found {', '.join(unknown)}, expected some of {', '.join(names)}")
    if material.roughness == "file" and not roughnesses.known(scene):
        raise PrtnetError(
            f"material.roughness: found file, but {scene.name} has no roughness; expected a glTF roughness factor or "
            "texture, or roughness of vertices (_ROUGHNESS in glTF, roughness in PLY); config takes material.exponent"
        )


def of_part(name: str, words: Mapping[str, Any]) -> OfPart:
    """Reads what a configuration says of a part. Raises PrtnetError for words and values that are none."""
    known = [field.name for field in fields(OfPart)]
    unknown = [word for word in words if word not in known]
    if unknown:
        raise PrtnetError(f"material.parts.{name}: found {', '.join(unknown)}, expected some of {', '.join(known)}")
    try:
        colour = words.get("specular")
        diffuse, exponent = (None if v is None else float(v) for v in (words.get("diffuse"), words.get("exponent")))
        return OfPart(diffuse, None if colour is None else tuple(float(value) for value in colour), exponent)
    except (TypeError, ValueError):
        expected = "expected numbers, and three of them for specular"
        raise PrtnetError(f"material.parts.{name}: found {dict(words)}, {expected}") from None


def of_points(
    material: Material, names: Sequence[str], part: Int[Array, " n"], roughness: Float[Array, " n"] | None
) -> Reflectance | None:
    """What points of parts (an index into `names`) reflect; None where it is the same everywhere.

    `roughness` is that of the file, below 0 where it says nothing.
    """
    if not material.varies:
        return None
    own = [material.parts.get(name, OfPart()) for name in names]
    diffuse = np.array([material.diffuse if o.diffuse is None else o.diffuse for o in own])
    specular = np.array([material.specular if o.specular is None else o.specular for o in own], np.float64)
    exponent = np.array([material.exponent if o.exponent is None else o.exponent for o in own], np.float64)[part]
    if roughness is not None:
        open_ = _by_roughness(material, names)[part] & (roughness >= 0)
        exponent = np.where(open_, roughnesses.exponent(np.maximum(roughness, 0)), exponent)
    return Reflectance(diffuse[part], specular.reshape(-1, 3)[part], exponent)


def _by_roughness(material: Material, names: Sequence[str]) -> Array:
    """Whether the exponent of each part follows from the file's roughness, where it has one."""
    fixed = {name for name, part in material.parts.items() if part.exponent is not None}
    return np.array([material.roughness == "file" and name not in fixed for name in names], bool)


def at_vertices(material: Material, scene: Scene) -> Reflectance | None:
    """What the vertices of a scene reflect, maps looked up there; None where it is the same everywhere."""
    found = roughnesses.sampled(scene) if material.roughness == "file" else None
    return of_points(material, names_of(scene), roughnesses.part_of_vertices(scene), found)


def attributes(material: Material, scene: Scene) -> dict[str, Float32[Array, "v c"]]:
    """By name, for shading at pixels: in_reflectance (specular, diffuse), and in_exponent, below 0 where the exponent
    follows from in_roughness and the map. Nothing where all is the same everywhere."""
    names, part = names_of(scene), roughnesses.part_of_vertices(scene)
    found = of_points(material, names, part, None)
    if found is None:
        return {}
    if material.roughness == "file":
        open_ = _by_roughness(material, names)[part] & (roughnesses.at_vertices(scene) >= 0)
        found.exponent[open_] = roughnesses.UNKNOWN
    return as_attributes(found)


def as_attributes(found: Reflectance) -> dict[str, Float32[Array, "v c"]]:
    """in_reflectance and in_exponent of vertices."""
    weights = np.concatenate([found.specular, found.diffuse[:, None]], axis=1)
    return {"in_reflectance": weights.astype(np.float32), "in_exponent": found.exponent[:, None].astype(np.float32)}


def names_of(scene: Scene) -> tuple[str, ...]:
    """The name of each part."""
    return tuple(material.name for material in scene.materials)
