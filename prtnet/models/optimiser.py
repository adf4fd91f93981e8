"""Optimisers and rate schedules, functions of the step alone."""

import math

import torch

from prtnet.models.mlp import Mlp
from prtnet.models.recipe import TrainOptions
from prtnet.models.soap import Soap


def make(net: Mlp, options: TrainOptions) -> list[torch.optim.Optimizer]:
    """Adam for all; or SOAP for matrices, or Muon (Jordan et al. 2024) for the hidden ones, and Adam for the rest.

    With at most one hidden layer there is no matrix between two, and Muon leaves all to Adam.
    """
    matrices = {"adam": [], "muon": list(net.weights[1:-1]), "soap": list(net.weights)}[options.optimiser]
    rest = [parameter for parameter in net.parameters() if all(parameter is not matrix for matrix in matrices)]
    adam = torch.optim.Adam(rest, lr=options.learning_rate, betas=(0.9, options.beta2), fused=True)
    optimisers: list[torch.optim.Optimizer] = [adam]
    if matrices and options.optimiser == "muon":
        optimisers.append(torch.optim.Muon(matrices, lr=options.matrix_rate, weight_decay=0.0))
    elif matrices:
        optimisers.append(Soap(matrices, lr=options.matrix_rate))
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
