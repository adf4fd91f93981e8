"""Procedural scenes: no file, no download, the same triangles everywhere.

Knobs of every scene: `tessellation` scales the number of subdivisions of curved surfaces (triangles go with its square;
planes stay coarse on purpose), `seed` draws another arrangement.
"""

import numpy as np

from prtnet import PrtnetError
from prtnet.data.builtin import colonnade, cornell, dining_table, hair, living_room, plants, room, tea_set
from prtnet.data.scene import Scene, assemble

MAKERS = {
    "colonnade": (colonnade.parts, "inside"),
    "cornell": (cornell.parts, "orbit"),
    "dining_table": (dining_table.parts, "orbit"),
    "hair": (hair.parts, "orbit"),
    "living_room": (living_room.parts, "inside"),
    "plants": (plants.parts, "orbit"),
    "room": (room.parts, "inside"),
    "tea_set": (tea_set.parts, "orbit"),
}
NAMES = tuple(sorted(MAKERS))


def make(name: str, *, tessellation: float = 1.0, seed: int = 0) -> Scene:
    """The procedural scene `name`, y up, with a named material for each part."""
    if name not in MAKERS:
        raise PrtnetError(f"scene.name: found {name!r}, expected one of {', '.join(NAMES)}, or give scene.path")
    if not 0.05 <= tessellation <= 50:
        raise PrtnetError(f"scene.tessellation: found {tessellation}, expected 0.05 to 50")
    parts, camera = MAKERS[name]
    return assemble(name, parts(float(tessellation), np.random.default_rng(seed)), camera=camera)
