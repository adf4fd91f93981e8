"""Artifacts survive kills and truncation; equal inputs give equal keys."""

import json
import multiprocessing
import os
import signal
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from prtnet import PrtnetError, store


@pytest.fixture
def shelf(tmp_path):
    return store.Store(tmp_path / "cache")


ARRAYS = {"a": np.arange(12, dtype=np.float32).reshape(3, 4), "b": np.array([7], np.int32)}


def test_put_and_get_are_inverse(shelf):
    shelf.make("bake", {"count": 3}, lambda: (ARRAYS, {"seconds": 1.5}))
    found = shelf.get("bake", {"count": 3})
    assert found is not None
    assert found.facts == {"seconds": 1.5}
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(found.arrays[name], array)
    assert shelf.get("bake", {"count": 4}) is None


def test_make_runs_once(shelf):
    calls = []

    def make():
        calls.append(1)
        return ARRAYS, {}

    first = shelf.make("bake", {"x": 1}, make)
    second = shelf.make("bake", {"x": 1}, make)
    assert len(calls) == 1
    assert first.key == second.key


@pytest.mark.parametrize("harm", ["truncate", "flip", "no record", "half a record"])
def test_a_harmed_artifact_is_made_again(shelf, harm, caplog):
    shelf.make("bake", {}, lambda: (ARRAYS, {}))
    path = shelf.path("bake", {})
    data = path.read_bytes()
    if harm == "truncate":
        path.write_bytes(data[:-3])
    elif harm == "flip":
        path.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    elif harm == "no record":
        path.with_suffix(".json").unlink()
    else:
        path.with_suffix(".json").write_text(path.with_suffix(".json").read_text()[:20])
    assert shelf.get("bake", {}) is None
    assert "made again" in caplog.text
    again = shelf.make("bake", {}, lambda: (ARRAYS, {"again": True}))
    assert again.facts == {"again": True}
    assert shelf.get("bake", {}) is not None


def test_keys_do_not_depend_on_order_but_on_values():
    assert store.content_key({"a": 1, "b": [2.5]}) == store.content_key({"b": [2.5], "a": 1})
    assert store.content_key({"a": 1}) != store.content_key({"a": 2})


def test_atomic_leaves_nothing_behind_when_it_fails(tmp_path):
    target = tmp_path / "file.txt"
    target.write_text("old")

    def write_half():
        with store.atomic(target) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_half()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def _dies_as_it_writes(path: Path) -> None:
    with store.atomic(path) as outer, store.atomic(outer) as temporary:
        temporary.write_text("half")
        os.kill(os.getpid(), signal.SIGKILL)


def test_what_a_killed_process_left_is_cleared_when_the_file_is_written_again(tmp_path):
    written = tmp_path / "written"
    killed = multiprocessing.get_context("spawn").Process(target=_dies_as_it_writes, args=(written,))
    killed.start()
    killed.join()
    assert len(list(tmp_path.iterdir())) == 1
    with store.atomic(written) as temporary:
        temporary.write_text("whole")
    assert list(tmp_path.iterdir()) == [written]
    assert written.read_text() == "whole"


def test_shards_go_on_where_they_were(shelf):
    made = []

    def make(shard, items, stop_at=99):
        if shard == stop_at:
            raise KeyboardInterrupt
        made.append(shard)
        return {"item": np.arange(items.start, items.stop)}

    with pytest.raises(KeyboardInterrupt):
        shelf.put_shards("bake", {}, 7, 2, lambda shard, items: make(shard, items, stop_at=2))
    whole = shelf.put_shards("bake", {}, 7, 2, make)
    assert made == [0, 1, 2, 3]
    np.testing.assert_array_equal(whole.arrays["item"], np.arange(7))
    assert sorted(path.suffix for path in (shelf.root / "bake").iterdir()) == [".json", ".safetensors"]


def test_load_arrays_names_the_file(tmp_path):
    with pytest.raises(PrtnetError, match="absent"):
        store.load_arrays(tmp_path / "absent.safetensors")
    (tmp_path / "text.safetensors").write_text(json.dumps({"no": "tensor"}))
    with pytest.raises(PrtnetError, match=r"text\.safetensors"):
        store.load_arrays(tmp_path / "text.safetensors")


@pytest.mark.parametrize("stage", ["texture", "blocked"])
def test_a_folder_that_cannot_be_written_is_named(stage, tmp_path):
    (tmp_path / "blocked").write_text("a file")
    shelf = store.Store(tmp_path / "blocked" if stage == "texture" else tmp_path)
    with pytest.raises(PrtnetError, match=r"blocked/.*: could not be written .*expected a folder.*cache="):
        shelf.make(stage, {"size": 1}, lambda: ({"a": np.zeros(3)}, {}))
    assert [path.name for path in tmp_path.iterdir()] == ["blocked"]


def test_a_write_that_fails_leaves_what_was_there(tmp_path):
    path = tmp_path / "kept"
    path.write_text("before")

    def fail():
        with store.atomic(path) as temporary:
            temporary.write_text("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(PrtnetError, match="No space left"):
        fail()
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("kept", "before")]


def _slowly(log: Path) -> tuple[store.Arrays, dict[str, float]]:
    with log.open("a") as file:
        file.write("made\n")
    time.sleep(0.3)
    return ARRAYS, {}


def _make_slowly(root: Path, log: Path) -> None:
    store.Store(root).make("bake", {"x": 1}, partial(_slowly, log))


def test_processes_wait_for_the_one_that_makes_an_artifact(tmp_path):
    start = multiprocessing.get_context("spawn")
    several = [start.Process(target=_make_slowly, args=(tmp_path / "cache", tmp_path / "log")) for _ in range(3)]
    for each in several:
        each.start()
    for each in several:
        each.join(60)
        assert each.exitcode == 0
    assert (tmp_path / "log").read_text() == "made\n"
    assert not list((tmp_path / "cache").rglob("*.lock"))


def test_a_lock_is_given_back_when_its_block_fails(tmp_path):
    (tmp_path / "locks").mkdir()
    (tmp_path / "locks" / "a").touch()  # of a process that was killed
    for _ in range(2):
        with pytest.raises(RuntimeError), store.alone(tmp_path / "locks" / "a"):
            raise RuntimeError
    assert not list((tmp_path / "locks").iterdir())


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o027, 0o640)])
def test_files_may_be_read_by_whom_the_umask_lets(tmp_path, shelf, umask, mode):
    before = os.umask(umask)
    try:
        store.save_arrays(tmp_path / "arrays.safetensors", ARRAYS)
        store.write_bytes(tmp_path / "bytes", b"1")
        shelf.make("bake", {}, lambda: (ARRAYS, {}))
    finally:
        os.umask(before)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) == 4
    assert {oct(path.stat().st_mode & 0o777) for path in files} == {oct(mode)}


def test_a_block_that_writes_nothing_leaves_nothing(tmp_path):
    with pytest.raises(PrtnetError, match="could not be written"), store.atomic(tmp_path / "file"):
        pass
    assert list(tmp_path.iterdir()) == []
