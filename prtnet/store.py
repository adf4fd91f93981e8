"""Artifacts: results kept on disk under the hash of what made them.

An artifact is a safetensors file `<stage>/<key>.safetensors` and, written after it, a record `<stage>/<key>.json` that
holds the inputs, the facts worth keeping beside the arrays, and the size and SHA-256 of the file. No record, or a
file that does not match it, means that the artifact does not exist and is made again.
"""

import fcntl
import glob
import hashlib
import json
import logging
import os
import shutil
import stat
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO, Any

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
    """A temporary path beside `path` that takes its place when the block ends well, and is deleted when it does not.

    Whatever writes the file, those may read it whom the umask lets. Raises PrtnetError where the folder cannot be
    written or is full.
    """
    # machines that share the folder have processes of equal numbers
    machine = f"{path.name}.{os.uname().nodename}"
    temporary = path.with_name(f".{machine}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _clear(path.parent, machine)
        mode = _usual_mode(temporary)
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
            # safetensors makes files for their owner alone
            if _mode(temporary) != mode:
                temporary.chmod(mode)
        temporary.replace(path)
    except (OSError, safetensors.SafetensorError) as error:
        raise _unwritable(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def _clear(folder: Path, machine: str) -> None:
    """Delete what processes of this machine that are no more, killed as they wrote the same file, have left."""
    for left in folder.glob(f".*{glob.escape(machine)}.*.tmp"):
        process = left.name.split(".")[-2]
        if process.isdecimal() and _ended(int(process)):
            left.unlink(missing_ok=True)


def _ended(process: int) -> bool:
    try:
        os.kill(process, 0)
    except OSError as error:
        return isinstance(error, ProcessLookupError)
    return False


def _mode(path: Path) -> int:
    """Permission bits."""
    return stat.S_IMODE(path.stat().st_mode)


def _usual_mode(unused: Path) -> int:
    """Permission bits of a file that is made at a path: there is no asking for the umask without changing it."""
    unused.touch()
    try:
        return _mode(unused)
    finally:
        unused.unlink()


def _unwritable(path: Path, error: Exception) -> PrtnetError:
    return PrtnetError(
        f"{path}: could not be written ({error}), expected a folder that can be written and has space left; make"
        " room, or choose another with out= and cache="
    )


@contextmanager
def alone(lock: Path) -> Iterator[None]:
    """Processes that name the same lock file are inside one after the other. A process that ends, however it does,
    gives the lock back. Raises PrtnetError where its folder cannot be written."""
    while True:
        with _opened(lock) as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            if not _same_file(file.fileno(), lock):
                continue  # the one before has deleted the file that was waited for
            try:
                yield
            finally:
                lock.unlink(missing_ok=True)
            return


def _opened(lock: Path) -> IO[str]:
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        return lock.open("w")
    except OSError as error:
        raise _unwritable(lock, error) from error


def _same_file(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically, UTF-8."""
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file atomically."""
    with atomic(path) as temporary:
        temporary.write_bytes(data)


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
    """A finished result: a safetensors file, and the facts recorded with it (plain JSON values)."""

    path: Path
    facts: dict[str, Any]

    @property
    def key(self) -> str:
        return self.path.stem

    @cached_property
    def arrays(self) -> Arrays:
        """What the file holds, read at the first use."""
        return load_arrays(self.path)


class Store:
    """All artifacts under one folder. Processes may share it: writes are atomic, equal keys mean equal bytes, and what
    one of them makes the others wait for."""

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
                return Artifact(path, record["facts"])
        except (FileNotFoundError, NotADirectoryError):
            if not path.exists():
                return None
        except (ValueError, KeyError) as error:
            log.debug("%s: record not readable: %s", path, error)
        log.warning("%s: truncated or altered, made again", path)
        return None

    def put(
        self, stage: str, inputs: Mapping[str, Any], write: Callable[[Path], None], facts: Mapping[str, Any]
    ) -> Artifact:
        """Keep what `write(path)` writes: first the file, then the record that makes it count."""
        path = self.path(stage, inputs)
        with atomic(path) as temporary:
            path.with_suffix(".json").unlink(missing_ok=True)
            write(temporary)
        record = {
            "stage": stage,
            "inputs": dict(inputs),
            "facts": dict(facts),
            "bytes": path.stat().st_size,
            "sha256": file_digest(path),
        }
        write_text(path.with_suffix(".json"), json.dumps(record, indent=1, sort_keys=True) + "\n")
        return Artifact(path, record["facts"])

    def once(self, stage: str, inputs: Mapping[str, Any], make: Callable[[], Artifact]) -> Artifact:
        """The artifact of these inputs. Where it is not there yet `make()` puts it, and other processes wait for it."""
        found = self.get(stage, inputs)
        if found is None:
            with alone(self.path(stage, inputs, ".lock")):
                # another process may have made it meanwhile
                return self.get(stage, inputs) or make()
        log.debug("%s: found %s", stage, found.path)
        return found

    def make(
        self, stage: str, inputs: Mapping[str, Any], make: Callable[[], tuple[Arrays, Mapping[str, Any]]]
    ) -> Artifact:
        """The artifact of these inputs, made by `make() -> (arrays, facts)` when it is not there yet."""

        def put() -> Artifact:
            arrays, facts = make()
            return self.put(stage, inputs, lambda path: save_arrays(path, arrays), facts)

        return self.once(stage, inputs, put)

    def put_shards(
        self,
        stage: str,
        inputs: Mapping[str, Any],
        items: int,
        size: int,
        make: Callable[[int, slice], Arrays],
    ) -> Artifact:
        """Put the rows of `items` items, made `size` at a time by make(shard, items of the shard), with their seconds.

        Each shard is kept as soon as it is there, until the whole artifact is: a killed run goes on, and what other
        processes have made by `shard` is found.
        """
        folder = shards_folder(stage, inputs)
        parts = [self.shard(folder, shard, items, size, make) for shard in range(shard_count(items, size))]
        whole = {name: np.concatenate([part.arrays[name] for part in parts]) for name in parts[0].arrays}
        facts = {"seconds": sum(part.facts["seconds"] for part in parts)}
        artifact = self.put(stage, inputs, lambda path: save_arrays(path, whole), facts)
        shutil.rmtree(self.root / folder, ignore_errors=True)
        return artifact

    def shard(self, folder: str, shard: int, items: int, size: int, make: Callable[[int, slice], Arrays]) -> Artifact:
        """One shard of `put_shards`, with a lock of its own: processes that make others do not wait for it."""

        def timed() -> tuple[Arrays, Mapping[str, Any]]:
            start = time.perf_counter()
            arrays = make(shard, slice(shard * size, min(items, (shard + 1) * size)))
            return arrays, {"seconds": time.perf_counter() - start}

        return self.make(folder, {"shard": shard}, timed)


def shards_folder(stage: str, inputs: Mapping[str, Any]) -> str:
    """The stage under which the shards of an artifact are kept until it is whole."""
    return f"{stage}/{content_key(inputs)}.shards"


def shard_count(items: int, size: int) -> int:
    """How many shards of `size` items there are."""
    return max(1, -(-items // size))
