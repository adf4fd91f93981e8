"""A part of a scene somewhere else: the keyframes of an animated object.

Topology, parts and texture coordinates stay, and so does the frame: the atlas of the scene as it was serves every pose,
and a texel stands for the same place of the same face.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Float64

from prtnet import PrtnetError
from prtnet.data.lighting.lamp import Triple
from prtnet.data.samples import Samples
from prtnet.data.scene import Scene
from prtnet.data.shapes import turn_y
from prtnet.data.signed_distance import Distance
from prtnet.data.texture import Texels
from prtnet.data_driven import Measurement

Array = np.ndarray
Points = TypeVar("Points", Samples, Texels)

# a measurement point this near to a surface, in unit lengths, and facing as it does, is on it
ON_SURFACE = 1e-4


@dataclass(frozen=True)
class Pose:
    """Where a part stands: first turned about the y axis through the middle of its box, then moved."""

    part: str
    move: Triple = (0.0, 0.0, 0.0)  # unit coordinates: the scene is 2 long
    turn: float = 0.0  # degrees, from +z towards +x


def parse(words: Mapping[str, Any]) -> Pose:
    """The pose that {part: NAME, move: [x, y, z], turn: DEGREES} says. Raises PrtnetError for anything else."""
    try:
        unknown = set(words) - {"part", "move", "turn"}
        if unknown:
            raise ValueError(f"unknown {', '.join(sorted(unknown))}")
        x, y, z = (float(value) for value in words.get("move", (0, 0, 0)))
        turn = float(words.get("turn", 0))
        if not np.isfinite([x, y, z, turn]).all():
            raise ValueError("not finite")
        return Pose(str(words["part"]), (x, y, z), turn)
    except (KeyError, TypeError, ValueError) as error:
        raise PrtnetError(
            f"keyframe: found {dict(words)} ({error}), expected {{part: NAME, move: [x, y, z], turn: DEGREES}}"
        ) from None


def posed(scene: Scene, pose: Pose) -> Scene:
    """The scene, or its split or atlas twin, in a pose. Raises PrtnetError for a part that there is not."""
    here = np.zeros(len(scene.vertices), bool)
    here[scene.faces[faces_of(scene, pose.part)]] = True
    motion = Motion.of(scene, pose)
    vertices, normals = scene.vertices.copy(), scene.normals.copy()
    vertices[here] = motion.points(scene.vertices[here])
    normals[here] = motion.vectors(scene.normals[here])
    tangents = scene.tangents
    if tangents is not None:
        tangents = tangents.copy()
        tangents[here, :3] = motion.vectors(tangents[here, :3])
    return replace(scene, vertices=vertices, normals=normals, tangents=tangents)


def posed_points(scene: Scene, samples: Points, pose: Pose) -> Points:
    """Points on `scene`, as it was, carried along with their faces: samples, or the texels of one page of its atlas."""
    split = scene.split_sides()
    here = faces_of(split, pose.part)[samples.face]
    return _carried(samples, here, Motion.of(scene, pose))


def posed_measurement(scene: Scene, measurement: Measurement, pose: Pose) -> Measurement:
    """Measurement points carried along with the part that they lie on; those on a hull stay.

    Their transfer is not that of the pose: left empty, "m 0 3", to be traced again.
    """
    centred = scene.centred()
    mask, motion = faces_of(centred, pose.part), Motion.of(centred, pose)
    alone = replace(centred, faces=centred.faces[mask], part=centred.part[mask], two_sided=centred.two_sided[mask])
    geometric = measurement.geometric_normals.reshape(-1, 3)
    found = Distance(alone).nearest(measurement.positions.reshape(-1, 3).astype(np.float64))
    facing = np.einsum("ni,ni->n", alone.face_normals[found.face], geometric)
    facing = np.where(alone.two_sided[found.face], np.abs(facing), facing)
    here = ((found.distance < ON_SURFACE) & (facing > 0)).reshape(measurement.positions.shape[:2])
    without = replace(measurement, transfer=np.zeros((measurement.count, 0, 3), np.float32))
    return _carried(without, here, motion)


def _carried(points: Any, here: Bool[Array, "*n"], motion: "Motion") -> Any:
    positions, normals, geometric = (
        getattr(points, name).copy() for name in ("positions", "normals", "geometric_normals")
    )
    positions[here] = motion.points(positions[here])
    normals[here], geometric[here] = motion.vectors(normals[here]), motion.vectors(geometric[here])
    return replace(points, positions=positions, normals=normals, geometric_normals=geometric)


def faces_of(scene: Scene, part: str) -> Bool[Array, " f"]:
    """The faces of a part. Raises PrtnetError, naming those that there are."""
    names = [material.name for material in scene.materials]
    if part not in names:
        raise PrtnetError(f"keyframe: found no part {part!r} in {scene.name}, expected one of {', '.join(names)}")
    return np.isin(scene.part, [index for index, name in enumerate(names) if name == part])


@dataclass(frozen=True, eq=False)
class Motion:
    """A turn about a point and a move, in scene coordinates."""

    turn: Float64[Array, "3 3"]
    middle: Float64[Array, " 3"]
    move: Float64[Array, " 3"]

    @classmethod
    def of(cls, scene: Scene, pose: Pose) -> "Motion":
        corners = scene.vertices[scene.faces[faces_of(scene, pose.part)]].reshape(-1, 3)
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        return cls(turn_y(np.radians(pose.turn)), middle, np.asarray(pose.move, np.float64) / scene.frame.scale)

    def points(self, positions: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        return (positions - self.middle) @ self.turn.T + self.middle + self.move

    def vectors(self, directions: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        return directions @ self.turn.T
