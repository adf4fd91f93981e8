"""The state of a training run, and one step of it."""

import hashlib
import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from prtnet import PrtnetError, sh, store
from prtnet.models import checkpoint, functional, gloss, loss, memory, optimiser, recipe
from prtnet.models.mlp import SCALE, Mlp, ModelOptions
from prtnet.models.recipe import TrainOptions
from prtnet.models.resample import HardPoints

Array = np.ndarray


@dataclass(frozen=True)
class Points:
    """Surface points to learn from or to test on: unit positions in [-1, 1]^3, unit normals, transfer."""

    positions: Float[Array, "n 3"]
    normals: Float[Array, "n 3"]
    transfer: Float[Array, "n c"]
    groups: int = 1  # of SH coefficients in the transfer
    uv: Float[Array, "n 2"] | None = None  # in the atlas, [0, 1]^2, v up; for nets with texels

    def at(self, chosen: Any) -> "Points":
        """Those of an index, a mask or a slice."""
        uv = None if self.uv is None else self.uv[chosen]
        return Points(self.positions[chosen], self.normals[chosen], self.transfer[chosen], self.groups, uv)


class Run:
    """The state of a training run, and one step of it."""

    def __init__(self, points: Points, model: ModelOptions, options: TrainOptions, steps: int) -> None:
        recipe.check(options)
        _check_points(points, model, options, steps)
        self.options, self.steps, self.step, self.cpu_seconds = options, steps, 0, 0.0
        self.device = choose_device(options.device)
        memory.check(model, options, points.transfer.shape[1], len(points.transfer), self.device)
        # a sine's argument may be large, and bfloat16 has three digits
        chosen = options.precision == "auto" and options.activation != "sine" and fast_bfloat16(self.device)
        self.bfloat16 = options.precision == "bfloat16" or chosen
        bands = sh.bands_of(points.transfer.shape[1] // points.groups)
        generator = torch.Generator().manual_seed(options.seed)
        self.net = Mlp(model, options, bands, generator, points.groups).to(self.device)
        self.optimisers = optimiser.make(self.net, options)
        self.average = [parameter.detach().clone() for parameter in self.net.parameters()] if options.average else []
        weighted = options.band_falloff != 0
        weights = loss.band_weights(bands, options.band_falloff).repeat(points.groups).to(self.device)
        self.band_weights = weights if weighted else None
        self.functionals, self.mirrored = self._functionals(bands)
        self.table = self._table(points)
        self._first = 9 if self.net.texels else 7  # column of the targets
        self.batch = min(options.batch, len(self.table))
        self.history = torch.zeros(steps, device=self.device)
        self._in_turn = max(1, self.batch - round(self.batch * options.resample))  # points of a batch; drawn: the rest
        self.hard = self._hard_points()
        self._epoch, self._order = -1, torch.empty(0)

    def _functionals(self, bands: int) -> tuple[Tensor | None, Tensor | None]:
        """Those of the loss, if it has some, and the eyes' mirrored directions where some are glossy."""
        options = self.options
        if options.loss not in functional.KINDS:
            return None, None
        if not options.loss_gloss:
            return functional.pool(options.loss, bands, options.seed).to(self.device), None
        rows, mirrored = gloss.pool(bands, options.loss_gloss, options.seed)
        return rows.to(self.device), mirrored.to(self.device)

    def _table(self, points: Points) -> Tensor:
        """Position, normal, point weight, texture coordinate where the net takes it, and target of a point side by
        side: a batch is one gather of whole rows."""
        uv = points.uv if points.uv is not None and self.net.texels else np.empty((len(points.transfer), 0))
        positions, normals, places, transfer = (
            torch.from_numpy(np.ascontiguousarray(array, np.float32))
            for array in (points.positions, points.normals, uv, points.transfer)
        )
        weights = loss.point_weights(transfer, self.options.dark_weight)
        target = transfer / SCALE - self.net.unlearned(normals)
        return torch.cat([positions, normals, weights[:, None], places, target], 1).to(self.device)

    def advance(self) -> None:
        """One step."""
        started = self._clock()
        chosen = self._chosen()
        rows = torch.index_select(self.table, 0, chosen)
        optimiser.set_rate(self.optimisers, optimiser.rate(self.options, self.step, self.steps))
        with torch.autocast(self.device.type, torch.bfloat16, enabled=self.bfloat16):
            predicted = self.net(rows[:, :3], rows[:, 3:6], rows[:, 7:9] if self.net.texels else None)
        value = self._loss(predicted, rows, self._point_weights(rows, chosen))
        value.backward()
        if self.hard is not None:
            self.hard.note(chosen, predicted.detach().float() - rows[:, self._first :])
        for each in self.optimisers:
            each.step()
            each.zero_grad()
        if self.average:
            for mean, parameter in zip(self.average, self.net.parameters(), strict=True):
                mean.lerp_(parameter.detach(), 1 - self._decay())
        self.history[self.step] = value.detach()
        self.step += 1
        self.cpu_seconds += self._clock() - started

    def _hard_points(self) -> HardPoints | None:
        options, share = self.options, 1 - self._in_turn / self.batch
        if not share:
            return None
        return HardPoints(self.table[:, self._first :], share, options.resample_correction, options.seed)

    def _point_weights(self, rows: Tensor, chosen: Tensor) -> Tensor | None:
        """None stands for weights of 1."""
        weights = rows[:, 6] if self.options.dark_weight else None
        if self.hard is None or not self.options.resample_correction:
            return weights
        drawn = self.hard.weights(chosen)
        return drawn if weights is None else weights * drawn

    def _loss(self, predicted: Tensor, rows: Tensor, points: Tensor | None) -> Tensor:
        options, target = self.options, rows[:, self._first :]
        weights = {"bands": self.band_weights, "points": points}
        if self.functionals is None:
            return loss.loss(predicted, target, kind=options.loss, delta=options.huber_delta, **weights)
        drawn = options.loss_samples, options.seed, self.step
        if self.mirrored is not None:
            mirrored = functional.draw(self.mirrored, *drawn)  # the same as of the functionals
            weights["counts"] = gloss.counts(rows[:, 3:6], mirrored, self.net.groups)
        chosen = functional.draw(self.functionals, *drawn)
        return functional.loss(predicted, target, chosen, kind=options.loss_norm, delta=options.huber_delta, **weights)

    def _decay(self) -> float:
        """Short at first, so that the first weights are soon forgotten."""
        return min(self.options.average, (self.step + 1) / (self.step + 10))

    def _chosen(self) -> Tensor:
        """The points of this step's batch: some in turn, and some drawn by their errors."""
        if self.hard is None:
            return self._next()
        drawn = self.hard.draw(self.batch - self._in_turn, self.step)
        return torch.cat([self._next(), drawn])

    def _next(self) -> Tensor:
        """Points in turn: each epoch has an order of its own, and leaves out what does not fill a batch."""
        size = self._in_turn
        epoch, index = divmod(self.step, len(self.table) // size)
        if epoch != self._epoch:
            generator = torch.Generator().manual_seed(self.options.seed * 1_000_003 + epoch)
            self._epoch = epoch
            self._order = torch.randperm(len(self.table), generator=generator).to(self.device)
        return self._order[index * size : (index + 1) * size]

    def _clock(self) -> float:
        if self.device.type == "cuda":
            torch.cuda.synchronize()
            return time.perf_counter()
        return time.thread_time()

    def parameters(self) -> list[Tensor]:
        """What the net to hand over is made of: the mean weights where they are kept, else the last ones."""
        return self.average or [parameter.detach() for parameter in self.net.parameters()]

    def state(self) -> checkpoint.State:
        """Everything that a resumed run needs. Inverse of `restore`."""
        state = {f"net.{name}": tensor for name, tensor in self.net.state_dict().items()}
        state |= checkpoint.optimiser_state(self.optimisers)
        state |= {f"average.{i}": tensor for i, tensor in enumerate(self.average)}
        state |= self.hard.state() if self.hard is not None else {}
        counters = torch.tensor([self.step, self.cpu_seconds], dtype=torch.float64)
        return state | {"counters": counters, "history": self.history}

    def restore(self, state: checkpoint.State) -> None:
        """Inverse of `state`."""
        self.net.load_state_dict({name: state[f"net.{name}"] for name in self.net.state_dict()})
        checkpoint.set_optimiser_state(self.optimisers, state)
        self.average = [state[f"average.{i}"].to(self.device) for i in range(len(self.average))]
        if self.hard is not None:
            self.hard.restore(state)
        self.history = state["history"].to(self.device)
        self.step, self.cpu_seconds = int(state["counters"][0]), float(state["counters"][1])

    def fingerprint(self, points: Points) -> str:
        """What the bytes of the result depend on: a checkpoint of any other run is not gone on from."""
        digest = hashlib.sha256()
        places = [points.uv] if points.uv is not None and self.net.texels else []
        for array in (points.positions, points.normals, points.transfer, *places):
            digest.update(np.ascontiguousarray(array).data)
        settings = asdict(self.options)
        settings |= {"steps": self.steps, "bfloat16": self.bfloat16, "device": self.device.type}
        for field in ("recipe", "precision", "cpu_seconds", "checkpoint_seconds"):
            del settings[field]
        layers = [list(weight.shape) for weight in self.net.weights]
        return store.content_key({"settings": settings, "layers": layers, "points": digest.hexdigest()})


def choose_device(name: str) -> torch.device:
    """The device of that name; auto: CUDA where torch sees one."""
    if name == "cuda" and not torch.cuda.is_available():
        raise PrtnetError("train.device: found no CUDA device in torch, expected one; use train.device=auto")
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    return torch.device(name)


def fast_bfloat16(device: torch.device) -> bool:
    """Whether the device multiplies bfloat16 in hardware: elsewhere it is emulated, and slower than float32."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    return torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()


def _check_points(points: Points, model: ModelOptions, options: TrainOptions, steps: int) -> None:
    if min(model.width, model.depth + 1, steps) < 1:
        raise PrtnetError(
            f"model: found width {model.width}, depth {model.depth} and {steps} steps, expected 1 or more of each, but"
            " 0 for a depth without hidden layers"
        )
    count = len(points.transfer)
    if not count or len(points.positions) != count or len(points.normals) != count:
        raise PrtnetError(
            f"training samples: found {len(points.positions)} positions, {len(points.normals)} normals and {count}"
            " transfers, expected equally many, and at least one"
        )
    for name, array in (("position", points.positions), ("normal", points.normals), ("transfer", points.transfer)):
        if not np.isfinite(array).all():
            raise PrtnetError(f"training samples: found a {name} that is NaN or infinite; bake them again")
    reach = float(np.abs(points.positions).max())
    if reach > 1.01:
        raise PrtnetError(f"training samples: found positions up to {reach:.4g}, expected them centred in [-1, 1]^3")
    if options.texel_size:
        _check_uv(points.uv, count)


def _check_uv(uv: Array | None, count: int) -> None:
    if uv is None or len(uv) != count:
        raise PrtnetError(
            f"training samples: found {0 if uv is None else len(uv)} texture coordinates for {count} points, expected"
            " one for each where train.texel_size is above 0"
        )
    if not (uv.min() >= 0 and uv.max() <= 1):
        raise PrtnetError(
            f"training samples: found texture coordinates from {uv.min():.4g} to {uv.max():.4g}, expected [0, 1]"
        )
