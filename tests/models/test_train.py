import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from prtnet import PrtnetError, netspec, sh
from prtnet.models import checkpoint
from prtnet.models.recipe import ModelOptions, TrainOptions, published
from prtnet.models.run import Points, Run
from prtnet.models.train import calibrate, train
from tests.nets import random_points, random_uv

MODEL = ModelOptions(16, 2)
SHORT = TrainOptions(
    batch=256,
    position_frequencies=3,
    normal_frequencies=1,
    grid_cells=[],
    hash_cells=[],
    precision="float32",
    device="cpu",
    optimiser="adam",
)


def points(count=2000, seed=0):
    """A smooth made-up transfer: the open lobe, darkened in a checkerboard of soft spots."""
    positions, normals = random_points(count, seed)
    shade = 0.5 + 0.4 * np.sin(3 * positions[:, :1]) * np.cos(2 * positions[:, 1:2])
    transfer = (shade * sh.cosine_lobe(normals, 3)).astype(np.float32)
    return Points(positions, normals, transfer, uv=random_uv(count, seed))


def saved(result, path):
    netspec.save(result.net, path)
    return path.read_bytes()


def test_it_learns():
    test = points(500, seed=9)
    result = train(points(20_000), model=MODEL, options=SHORT, steps=400, held_out=test)
    found = netspec.evaluate_unit(result.net, test.positions, test.normals)
    np.testing.assert_allclose(result.held_out_rmse, np.sqrt(np.mean((found - test.transfer) ** 2, 0)), rtol=1e-4)
    open_points = np.sqrt(np.mean((sh.cosine_lobe(test.normals, 3) - test.transfer) ** 2))
    assert np.sqrt(np.mean(result.held_out_rmse**2)) < 0.2 * open_points
    assert len(result.history) == result.steps == 400
    assert result.history[-50:].mean() < 0.2 * result.history[:10].mean()
    assert result.cpu_seconds > 0


@pytest.mark.parametrize("options", [SHORT, replace(SHORT, optimiser="soap"), published()])
def test_the_seed_decides_everything(options, tmp_path):
    options = replace(options, batch=256)
    first, again, other = (
        saved(train(points(), model=MODEL, options=replace(options, seed=seed), steps=20), tmp_path / "net")
        for seed in (0, 0, 1)
    )
    assert first == again
    assert first != other


def test_each_epoch_visits_each_point_at_most_once():
    run = Run(points(1000), MODEL, SHORT, steps=12)
    seen = []
    for run.step in range(6):
        seen.append(run.table[run._chosen(), 0].numpy())
    first, second = np.concatenate(seen[:3]), np.concatenate(seen[3:])
    assert len(np.unique(first)) == len(np.unique(second)) == 768
    assert not np.array_equal(first, second)


VARIANTS = {
    "adam": SHORT,
    "soap": replace(SHORT, optimiser="soap"),
    "muon": replace(
        SHORT,
        optimiser="muon",
        average=0.95,
        precision="bfloat16",
        loss="radiance",
        grid_cells=[[4, 3, 2]],
        hash_cells=[8],
    ),
    "hard points": replace(SHORT, resample=0.5, loss="radiance", loss_gloss=10.0, texel_size=6),
}


def kill_at(step):
    """An on_log that ends the process the hard way."""

    def on_log(seen):
        if seen["step"] >= step:
            os.kill(os.getpid(), signal.SIGKILL)

    return on_log


def resumable(variant, folder, on_log=None, steps=300):
    options = replace(VARIANTS[variant], checkpoint_seconds=0.01)
    return train(
        points(),
        model=MODEL,
        options=options,
        steps=steps,
        held_out=points(100, 5),
        checkpoint_path=folder / "checkpoint.safetensors",
        log_dir=folder / "board",
        on_log=on_log,
    )


@pytest.mark.parametrize("variant", VARIANTS)
def test_killed_and_resumed_ends_in_the_same_bytes(variant, tmp_path, monkeypatch):
    whole = train(points(), model=MODEL, options=VARIANTS[variant], steps=300)
    code = f"from tests.models.test_train import *; resumable({variant!r}, Path({str(tmp_path)!r}), kill_at(60))"
    monkeypatch.setattr("prtnet.models.train._LOG_SECONDS", 0.0)
    patch = "import prtnet.models.train as t; t._LOG_SECONDS = 0.0; "
    killed = subprocess.run([sys.executable, "-c", patch + code], cwd=Path(__file__).parents[2], check=False)
    assert killed.returncode == -signal.SIGKILL
    left = checkpoint.load(tmp_path / "checkpoint.safetensors", _fingerprint(variant))
    assert left is not None
    assert 0 < left["counters"][0] <= 60
    time.sleep(1)  # TensorBoard orders its files by the second
    first_seen = []
    resumed = resumable(variant, tmp_path, lambda seen: first_seen.append(seen["step"]))
    assert first_seen[0] == left["counters"][0] + 1
    np.testing.assert_array_equal(resumed.history, whole.history)
    assert saved(resumed, tmp_path / "resumed") == saved(whole, tmp_path / "whole")
    _scalars_are_not_doubled(tmp_path / "board")


def _fingerprint(variant):
    return Run(points(), MODEL, VARIANTS[variant], 300).fingerprint(points())


def _scalars_are_not_doubled(folder):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    seen = EventAccumulator(str(folder))
    seen.Reload()
    steps = [event.step for event in seen.Scalars("loss")]
    assert steps == sorted(set(steps))
    assert steps[-1] == 300
    assert {"loss", "learning_rate", "steps_per_second", "held_out_rmse"} <= set(seen.Tags()["scalars"])
    assert seen.Tags()["images"] == ["coefficients"]


def test_a_finished_checkpoint_gives_the_net_at_once(tmp_path):
    first = resumable("adam", tmp_path, steps=20)
    again = resumable("adam", tmp_path, steps=20)
    assert saved(first, tmp_path / "a") == saved(again, tmp_path / "b")
    assert again.cpu_seconds == first.cpu_seconds


def test_truncated_and_foreign_checkpoints_are_not_used(tmp_path, caplog):
    whole = saved(resumable("adam", tmp_path, steps=20), tmp_path / "net")
    file = tmp_path / "checkpoint.safetensors"
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])
    assert saved(resumable("adam", tmp_path, steps=20), tmp_path / "net") == whole
    assert "not a whole checkpoint" in caplog.text
    resumable("adam", tmp_path, steps=30)
    assert "another run" in caplog.text


@pytest.mark.parametrize("options", [replace(SHORT, learning_rate=1e3, schedule="constant", residual=False)])
def test_divergence_stops_with_step_loss_rate_and_advice(options):
    with pytest.raises(PrtnetError, match=r"diverged at step \d+ of 2000.*mean loss of .* 1e\+03: lower train\.learn"):
        train(points(), model=MODEL, options=options, steps=2000)


def test_divergence_to_nan_is_found_early():
    run_away = replace(SHORT, learning_rate=1e30, schedule="constant", loss="l2")
    with pytest.raises(PrtnetError, match=r"step 50 of 2000: found a mean loss of (nan|inf)"):
        train(points(), model=MODEL, options=run_away, steps=2000)


@pytest.mark.parametrize(
    "change",
    [
        {"learning_rate": 1e9},
        {"learning_rate": 1e9, "optimiser": "soap", "matrix_rate": 1e9},
        {"learning_rate": 1e30, "optimiser": "soap", "resample": 0.5, "patience": 3},
        {"learning_rate": 1e30, "optimiser": "muon", "matrix_rate": 1e30, "loss": "radiance"},
    ],
)
@pytest.mark.parametrize("residual", [False, True])
def test_no_rate_is_so_high_that_a_net_comes_of_it(change, residual, tmp_path):
    options = replace(SHORT, schedule="constant", residual=residual, **change)
    calibrate(points(), model=MODEL, options=options)
    with pytest.raises(PrtnetError, match=r"diverged at step \d+ of 400.*lower train\.learning_rate"):
        train(points(), model=MODEL, options=options, steps=400, checkpoint_path=tmp_path / "checkpoint")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_is_found_before_the_first_step(tmp_path):
    (tmp_path / "file").write_text("here")
    seen, path = [], tmp_path / "file" / "checkpoint"
    with pytest.raises(PrtnetError, match=r"file/checkpoint: could not be written .*, expected a folder.*cache="):
        train(points(), model=MODEL, options=SHORT, steps=300, checkpoint_path=path, on_log=seen.append)
    assert not seen
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_threads_and_random_state_are_left_alone():
    torch.manual_seed(3)
    before, threads = torch.get_rng_state(), torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        rate = calibrate(points(), model=MODEL, options=SHORT)
        train(points(), model=MODEL, options=SHORT, steps=5)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(threads)
    assert rate > 10
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.parametrize(
    "change",
    [
        {"loss": "projection", "loss_samples": 16},
        {"loss": "radiance", "loss_norm": "l1", "band_falloff": 0.5, "dark_weight": 0.5},
        {"loss": "radiance", "loss_gloss": 10.0, "resample": 0.5, "dark_weight": 0.5, "patience": 8},
        {"grid_cells": [[6, 6, 3]], "grid_channels": 4, "position_frequencies": 0},
        {"encoding": "triangle", "activation": "relu", "optimiser": "muon"},
        {"encoding": "identity", "activation": "sine", "sine_omega": 10.0, "learning_rate": 0.005},
    ],
)
def test_every_part_learns(change):
    test = points(500, seed=9)
    result = train(points(20_000), model=MODEL, options=replace(SHORT, **change), steps=400, held_out=test)
    open_points = np.sqrt(np.mean((sh.cosine_lobe(test.normals, 3) - test.transfer) ** 2))
    assert np.sqrt(np.mean(result.held_out_rmse**2)) < 0.2 * open_points


def test_texels_learn_what_position_and_normal_do_not_say():
    known = points(20_000)
    assert known.uv is not None
    shade = 0.5 + 0.4 * np.sign(known.uv[:, :1] - 0.5)
    hidden = replace(known, transfer=(shade * sh.cosine_lobe(known.normals, 3)).astype(np.float32))
    rmse = []
    for size in (0, 8):
        options = replace(SHORT, texel_size=size, patience=20)
        result = train(hidden, model=MODEL, options=options, steps=400, held_out=hidden.at(slice(500)))
        rmse.append(np.sqrt(np.mean(result.held_out_rmse**2)))
    assert rmse[1] < 0.5 * rmse[0]


@pytest.mark.parametrize(
    ("uv", "message"),
    [
        (None, "found 0 texture coordinates for 2000 points"),
        (np.full((2000, 2), 1.5, np.float32), r"from 1\.5 to 1\.5, expected \[0, 1\]"),
        (np.full((2000, 2), np.nan, np.float32), "texture coordinates from nan"),
    ],
)
def test_coordinates_that_texels_cannot_be_learned_at_are_refused(uv, message):
    without = replace(points(), uv=uv)
    with pytest.raises(PrtnetError, match=message):
        train(without, model=MODEL, options=replace(SHORT, texel_size=4), steps=5)
    train(without, model=MODEL, options=SHORT, steps=5)


def test_the_progress_line_gets_what_it_needs():
    seen = []
    train(points(), model=MODEL, options=SHORT, steps=10, on_log=seen.append)
    assert set(seen[-1]) == {"step", "steps", "loss", "rate", "eta"}
    assert (seen[-1]["step"], seen[-1]["steps"], seen[-1]["eta"]) == (10, 10, 0)


@pytest.mark.parametrize(("activation", "half"), [("sine", False), ("hard_gelu", True)])
def test_sines_are_spared_bfloat16_unless_it_is_asked_for(activation, half, monkeypatch):
    monkeypatch.setattr("prtnet.models.run.fast_bfloat16", lambda device: True)
    options = replace(SHORT, activation=activation, precision="auto")
    assert Run(points(), MODEL, options, 5).bfloat16 == half
    assert Run(points(), MODEL, replace(options, precision="bfloat16"), 5).bfloat16


def test_bfloat16_learns_as_well_as_float32():
    test = points(500, seed=9)
    half, full = (
        train(points(), model=MODEL, options=replace(SHORT, precision=precision), steps=300, held_out=test)
        for precision in ("bfloat16", "float32")
    )
    assert half.held_out_rmse is not None
    assert full.held_out_rmse is not None
    assert half.held_out_rmse.mean() < 1.5 * full.held_out_rmse.mean()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"positions": np.zeros((0, 3)), "normals": np.zeros((0, 3)), "transfer": np.zeros((0, 9))},
            "and at least one",
        ),
        ({"positions": np.full((2000, 3), 2.0, np.float32)}, "positions up to 2"),
        ({"transfer": np.full((2000, 9), np.nan, np.float32)}, "transfer that is NaN"),
        ({"transfer": np.zeros((2000, 8), np.float32)}, "SH coefficients: found 8"),
    ],
)
def test_samples_that_cannot_be_learned_are_refused(change, message):
    with pytest.raises(PrtnetError, match=message):
        train(replace(points(), uv=None, **change), model=MODEL, options=SHORT, steps=5)
