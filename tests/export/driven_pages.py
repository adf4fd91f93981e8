"""A small page of data-driven transfer for tests: made-up smooth light between the surfaces of a box, three lamps."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from prtnet.data import atlas as atlases
from prtnet.data import builtin, texture
from prtnet.data.albedo import albedo
from prtnet.data.atlas import Atlas
from prtnet.data.lighting import direct
from prtnet.data.lighting.lamp import Lamp, Lighting
from prtnet.data.samples import area_uniform
from prtnet.data.texture import Texels
from prtnet.data.tracer import Tracer
from prtnet.data_driven import DataDriven, Measurement
from prtnet.export import web_data_driven
from prtnet.export.web_data_driven import PageLamp
from tests.export.pages import LOOK
from tests.operators import random_spec

SIDE, POINTS, SAMPLES, ELEMENTS = 64, 30, 4, 6
LAMPS = (
    Lamp("point", (1.2, 1.0, 0.7), position=(0.3, 0.6, 0.5)),
    Lamp("spot", (3.0, 3.5, 4.0), position=(-0.4, 0.5, 0.8), aim=(0.36, -0.48, -0.8), inner=15, outer=28),
    Lamp("directional", (1.5, 1.5, 1.5), aim=(0.36, -0.48, -0.8)),
)


@dataclass(frozen=True)
class Made:
    """What a page is made of."""

    spec: DataDriven
    atlas: Atlas
    texels: Texels
    tracer: Tracer
    lights: tuple[PageLamp, ...]

    def text(self, **changes) -> str:
        """The HTML."""
        spec = changes.pop("spec", self.spec)
        values = {"lights": self.lights, "look": LOOK} | changes
        return web_data_driven.page(spec, self.atlas, **values)

    def write(self, path: Path, **changes) -> str:
        """The HTML on disk; its address."""
        path.write_text(self.text(**changes), encoding="utf-8")
        return path.as_uri()


@cache
def box() -> tuple[Atlas, Texels, Tracer, Measurement]:
    scene = builtin.make("cornell", tessellation=0.25).centred()
    atlas = atlases.make(scene, size=SIDE, padding=2)
    found = area_uniform(scene, POINTS * SAMPLES, np.random.default_rng(5))
    colours = albedo(scene.split_sides(), found.face, found.weights)
    fields = (found.positions, found.normals, found.geometric_normals, colours)
    each = [values.astype(np.float32).reshape(POINTS, SAMPLES, 3) for values in fields]
    points = Measurement(*each, np.zeros((POINTS, 0, 3), np.float32))
    return atlas, texture.gbuffer(atlas, SIDE), Tracer(scene), points


def by_rays(tracer: Tracer, points: Measurement, lamp: Lamp) -> np.ndarray:
    """The direct vector by shadow rays."""
    flat = [getattr(points, name).reshape(-1, 3) for name in ("positions", "normals", "geometric_normals")]
    found = direct.irradiance(Lighting((lamp,)), tracer, flat[0].astype(np.float64), *flat[1:])
    return (found.reshape(points.albedo.shape) * points.albedo / np.pi).mean(axis=1).astype(np.float32)


def made(*, banks: int = 1, gamma: float = 1.0, quantity: str = "irradiance") -> Made:
    """Smooth basis textures; each element moved by all measurement points, the first most of all."""
    atlas, texels, tracer, points = box()
    rng = np.random.default_rng(2)
    x = texels.positions
    waves = np.cos(x @ rng.normal(size=(3, 3 * ELEMENTS)) * 1.5 + rng.uniform(0, 6, 3 * ELEMENTS))
    rows = [np.column_stack([np.ones(len(x)), part])[:, :ELEMENTS] for part in np.split(waves, 3, axis=1)]
    basis = np.stack([np.linalg.qr(each)[0].T for each in rows[:banks]])
    basis *= np.sign(basis[:, :1].sum(axis=2, keepdims=True))
    spec = random_spec(
        elements=ELEMENTS, points=POINTS, size=SIDE, banks=banks, gamma=gamma, texels=texels.index, quantity=quantity
    )
    matrices = rng.normal(size=spec.matrices.shape) * 0.3
    matrices[:, :, 0] = 2 + rng.random(matrices[:, :, 0].shape)
    spec = replace(spec, basis=basis.astype(np.float32), matrices=matrices.astype(np.float32), measurements=(points,))
    lights = []
    for number, lamp in enumerate(LAMPS):
        lightmap = None if number == 2 else rng.random((1, 3)) + 0.3 * np.cos(3 * x + number)
        lightmap = None if lightmap is None else lightmap.astype(np.float32)
        lights.append(PageLamp(lamp.kind, lamp, 0.8, lightmap, by_rays(tracer, points, lamp)))
    return Made(spec, atlas, texels, tracer, tuple(lights))
