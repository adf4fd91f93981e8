"""Meshes and light probes that others made. They are not part of the project; tests that want one skip without it."""

import os
from pathlib import Path

import pytest

ROOT = Path(os.environ.get("PRTNET_ASSETS", Path(__file__).resolve().parents[2] / "shared" / "assets"))


def asset(name: str) -> Path:
    """The file or folder `name` under the assets folder, or a skip that says how to un-skip."""
    path = ROOT / name
    if not path.exists():
        pytest.skip(f"{name} is absent from {ROOT}: put it there, or point PRTNET_ASSETS at a folder that has it")
    return path
