"""What training minimises: a robust norm of the error of t / pi, with weights for bands and points.

L1 is Learnt Transfer's. Images are judged by their mean square error after the display's curve, which L1 does not
minimise, and L2 spends itself on the few points next to shadow edges; Huber (1964) stands between them.
"""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from prtnet import sh


def rho(
    kind: str, predicted: Float[Tensor, "n k"], target: Float[Tensor, "n k"], delta: float, reduction: str = "none"
) -> Float[Tensor, "..."]:
    """|e|, e^2, or Huber's e^2 / 2 delta below delta and |e| - delta / 2 above: with the slope of L1 far out."""
    if kind == "l1":
        return functional.l1_loss(predicted, target, reduction=reduction)
    if kind == "l2":
        return functional.mse_loss(predicted, target, reduction=reduction)
    return functional.smooth_l1_loss(predicted, target, beta=delta, reduction=reduction)


def band_weights(bands: int, falloff: float) -> Float[Tensor, " k"]:
    """(1 + l)^-falloff for each coefficient, of mean 1: lights put less power into high bands."""
    weights = (1 + torch.from_numpy(sh.band_index(bands))).float() ** -falloff
    return weights / weights.mean()


def point_weights(transfer: Float[Tensor, "n k"], exponent: float) -> Float[Tensor, " n"]:
    """(open share + 0.05)^-exponent of each point, of mean 1: the display's curve lifts errors in the dark.

    The open share is the transfer's DC over that of an unoccluded point.
    """
    open_share = (transfer[:, 0] / 0.8862269).clamp(0, 1)
    weights = (open_share + 0.05) ** -exponent
    return weights / weights.mean()


def loss(
    predicted: Float[Tensor, "n k"],
    target: Float[Tensor, "n k"],
    *,
    kind: str,
    delta: float,
    bands: Float[Tensor, " k"] | None = None,
    points: Float[Tensor, " n"] | None = None,
) -> Float[Tensor, ""]:
    """Mean over points and coefficients of weighted rho(predicted - target). None stands for weights of 1."""
    if bands is None and points is None:
        return rho(kind, predicted.float(), target, delta, "mean")
    values = rho(kind, predicted.float(), target, delta)
    values = values if bands is None else values * bands
    return (values if points is None else values * points[:, None]).mean()
