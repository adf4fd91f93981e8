"""The command line: help, typed keys, messages without tracebacks, sweeps."""

import subprocess
import sys

import pytest

from tests.small import overrides


def prtnet(*arguments: str, folder=None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error::ResourceWarning", "-m", "prtnet", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=folder, check=False)


def test_help_and_configuration_are_shown():
    assert "scene.path=" in prtnet("--help").stdout
    shown = prtnet("--cfg", "job", "model.width=24", "--resolve").stdout
    assert "width: 24" in shown
    for key in ("directions:", "count:", "cpu_seconds:", "views:", "size:", "bands:"):
        assert key in shown


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("model.widht=3", ["widht"]),
        ("model.width=wide", ["model.width", "wide"]),
        ("scene=plnts", ["plnts", "plants"]),
        ("train=defualt", ["defualt", "default"]),
        ("material=shiny", ["shiny", "glossy", "diffuse"]),
        ("material.specular=red", ["material.specular", "red"]),
    ],
)
def test_wrong_keys_and_types_are_refused_by_name(argument, words):
    done = prtnet(argument)
    assert done.returncode == 1
    assert all(word in done.stderr for word in words)
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("scene.path=absent.obj", ["absent.obj"]),
        ("scene.name=plnts", ["plnts", "plants"]),
        ("stages=[bke]", ["bke", "bake, size, train, export, score"]),
        ("render.size=0", ["render.size", "0"]),
        ("light.path=absent.exr", ["absent.exr"]),
        ("light.name=moon", ["light.name", "moon", "sky, constant"]),
        ("light.window=hamming", ["light.window", "hamming"]),
        ("light.sun.radius=-1 light.name=sun", ["light.sun.radius", "-1"]),
        ("transfer.kind=spiral", ["spiral", "cosine_fibonacci"]),
        ("transfer.transport=shady", ["transfer.transport", "shady", "unshadowed, shadowed"]),
        ("transfer.bounces=0", ["transfer.bounces", "0", "at least 1"]),
        ("vertex.subdivide=[flor]", ["vertex.subdivide", "flor", "floor"]),
        ("train.loss=l3", ["train.loss", "l3"]),
        ("material.exponent=0", ["material.exponent", "0", "above 0"]),
        ("material.specular=[0.5,0.5]", ["material.specular", "[0.5, 0.5]", "3"]),
        ("material.product=triple", ["material.product", "triple", "fixed_light, full"]),
        ("material.diffuse=-1", ["material.diffuse", "-1"]),
        ("samples.count=0", ["samples.count", "0", "at least 1"]),
        ("train.patience=-1", ["train.patience", "-1"]),
        ("stages=[train] model.width=300000 model.depth=4", ["300000", "GB of memory", "lower model.width"]),
        ("train.learning_rate=1e9 train.matrix_rate=1e9 train.steps=400", ["diverged", "lower train.learning_rate"]),
    ],
)
def test_errors_are_messages_not_tracebacks(argument, words, tmp_path):
    done = prtnet(*overrides(tmp_path), *argument.split())
    assert done.returncode == 2, done.stderr
    message = done.stderr.strip().splitlines()[-1]
    assert message.startswith("prtnet: ")
    assert all(word in message for word in words)
    assert "Traceback" not in done.stderr
    assert not list((tmp_path / "cache" / "net").glob("*"))


@pytest.mark.parametrize("key", ["cache", "out"])
def test_a_folder_that_cannot_be_written_is_named(key, tmp_path):
    (tmp_path / "file").write_text("")
    done = prtnet(*overrides(tmp_path / "out"), f"{key}={tmp_path / 'file' / 'folder'}")
    assert done.returncode == 2, done.stderr
    assert "could not be written" in done.stderr
    assert "expected a folder that can be written" in done.stderr


def test_gloss_in_more_bands_than_a_shader_holds_is_refused_before_any_work(tmp_path):
    done = prtnet(*overrides(tmp_path, transfer__bands=9), "material=glossy")
    assert done.returncode == 2
    assert "transfer.bands: found 9, expected at most 8" in done.stderr
    assert not (tmp_path / "cache").exists()


def test_a_sweep_gives_each_point_a_folder_and_shares_the_bake(tmp_path):
    done = prtnet("-m", *overrides(tmp_path, stages="[train]"), "model.width=4,8")
    assert done.returncode == 0, done.stderr
    points = [path.name for path in tmp_path.iterdir() if "model.width" in path.name]
    assert len(points) == 2
    assert len(list((tmp_path / "cache" / "training").glob("*.safetensors"))) == 1
    assert len(list((tmp_path / "cache" / "net").glob("*.safetensors"))) == 2
