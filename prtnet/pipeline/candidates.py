"""The networks that stage `size` chooses from, their costs, and the job with one of them."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from prtnet import PrtnetError
from prtnet.config import Config
from prtnet.export.form import Form
from prtnet.models import recipe
from prtnet.size import COSTS, VIEWS, Candidate, within

# the unoccluded lobe, and a linear layer on position and normal
LOBE = {
    "model.depth": 0,
    "train.encoding": "identity",
    "train.residual": True,
    "train.grid_cells": [],
    "train.hash_cells": [],
    "train.texel_size": 0,
}

# settings beside the recipe's own
GRIDS: dict[str, dict[str, Any]] = {
    "none": {"train.grid_cells": [], "train.hash_cells": [], "train.texel_size": 0},
    "dense": {"train.hash_cells": [], "train.texel_size": 0},
    "recipe": {},
}


def space(config: Config, outputs: int, shading: int) -> tuple[list[Candidate], list[Candidate]]:
    """The candidates of a job, and those that would be some but for being too large for the storage of the export.

    `outputs`: coefficients of all groups; `shading`: multiply-adds of a pixel besides those of the net.
    """
    fit, large, form = [], [], form_of(config)
    for candidate in {each.name: each for each in _all(config, outputs, shading)}.values():
        try:
            groups = 4 if config.transfer.transport == "interreflected" else 1
            form.of_sizes(_sizes(configured(config, candidate), outputs), groups)
            fit.append(candidate)
        except PrtnetError:
            large.append(candidate)
    return fit, large


def form_of(config: Config) -> Form:
    """How the network is exported. Raises PrtnetError, naming the key, for a word that means nothing."""
    options = config.export
    return Form(options.version, options.storage, options.precision, options.digits)


def configured(config: Config, candidate: Candidate) -> Config:
    """The job's configuration with that network."""
    changes: dict[str, dict[str, Any]] = {"model": {}, "train": {}}
    for key, value in candidate.settings.items():
        group, name = key.split(".")
        changes[group][name] = value
    model, train = replace(config.model, **changes["model"]), replace(config.train, **changes["train"])
    return replace(config, model=model, train=train)


def check(config: Config, outputs: int, shading: int) -> None:
    """Raises PrtnetError where there is nothing to search for, or nowhere."""
    options = config.size
    if not {"net", "clusters"} & set(config.methods):
        raise PrtnetError(f"stages: found size with methods={config.methods}, expected net or clusters among them")
    for name, allowed in (("view", VIEWS), ("cost", COSTS)):
        found = getattr(options, name)
        if found not in allowed:
            raise PrtnetError(f"size.{name}: found {found!r}, expected one of {', '.join(allowed)}")
    for name in ("target_psnr", "max_macs", "max_bytes"):
        found = getattr(options, name)
        if found is not None and not 0 < found < float("inf"):
            raise PrtnetError(f"size.{name}: found {found}, expected above 0")
    if options.target_psnr is None and options.max_macs is None and options.max_bytes is None:
        raise PrtnetError(
            "size: found neither a target nor a budget, expected size.target_psnr=, size.max_macs= or size.max_bytes="
        )
    for name, least in (("widths", 1), ("depths", 0)):
        found = getattr(options, name)
        needed = name == "depths" or any(options.depths)
        if (needed and not found) or any(value < least for value in found):
            raise PrtnetError(f"size.{name}: found {list(found)}, expected one or more numbers of at least {least}")
    if not options.grids or not set(options.grids) <= set(GRIDS):
        raise PrtnetError(f"size.grids: found {list(options.grids)}, expected some of {', '.join(GRIDS)}")
    fit, large = space(config, outputs, shading)
    if large and not fit:
        names = ", ".join(each.name for each in large)
        raise PrtnetError(
            f"size: found only networks too large to export as literals ({names}), expected smaller ones, or "
            "export.storage=auto"
        )
    within(fit, max_macs=options.max_macs, max_bytes=options.max_bytes)


def _all(config: Config, outputs: int, shading: int) -> Iterator[Candidate]:
    options = config.size
    if 0 in options.depths:
        yield _candidate(config, "lobe + linear", LOBE, outputs, shading)
    for word in options.grids:
        family, after = GRIDS[word], {"none": "", "dense": " + dense grids", "recipe": " + grids"}[word]
        if not recipe.feature_count(config.train):
            after = ""
        for depth in options.depths:
            if depth == 0:
                yield _candidate(config, f"linear{after}", {"model.depth": 0, **family}, outputs, shading)
                continue
            for width in options.widths:
                settings = {"model.width": width, "model.depth": depth, **family}
                yield _candidate(config, f"{width} x {depth}{after}", settings, outputs, shading)


def _candidate(config: Config, name: str, settings: dict[str, Any], outputs: int, shading: int) -> Candidate:
    bare = Candidate(name, 0, 0, "", 0, 0, settings)
    made = configured(config, bare)
    sizes, train = _sizes(made, outputs), made.train
    weights, biases = sum(a * b for a, b in pairwise(sizes)), sum(sizes[1:])
    values, texels = recipe.feature_count(train), train.texel_channels * bool(train.texel_size)
    channels = train.grid_channels * len(train.grid_cells) + train.hash_channels * len(train.hash_cells)
    return Candidate(
        name,
        width=made.model.width if made.model.depth else 0,
        depth=made.model.depth,
        family=f"{train.encoding}, residual {train.residual}, grids {train.grid_cells}, hashes {train.hash_cells},"
        f" texels {train.texel_size}",
        macs=weights + 8 * channels + 4 * texels + shading,
        bytes=4 * (weights + biases) + np.dtype(train.grid_format).itemsize * values,
        settings=settings,
    )


def _sizes(config: Config, outputs: int) -> list[int]:
    return recipe.layer_sizes(config.model, config.train, outputs)
