"""Programs of implicit surfaces in torch: the functions that `Program.evaluate` needs, and the distance of points.

Autograd through them is another way to the gradients of `prtnet.data.implicit.derivative`.
"""

from collections.abc import Callable, Mapping
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from prtnet.data.implicit.expression import Program


def _extreme(function: Callable[[Tensor, Tensor], Tensor]) -> Callable[[Any, Any], Any]:
    """Of two of which one may be a number."""
    return lambda a, b: function(*torch.broadcast_tensors(*_tensors(a, b)))


def _tensors(*values: Any) -> list[Tensor]:
    like = next((value for value in values if isinstance(value, Tensor)), torch.zeros(()))
    return [value if isinstance(value, Tensor) else like.new_tensor(value) for value in values]


def _select(a: Any, b: Any, u: Any, v: Any) -> Tensor:
    a, b, u, v = torch.broadcast_tensors(*_tensors(a, b, u, v))
    return torch.where(a < b, u, v)


TORCH: Mapping[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "min": _extreme(torch.minimum),
    "max": _extreme(torch.maximum),
    "neg": lambda a: -a,
    "abs": abs,
    "sqrt": torch.sqrt,
    "floor": torch.floor,
    "sin": torch.sin,
    "cos": torch.cos,
    "select": _select,
}


def evaluate(program: Program, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n r"]:
    """The results of a program at points, in their type and on their device, ready for autograd."""
    results = program.evaluate(points[:, 0], points[:, 1], points[:, 2], TORCH)
    ones = torch.ones_like(points[:, 0])
    return torch.stack([ones * each for each in results], dim=1)
