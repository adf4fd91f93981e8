"""Implicit surfaces that are built in: distances composed of shapes, y up, each on a ground plate."""

from prtnet import PrtnetError
from prtnet.data.implicit.builtin import sdf_car, sdf_fish, sdf_monster, sdf_rabbit
from prtnet.data.implicit.surface import Described

MAKERS = {
    "sdf_car": sdf_car.make,
    "sdf_fish": sdf_fish.make,
    "sdf_monster": sdf_monster.make,
    "sdf_rabbit": sdf_rabbit.make,
}
NAMES = tuple(sorted(MAKERS))


def make(name: str) -> Described:
    """The built-in surface `name`, with a named material for each part."""
    if name not in MAKERS:
        raise PrtnetError(f"scene.name: found {name!r}, expected one of {', '.join(NAMES)}, or give scene.path")
    return MAKERS[name]()
