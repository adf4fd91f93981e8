"""Checkpoints of a training run: one safetensors file, written atomically. Never pickle."""

import logging
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from prtnet import store

log = logging.getLogger(__name__)

State = dict[str, Tensor]


def save(path: Path, state: State, fingerprint: str) -> None:
    """Replaces the checkpoint at `path`. `fingerprint` says which run it belongs to. Inverse of `load`."""
    whole = {name: tensor.detach().cpu().contiguous() for name, tensor in state.items()}
    with store.atomic(path) as temporary:
        save_file(whole, temporary, {"fingerprint": fingerprint})


def load(path: Path, fingerprint: str) -> State | None:
    """The state, or None (said in the log) where there is none, it is truncated, or it is another run's."""
    if not path.exists():
        return None
    try:
        with safe_open(str(path), framework="pt") as file:
            found = (file.metadata() or {}).get("fingerprint")
            if found == fingerprint:
                return {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a dict)
        log.warning("%s: the checkpoint of another run; training starts over", path)
    except (SafetensorError, OSError) as error:
        log.warning("%s: not a whole checkpoint (%s); training starts over", path, error)
    return None


def optimiser_state(optimisers: list[torch.optim.Optimizer]) -> State:
    """The tensors of the optimisers' state, named by optimiser, parameter and key."""
    state = {}
    for i, optimiser in enumerate(optimisers):
        for parameter, values in optimiser.state_dict()["state"].items():
            for key, value in values.items():
                state[f"optimiser.{i}.{parameter}.{key}"] = torch.as_tensor(value)
    return state


def set_optimiser_state(optimisers: list[torch.optim.Optimizer], state: State) -> None:
    """Inverse of `optimiser_state`."""
    for i, optimiser in enumerate(optimisers):
        values: dict[int, dict[str, Tensor]] = {}
        for name, tensor in state.items():
            if name.startswith(f"optimiser.{i}."):
                parameter, key = name.split(".")[2:]
                values.setdefault(int(parameter), {})[key] = tensor
        groups = optimiser.state_dict()["param_groups"]
        optimiser.load_state_dict({"state": values, "param_groups": groups})
