"""Artifacts: results kept on disk under the hash of what made them.

An artifact is a safetensors file `<stage>/<key>.safetensors` and, written after it, a record `<stage>/<key>.json` that
holds the inputs, the facts worth keeping beside the arrays, and the size and SHA-256 of the file. No record, or a
file that does not match it, means that the artifact does not exist and is made again.
"""

import hashlib
import json
import logging
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy

from prtnet import PrtnetError

log = logging.getLogger(__name__)

Arrays = dict[str, np.ndarray]


def content_key(inputs: Mapping[str, Any]) -> str:
    """20 hex digits of the SHA-256 of the canonical JSON of `inputs` (plain values only)."""
    text = json.dumps(inputs, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def file_digest(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """A temporary path beside `path` that takes its place when the block ends well, and is deleted when it does not."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, UTF-8."""
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def save_arrays(path: Path, arrays: Arrays, metadata: Mapping[str, str] | None = None) -> None:
    """Write arrays as safetensors, atomically. Inverse of `load_arrays`."""
    with atomic(path) as temporary:
        contiguous = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
        safetensors.numpy.save_file(contiguous, temporary, dict(metadata) if metadata else None)


def load_arrays(path: Path) -> Arrays:
    """Read a safetensors file. Raises PrtnetError, naming the file, when it is missing, truncated or no safetensors."""
    try:
        return safetensors.numpy.load_file(path)
    except FileNotFoundError:
        raise PrtnetError(f"{path}: no such file") from None
    except (safetensors.SafetensorError, OSError, ValueError) as error:
        raise PrtnetError(f"{path}: not a whole safetensors file ({error}); delete it and make it again") from None


@dataclass(frozen=True)
class Artifact:
    """A finished result: its arrays, the facts recorded with them (plain JSON values) and its key."""

    key: str
    arrays: Arrays
    facts: dict[str, Any]


class Store:
    """All artifacts under one folder. Processes may share it: writes are atomic, equal keys mean equal bytes."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def path(self, stage: str, inputs: Mapping[str, Any], suffix: str = ".safetensors") -> Path:
        """Where the artifact of these inputs lies, whether or not it exists."""
        return self.root / stage / f"{content_key(inputs)}{suffix}"

    def get(self, stage: str, inputs: Mapping[str, Any]) -> Artifact | None:
        """The artifact, or None when it is absent, truncated or altered (said in the log)."""
        path = self.path(stage, inputs)
        try:
            record = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
            if path.stat().st_size == record["bytes"] and file_digest(path) == record["sha256"]:
                return Artifact(content_key(inputs), load_arrays(path), record["facts"])
        except FileNotFoundError:
            if not path.exists():
                return None
        except (ValueError, KeyError):
            pass
        log.warning("%s: truncated or altered, made again", path)
        return None

    def put(self, stage: str, inputs: Mapping[str, Any], arrays: Arrays, facts: Mapping[str, Any]) -> Artifact:
        """Write an artifact: first the arrays, then the record that makes them count."""
        path = self.path(stage, inputs)
        path.with_suffix(".json").unlink(missing_ok=True)
        save_arrays(path, arrays)
        record = {
            "stage": stage,
            "inputs": dict(inputs),
            "facts": dict(facts),
            "bytes": path.stat().st_size,
            "sha256": file_digest(path),
        }
        write_text(path.with_suffix(".json"), json.dumps(record, indent=1, sort_keys=True) + "\n")
        return Artifact(content_key(inputs), arrays, dict(facts))

    def make(
        self, stage: str, inputs: Mapping[str, Any], make: Callable[[], tuple[Arrays, Mapping[str, Any]]]
    ) -> Artifact:
        """The artifact of these inputs, made by `make() -> (arrays, facts)` when it is not there yet."""
        found = self.get(stage, inputs)
        if found is not None:
            log.info("%s: found %s", stage, found.key)
            return found
        return self.put(stage, inputs, *make())

    def shards(
        self, stage: str, inputs: Mapping[str, Any], count: int, make: Callable[[int], np.ndarray]
    ) -> list[np.ndarray]:
        """The results of make(0) .. make(count - 1), each kept as soon as it is there: a killed run goes on.

        Call `drop_shards` once the whole artifact has been put.
        """
        folder = f"{stage}.shards/{content_key(inputs)}"
        parts = []
        for shard in range(count):
            found = self.get(folder, {"shard": shard})
            found = found or self.put(folder, {"shard": shard}, {"shard": make(shard)}, {})
            parts.append(found.arrays["shard"])
        return parts

    def drop_shards(self, stage: str, inputs: Mapping[str, Any]) -> None:
        """Delete the shards of an artifact."""
        shutil.rmtree(self.root / f"{stage}.shards" / content_key(inputs), ignore_errors=True)
