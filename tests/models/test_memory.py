import subprocess
import sys

import pytest
import torch

from prtnet import PrtnetError
from prtnet.models import memory
from prtnet.models.recipe import ModelOptions, TrainOptions
from prtnet.models.train import calibrate, train
from tests.models.test_train import SHORT, points, replace

CPU = torch.device("cpu")


@pytest.mark.parametrize("optimiser", ["adam", "soap", "muon"])
@pytest.mark.parametrize("begin", [calibrate, lambda *a, **b: train(*a, steps=5, **b)])
def test_a_net_too_large_for_memory_is_refused_before_it_is_made(begin, optimiser):
    with pytest.raises(PrtnetError, match=r"4 layers of 300000.*need about .*GB.*expected at most.*lower model\.width"):
        begin(points(), model=ModelOptions(300_000, 4), options=replace(SHORT, optimiser=optimiser))


@pytest.mark.parametrize(
    ("width", "options", "count", "key"),
    [
        (4096, TrainOptions(), 1000, "model.width"),
        (64, TrainOptions(batch=10**9), 10**8, "train.batch"),
        (64, TrainOptions(), 10**9, "samples.count"),
        (64, TrainOptions(texel_size=2048), 1000, "train.texel_size"),
    ],
)
def test_the_message_names_what_takes_most(width, options, count, key, monkeypatch):
    monkeypatch.setattr(memory, "available", lambda device: 1e9)
    with pytest.raises(PrtnetError, match=f"lower {key}"):
        memory.check(ModelOptions(width, 4), options, 25, count, CPU)


def test_a_container_s_limit_counts(tmp_path, monkeypatch):
    (tmp_path / "memory.max").write_text("5000000\n")
    (tmp_path / "memory.stat").write_text("anon 2000000\nfile 2500000\n")
    monkeypatch.setattr(memory, "_CONTAINER", tmp_path)
    assert memory.available(CPU) == 3e6
    (tmp_path / "memory.max").write_text("max\n")
    assert memory.available(CPU) > 3e6


_MEASURE = """
from pathlib import Path
from tests.models.test_memory import *
options, model = replace(TrainOptions(), optimiser="{}", device="cpu", batch=2048), ModelOptions({}, 4)
print(memory.needed(model, options, 9, 2000))
train(points(), model=model, options=options, steps=3)
print(1024 * int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]))
"""


@pytest.mark.parametrize(("optimiser", "width"), [("adam", 2048), ("soap", 1024)])
def test_the_estimate_is_near_what_a_run_takes(optimiser, width):
    """At least three quarters of it, and not twice as much. What getrusage tells may be the parent's, from the fork."""
    code = _MEASURE.format(optimiser, width)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    estimate, taken = map(float, done.stdout.split())
    assert 0.75 * taken < estimate < 2 * taken
