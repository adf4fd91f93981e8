"""A job that takes seconds, for tests of what the whole path gives."""

from pathlib import Path

SETTINGS = {
    "scene.name": "cornell",
    "scene.tessellation": 0.25,
    "samples.count": 3000,
    "samples.test_count": 200,
    "transfer.directions": 32,
    "transfer.bands": 3,
    "atlas.size": 64,
    "model.width": 8,
    "model.depth": 1,
    "train.steps": 60,
    "train.batch": 512,
    "render.size": 32,
    "render.views": 2,
    "render.traced_directions": 64,
}


def overrides(out: Path, **changes: object) -> list[str]:
    """The small job as command-line arguments; dots in the names of changes are written as __."""
    values = SETTINGS | {name.replace("__", "."): value for name, value in changes.items()}
    return [f"out={out}", *(f"{name}={value}" for name, value in values.items())]
