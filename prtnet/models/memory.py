"""How much memory a training run takes, before it is taken: the system ends a process that takes too much, unasked."""

from itertools import pairwise
from pathlib import Path

import torch

from prtnet import PrtnetError, console
from prtnet.models.recipe import ModelOptions, TrainOptions, feature_count, layer_sizes

_MACHINE, _CONTAINER = Path("/proc/meminfo"), Path("/sys/fs/cgroup")
_COMMON = 400e6  # torch itself, and what its kernels hold in passing


def needed(model: ModelOptions, options: TrainOptions, outputs: int, points: int) -> float:
    """Bytes of weights, gradients, the optimiser's state, the activations of a batch and the table of points."""
    sizes = layer_sizes(model, options, outputs)
    matrices = sum(rows * columns for columns, rows in pairwise(sizes))
    # weight, gradient, and a copy in checkpoints; adam and soap keep two moments, muon one
    values = (6 if options.average else 5) * (matrices + feature_count(options) + sum(sizes[1:]))
    if options.optimiser == "soap":
        # of each matrix, two means of products with their bases, and three products in passing
        values += sum(2 * (rows**2 + columns**2) for columns, rows in pairwise(sizes))
        values += 3 * max(max(rows, columns) ** 2 for columns, rows in pairwise(sizes))
    # before and after each activation, and gradients of both
    values += 4 * min(options.batch, points) * sum(sizes)
    # the table, and what it is made of
    values += 3 * points * _row(options, outputs)
    return 4.0 * values + _COMMON


def _row(options: TrainOptions, outputs: int) -> int:
    """Numbers that are kept of a point: position, normal and weight, and the texture coordinate where it is needed."""
    return 7 + 2 * bool(options.texel_size) + outputs


def available(device: torch.device) -> float:
    """Bytes that can still be taken: of the GPU, or of the machine and of the container that the process runs in."""
    if device.type == "cuda":
        return float(torch.cuda.mem_get_info(device)[0])
    free = float("inf")
    if _MACHINE.exists():
        free = 1024.0 * int(_fields(_MACHINE)["MemAvailable:"])
    limit, used = _CONTAINER / "memory.max", _CONTAINER / "memory.stat"
    if limit.exists() and used.exists() and limit.read_text().strip() != "max":
        # files in the cache do not count: they give way
        free = min(free, float(limit.read_text()) - int(_fields(used)["anon"]))
    return free


def _fields(path: Path) -> dict[str, str]:
    """The first two words of each line."""
    return {words[0]: words[1] for words in map(str.split, path.read_text().splitlines())}


def check(model: ModelOptions, options: TrainOptions, outputs: int, points: int, device: torch.device) -> None:
    """Raises PrtnetError for a run that does not fit into memory."""
    need, free = needed(model, options, outputs, points), available(device)
    if need > free:
        raise PrtnetError(
            f"training: found that {model.depth} layers of {model.width} with train.optimiser={options.optimiser},"
            f" batches of {options.batch} and {points} points need about {console.size(need)} of memory, expected at"
            f" most the {console.size(free)} that are free; lower {_lower(model, options, outputs, points)}"
        )


def _lower(model: ModelOptions, options: TrainOptions, outputs: int, points: int) -> str:
    """The largest part of it."""
    net, batch = needed(model, options, outputs, 1), needed(model, options, outputs, min(options.batch, points))
    texels = 20.0 * options.texel_size**2 * options.texel_channels
    parts = {"model.width": net - texels, "train.texel_size": texels, "train.batch": batch - net}
    parts["samples.count"] = 12.0 * points * _row(options, outputs)
    return max(parts, key=lambda name: parts[name])
