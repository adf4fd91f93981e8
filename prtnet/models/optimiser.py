"""Optimisers and rate schedules, functions of the step alone."""

import math

import torch

from prtnet.models.mlp import Mlp
from prtnet.models.recipe import TrainOptions


def make(net: Mlp, options: TrainOptions) -> list[torch.optim.Optimizer]:
    """Adam for all, or Muon (Jordan et al. 2024) for the matrices between hidden layers and Adam for the rest."""
    hidden = list(net.weights[1:-1]) if options.optimiser == "muon" else []
    rest = [parameter for parameter in net.parameters() if all(parameter is not matrix for matrix in hidden)]
    betas = (0.9, options.beta2)
    optimisers: list[torch.optim.Optimizer] = [
        torch.optim.Adam(rest, lr=options.learning_rate, betas=betas, fused=True)
    ]
    if hidden:
        optimisers.append(torch.optim.Muon(hidden, lr=options.muon_rate, weight_decay=0.0))
    for optimiser in optimisers:
        for group in optimiser.param_groups:
            group["highest"] = group["lr"]
    return optimisers


def rate(options: TrainOptions, step: int, steps: int) -> float:
    """The learning rate of `step`, as a share of the highest."""
    if options.schedule == "constant":
        return 1.0
    rise = 0.3 if options.schedule == "one_cycle" else options.warmup
    done = (step + 1) / steps
    if done <= rise:
        climb = done / rise
        return 0.04 + 0.96 * 0.5 * (1 - math.cos(math.pi * climb)) if options.schedule == "one_cycle" else climb
    return 0.5 * (1 + math.cos(math.pi * (done - rise) / (1 - rise)))


def set_rate(optimisers: list[torch.optim.Optimizer], share: float) -> None:
    """Sets every group's rate to a share of its highest."""
    for optimiser in optimisers:
        for group in optimiser.param_groups:
            group["lr"] = group["highest"] * share
