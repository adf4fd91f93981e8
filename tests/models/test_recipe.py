from dataclasses import asdict, replace
from pathlib import Path

import pytest
import yaml

from prtnet import PrtnetError, netspec
from prtnet.models import recipe
from prtnet.models.recipe import TrainOptions, published

CONFIGS = Path(__file__).resolve().parents[2] / "configs" / "train"


def test_published_is_what_was_published():
    """Sirikonda et al. 2022, section 4: L1 loss, Adam, batch 8192, leaky-ReLU 0.01, tanh, L = 10 and 4."""
    options = published()
    assert (options.loss, options.optimiser, options.schedule, options.batch) == ("l1", "adam", "constant", 8192)
    assert (options.activation, options.negative_slope, options.output) == ("leaky_relu", 0.01, "tanh")
    assert (options.position_frequencies, options.normal_frequencies, options.residual) == (10, 4, False)
    assert (options.average, options.dark_weight, options.band_falloff, options.warmup) == (0, 0, 0, 0)


@pytest.mark.parametrize(("name", "options"), [("published", published()), ("default", TrainOptions())])
def test_the_configuration_holds_the_same_figures(name, options):
    written = yaml.safe_load((CONFIGS / f"{name}.yaml").read_text())
    free = {"precision", "device", "seed", "steps", "cpu_seconds", "checkpoint_seconds"}
    assert written == {key: value for key, value in asdict(options).items() if key in written}
    left_out = set(asdict(options)) - set(written) - free
    assert not left_out or all(asdict(options)[key] == asdict(TrainOptions())[key] for key in left_out)


@pytest.mark.parametrize("file", sorted(CONFIGS.glob("*.yaml")), ids=lambda file: file.stem)
def test_recipes_pass_their_own_check(file):
    options = replace(TrainOptions(), **yaml.safe_load(file.read_text()))
    recipe.check(options)
    assert options.recipe == file.stem
    assert options.activation in netspec.ACTIVATIONS


@pytest.mark.parametrize(
    "change",
    [
        {"activation": "swish"},
        {"encoding": "hash"},
        {"sine_omega": 0.0},
        {"loss_norm": "huge"},
        {"loss_samples": 0},
        {"grid_format": "uint8"},
        {"grid_channels": 6},
        {"grid_cells": [[8, 8]]},
        {"hash_cells": [0]},
        {"hash_entries": 1000},
        {"hash_channels": 6},
        {"grid_cells": [[8, 0, 8]]},
        {"grid_cells": [[8, 8, 129]]},
        {"grid_cells": [[4, 4, 4]] * 5},
        {"texel_size": -1},
        {"texel_size": 2049},
        {"texel_channels": 6},
        {"output": "sigmoid"},
        {"loss": "mse"},
        {"optimiser": "sgd"},
        {"schedule": "step"},
        {"precision": "float16"},
        {"device": "gpu"},
        {"learning_rate": 0.0},
        {"batch": 0},
        {"warmup": 1.0},
        {"average": -0.1},
        {"steps": 0},
        {"cpu_seconds": -1.0},
        {"huber_delta": float("nan")},
        {"resample": 1.0},
        {"resample_correction": -1.0},
        {"patience": -1},
        {"loss_gloss": float("inf")},
        {"loss_gloss": 20.0},
    ],
)
def test_what_means_nothing_is_refused_by_name(change):
    (field,) = change
    with pytest.raises(PrtnetError, match=rf"train\.{field}: found"):
        recipe.check(replace(TrainOptions(), **change))
