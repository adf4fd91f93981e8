"""A net in torch on a GPU's memory: the network of `prtnet.render.interop` without its fused kernel."""

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from prtnet.models.inference import Inference
from prtnet.netspec import NetSpec, check_uv


class DeviceNet:
    """Called with packed points it writes their transfer, in place. `as_tensor` makes a tensor of the memory of an
    array, which by default has `__cuda_array_interface__`."""

    def __init__(self, net: NetSpec, device: str = "cuda", as_tensor: Callable[[Any], Tensor] | None = None):
        self._infer = Inference(net, device)
        self._as_tensor = as_tensor or (lambda array: torch.as_tensor(array, device=device))

    @torch.no_grad()
    def __call__(self, positions: Any, normals: Any, transfer: Any, count: int, uv: Any = None) -> None:
        """The first `count` rows of `transfer` from those of positions, unit normals and, where the net has texels,
        places in the atlas."""
        check_uv(self._infer.net, uv)
        points = [self._as_tensor(array)[:count] for array in (positions, normals, uv) if array is not None]
        self._as_tensor(transfer)[:count] = self._infer.transfer(*points)
