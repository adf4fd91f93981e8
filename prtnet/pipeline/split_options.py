"""What the options of clusters mean: whether they fit together, and the job's configuration for one cluster."""

import math
from dataclasses import replace
from itertools import pairwise

from prtnet import PrtnetError
from prtnet.clusters import BORDERS, SELECTS
from prtnet.config import Config
from prtnet.models import recipe
from prtnet.models.recipe import TrainOptions

BY = ("grid", "parts", "count")
MOST = 1024  # leaves: the merge looks at all pairs of them


def check(config: Config) -> None:
    """Raises PrtnetError, naming the key, where the options of clusters mean nothing, before any work."""
    options = config.split
    if "clusters" not in config.methods:
        return
    for name, allowed in (("by", BY), ("border", BORDERS), ("select", SELECTS)):
        found = getattr(options, name)
        if found not in allowed:
            raise PrtnetError(f"split.{name}: found {found!r}, expected one of {', '.join(allowed)}")
    if len(options.cells) != 3 or min(options.cells) < 1 or math.prod(options.cells) > MOST:
        expected = f"three numbers of at least 1, and at most {MOST} cells"
        raise PrtnetError(f"split.cells: found {options.cells}, expected {expected}")
    for name, found in (("count", options.count), ("networks", options.networks)):
        if found is not None and not 1 <= found <= MOST:
            raise PrtnetError(f"split.{name}: found {found}, expected 1 to {MOST}")
    if not 0 <= options.delta < 1:
        raise PrtnetError(f"split.delta: found {options.delta}, expected 0 to less than 1: the scene is 2 long")
    if options.quality is not None and not 0 <= options.quality <= 1:
        raise PrtnetError(f"split.quality: found {options.quality}, expected a share of the variance, 0 to 1")
    if not 0 < options.grid_scale <= 1:
        raise PrtnetError(f"split.grid_scale: found {options.grid_scale}, expected more than 0 and at most 1")
    if config.train.texel_size:
        raise PrtnetError(
            f"train.texel_size: found {config.train.texel_size} with the method clusters, expected 0: texels are one"
            " image over the whole scene"
        )
    _check_drawing(config)


def _check_drawing(config: Config) -> None:
    if config.export.storage == "ubo":
        raise PrtnetError("export.storage: found ubo with the method clusters, expected auto, literal or texture")
    if config.split.select == "fragment" and sized(config):
        raise PrtnetError(
            "split.select: found fragment with a size for each cluster, expected split.select=draw: networks in one"
            " texture are of one size"
        )
    if config.split.select == "fragment" and config.split.by == "parts":
        raise PrtnetError(
            "split.select: found fragment with split.by=parts, expected split.select=draw: a fragment does not know its"
            " part"
        )


def sized(config: Config) -> bool:
    """Whether each cluster gets a network of its own size."""
    return "clusters" in config.methods and (config.split.size or "size" in config.stages)


def of_one(config: Config, share: float) -> Config:
    """The configuration of one cluster's training: its share of the time, its own grids."""
    train = replace(_scaled(config.train, config.split.grid_scale), cpu_seconds=config.train.cpu_seconds * share)
    return replace(config, train=train)


def _scaled(train: TrainOptions, scale: float) -> TrainOptions:
    """Fewer features: dense grids of fewer cells along each axis, tables of fewer entries, a power of two, for corners
    that become fewer on surfaces, as the square of the cells along an axis does."""
    if scale == 1:
        return train
    cells = [[max(1, round(side * scale ** (1 / 3))) for side in grid] for grid in train.grid_cells]
    least, entries = recipe.HASH_ENTRIES[0], train.hash_entries
    while entries > least and entries > 1.5 * scale * train.hash_entries:
        entries //= 2
    hashed = [max(1, round(side * math.sqrt(scale))) for side in train.hash_cells]
    return replace(train, grid_cells=cells, hash_cells=hashed, hash_entries=entries)


def least_points(config: Config, outputs: int) -> int:
    """Weights and biases of a cluster's network: with fewer points it learns them by heart. Features of grids do not
    count, most of which stand away from surfaces."""
    sizes = recipe.layer_sizes(config.model, config.train, outputs)
    return sum(columns * rows for columns, rows in pairwise(sizes)) + sum(sizes[1:])
