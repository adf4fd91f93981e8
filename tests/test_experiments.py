"""The sweeps of configs/experiment: what they vary exists and can be trained, and a small one runs through."""

import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig, OmegaConf

from experiments import collect
from prtnet import PrtnetError, score
from prtnet.config import Config, register
from prtnet.export import form
from prtnet.models import recipe
from tests.models.test_board import read_back
from tests.small import overrides

CONFIGS = str(Path(__file__).resolve().parents[1] / "configs")
NAMES = ("network_size", "loss_ablation", "encoding_ablation", "ray_budget")


def composed(*arguments: str, hydra: bool = False) -> DictConfig:
    register()
    with initialize_config_dir(CONFIGS, version_base="1.3"):
        return compose("config", list(arguments), return_hydra_config=hydra)


@cache
def options_of(*arguments: str) -> Config:
    return OmegaConf.to_object(composed(*arguments))


def words_of(name: str) -> list[str]:
    params = composed(f"experiment={name}", hydra=True).hydra.sweeper.params
    return [word.strip() for word in params.ablation.split(",")]


POINTS = [(name, word) for name in NAMES for word in words_of(name)]


@pytest.mark.parametrize("name", NAMES)
def test_a_sweep_runs_two_points_at_a_time_with_three_seeds_from_the_default(name):
    hydra = composed(f"experiment={name}", hydra=True).hydra
    assert hydra.mode.name == "MULTIRUN"
    assert "joblib" in hydra.launcher._target_
    assert hydra.launcher.n_jobs == 2
    assert hydra.sweeper.params["train.seed"] == "0,1,2"
    words = words_of(name)
    assert words[0] == "none"
    assert len(words) == len(set(words)) > 4
    assert options_of(f"experiment={name}", "ablation=none") == options_of(f"experiment={name}")


@pytest.mark.parametrize(("name", "word"), POINTS)
def test_every_point_is_another_one_that_can_be_trained_and_exported(name, word):
    found = options_of(f"experiment={name}", f"ablation={word}")
    recipe.check(found.train)
    form.check_size(recipe.layer_sizes(found.model, found.train, 25), 1)
    assert found.out == f"runs/{name}"
    assert found.cache == f"{found.out}/cache"


@pytest.mark.parametrize("name", NAMES)
def test_points_of_a_sweep_differ(name):
    found = {word: options_of(f"experiment={name}", f"ablation={word}") for word in words_of(name)}
    default = found.pop("none")
    assert all(one == other or found[one] != found[other] for one in found for other in found)
    # one entry may be what the default happens to be
    assert sum(options == default for options in found.values()) <= 1


def test_the_ray_budget_is_one():
    found = [options_of("experiment=ray_budget", f"ablation={word}") for word in words_of("ray_budget")]
    assert {each.samples.count * (each.samples.directions or 0) for each in found} == {204_800_000}


def test_sizes_are_those_of_their_names():
    for word in words_of("network_size")[1:]:
        found = options_of("experiment=network_size", f"ablation={word}")
        assert word.removesuffix("_grids") == f"{found.model.width}x{found.model.depth}"
        assert bool(found.train.grid_cells) == word.endswith("_grids")


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A small sweep of two seeds with one loss that exists and one that does not."""
    out = tmp_path_factory.mktemp("sweep")
    points = ["ablation=none", "train.seed=0,1", "train.loss=huber,l3"]
    arguments = ["-m", "experiment=loss_ablation", *overrides(out, cache=out / "cache"), *points]
    command = subprocess.Popen([sys.executable, "-m", "prtnet", *arguments], stderr=subprocess.PIPE, text=True)
    _, errors = command.communicate(timeout=300)
    return out, command, errors, arguments


def test_two_points_at_a_time_leave_one_row_of_their_seeds(swept):
    out, command, errors, arguments = swept
    assert command.returncode == 2, errors
    assert "train.loss: found 'l3'" in errors
    rows, _ = score.read(out / "score.json")
    names = {f"train.loss=huber,train.seed={seed}" for seed in (0, 1)}
    assert {row.point for row in rows} == names
    table = (out / "table.md").read_text()
    assert "(2)" in next(line for line in table.splitlines() if line.startswith("| net | traced |"))
    assert len([line for line in table.splitlines() if line.startswith("| texture |")]) == 1
    assert (out / "command.txt").read_text() == f"prtnet {' '.join(arguments)}\n"
    events = [next((out / name / "tensorboard").glob("events.*")) for name in names]
    assert all(file.name.split(".")[-2] != str(command.pid) for file in events), "in processes of their own"
    assert len(list((out / "cache" / "training").glob("*.safetensors"))) == 1
    assert not list((out / "cache").rglob("*.lock"))


def test_each_point_has_its_line_in_tensorboard(swept):
    out = swept[0]
    rows, _ = score.read(out / "score.json")
    for row in rows:
        if row.method == "net" and row.reference == "traced":
            options, metrics = read_back(out / str(row.point) / "tensorboard" / "point")
            assert options == {"train.loss": "huber", "train.seed": float(str(row.point)[-1])}
            for key in ("psnr", "psnr_worst", "macs", "bytes"):
                assert metrics[key] == pytest.approx(getattr(row, key), rel=1e-6)
            assert 0 < metrics["transfer_rmse"] < 1


def test_results_are_taken_into_the_study(swept, tmp_path):
    folder = tmp_path / "study" / "results"
    collect.collect_sweep(swept[0], folder)
    assert {file.name for file in folder.iterdir()} == {*collect.SUMMARY, "lobes.png", "command.txt"}
    command, commit = (folder / "command.txt").read_text().splitlines()
    assert command.startswith("prtnet -m experiment=loss_ablation")
    assert commit.startswith("# collected at commit ")


def test_a_sweep_that_is_not_there_is_refused_before_results_are_dropped(tmp_path):
    folder = tmp_path / "results"
    folder.mkdir()
    (folder / "table.md").write_text("kept")
    with pytest.raises(PrtnetError, match=r"score\.json"):
        collect.collect_sweep(Path(tmp_path / "runs"), folder)
    assert (folder / "table.md").exists()
