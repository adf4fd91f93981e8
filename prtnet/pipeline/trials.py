"""Trials of networks: trained with a share of the budget, and held against `traced` without a shader."""

import logging
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from prtnet import PrtnetError, netspec, score
from prtnet.data.scene import Frame
from prtnet.pipeline.bake import Baked, NetPoints
from prtnet.pipeline.candidates import configured
from prtnet.pipeline.job import Job
from prtnet.pipeline.score import noise_floor
from prtnet.pipeline.train import Trained, planned, train
from prtnet.pipeline.views import View, drawing_of, views_of
from prtnet.render import gbuffer as gbuffers
from prtnet.render.gbuffer import GBuffer
from prtnet.size import Candidate, Trial

log = logging.getLogger(__name__)
Array = np.ndarray
Image = Float[Array, "h w 3"]


@dataclass(frozen=True)
class Seen:
    """The views, and what the display shows of their references."""

    views: list[View]
    exposure: float
    shown: list[Image]


@dataclass(frozen=True)
class Region:
    """Pixels of the views that a network is for, and the cube of unit coordinates that it works in."""

    key: str
    cube: Frame
    inside: Callable[[GBuffer], Bool[Array, " n"]]


class Trials:
    """Trains and measures candidates of a job; whatever was found is kept in its store. `region`: of one cluster."""

    def __init__(self, job: Job, baked: Baked, points: NetPoints, region: Region | None = None) -> None:
        self._job, self._baked, self._points, self._region = job, baked, points, region
        bands_light, _ = job.material.orders(job.config.transfer.bands)
        self._light = job.light.coefficients(bands_light)

    def __call__(self, candidate: Candidate, share: float) -> Trial:
        """Raises PrtnetError, with the candidate's name, where its training diverges."""
        try:
            trained = self._train(candidate, share)
        except PrtnetError as error:
            raise PrtnetError(f"size: {candidate.name}: {error}; or leave it out of the space") from error
        inputs = self._inputs | {"net": trained.key} | ({"region": self._region.key} if self._region else {})
        psnr = self._job.store.make("psnr", inputs, lambda: ({}, {"psnr": self.psnr(trained)})).facts["psnr"]
        return Trial(float(np.mean(psnr)), min(psnr), trained.facts["cpu_seconds"])

    def psnr(self, trained: Trained) -> list[float]:
        """Of each view that shows any, in dB on covered pixels, as stage `score` has it of the net's shader."""
        job, seen, found = self._job, self._seen, []
        for view, wanted in zip(seen.views, seen.shown, strict=True):
            covered = self._covered(view)
            if covered.any():
                transfer = self._transfer(trained, view.gbuffer)
                image = gbuffers.shade(view.gbuffer, transfer, self._light, job.material, groups=job.groups)
                found.append(score.psnr(score.tone_map(image, seen.exposure), wanted, covered))
        return found

    def visible(self) -> bool:
        """Whether any view shows a pixel that the network is for."""
        return any(self._covered(view).any() for view in self._seen.views)

    def floor(self) -> float:
        """PSNR of `traced` against itself with other rays."""
        return self._job.store.make("noise_floor", self._inputs, lambda: ({}, {"psnr": self._floor()})).facts["psnr"]

    def _covered(self, view: View) -> Bool[Array, "h w"]:
        if self._region is None:
            return view.covered
        inside = np.zeros(view.covered.size, bool)
        inside[view.gbuffer.pixel] = self._region.inside(view.gbuffer)
        return view.covered & inside.reshape(view.covered.shape)

    def _transfer(self, trained: Trained, seen: GBuffer) -> Float[Array, "n c"]:
        positions = seen.positions if self._region is None else self._region.cube.to_unit(seen.positions)
        return netspec.evaluate_unit(trained.net, positions, seen.normals, np.float32, seen.uv)

    def _train(self, candidate: Candidate, share: float) -> Trained:
        """The whole budget gives the very net that stage `train` would make."""
        whole = self._with(candidate, share)
        if share == 1:
            return train(whole, self._points)
        steps, rate = planned(whole, self._points)
        options = replace(whole.config.train, steps=max(1, round(share * steps)))
        return train(replace(whole, config=replace(whole.config, train=options)), self._points, rate)

    def _with(self, candidate: Candidate, share: float) -> Job:
        # training curves of their own
        out = self._job.out / "trials" / f"{candidate.name.replace(' ', '_')}_{share:.2f}"
        return replace(self._job, config=configured(self._job.config, candidate), out=out)

    @cached_property
    def _seen(self) -> Seen:
        job = self._job
        drawing = drawing_of(job, self._baked)
        views = views_of(job, drawing, self._light, self._baked.radiosity)
        exposure = score.exposure([view.reference for view in views], [view.covered for view in views])
        return Seen(views, exposure, [score.tone_map(view.reference, exposure) for view in views])

    def _floor(self) -> float:
        seen = self._seen
        row = noise_floor(self._job, seen.views[0], self._light, self._baked.radiosity, seen.exposure)
        assert row.psnr is not None
        return row.psnr

    @property
    def _inputs(self) -> dict[str, Any]:
        """What a net's PSNR depends on besides the net."""
        job = self._job
        return job.scene_key | {
            **({"texture": self._baked.texture.key} if self._baked.texture else {}),
            "light": self._light.tolist(),
            "material": asdict(job.material),
            "render": {name: getattr(job.config.render, name) for name in ("size", "views", "traced_directions")},
            "camera": job.config.scene.camera,
        }
