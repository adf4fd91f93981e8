"""TensorBoard reads back what was written for a point of a sweep."""

from pathlib import Path

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.hparams import plugin_data_pb2

from prtnet.models import board


def read_back(folder: Path) -> tuple[dict[str, object], dict[str, float]]:
    """The options and the metrics of a folder's event files."""
    events = EventAccumulator(str(folder)).Reload()
    start = events.summary_metadata["_hparams_/session_start_info"].plugin_data.content
    options = plugin_data_pb2.HParamsPluginData.FromString(start).session_start_info.hparams
    metrics = {tag: events.Scalars(tag)[-1].value for tag in events.Tags()["scalars"]}
    return {key: getattr(value, value.WhichOneof("kind")) for key, value in options.items()}, metrics


def test_options_and_metrics_of_a_point_are_read_back(tmp_path):
    board.hyperparameters(tmp_path / "point", {"ablation": "none", "train.seed": 1.0}, {"psnr": 34.5, "macs": 17400.0})
    assert read_back(tmp_path / "point") == (
        {"ablation": "none", "train.seed": 1.0},
        {"psnr": 34.5, "macs": 17400.0},
    )


def test_a_point_that_is_written_again_is_there_once(tmp_path):
    for level in (30.0, 31.0):
        board.hyperparameters(tmp_path / "point", {"a": 1.0}, {"psnr": level})
    events = EventAccumulator(str(tmp_path / "point")).Reload()
    assert [scalar.value for scalar in events.Scalars("psnr")] == [31.0]
