"""What all stages of one run share: the scene in unit coordinates, the store, the tracer, the light."""

import logging
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import OmegaConf

from prtnet import PrtnetError, score, sh
from prtnet.config import STAGES, Config, LightOptions
from prtnet.data import atlas, atlas_set, directions, light, quantise, transfer, vertex
from prtnet.data.implicit.field import Analytic
from prtnet.data.implicit.march import MarchTracer
from prtnet.data.implicit.mesh_tracer import MeshTracer
from prtnet.data.implicit.surface import Implicit
from prtnet.data.light import Light
from prtnet.data.scene import Frame, Scene
from prtnet.data.tracer import Tracer
from prtnet.export import gloss
from prtnet.models import recipe
from prtnet.pipeline import candidates, drawn_by, scenes, split_options
from prtnet.pipeline.data_driven import options as data_driven_options
from prtnet.pipeline.linear import options as linear_options
from prtnet.render import reflectance, transfer_map
from prtnet.render.display import Display
from prtnet.render.material import Material
from prtnet.store import Store, write_text
from prtnet.view import window

log = logging.getLogger(__name__)

# part of every key: raised when a stage's result changes for the same inputs
VERSION = 3
# of transfer.tracer: the surface itself; and where it is quick enough
MARCHED, AUTO = MarchTracer.kind, "auto"
MARCHING = (MARCHED, AUTO)


@dataclass(frozen=True, eq=False)
class Job:
    """One run. `scene` has unit coordinates; `frame` leads back to the file's."""

    config: Config
    out: Path
    store: Store
    scene: Scene
    frame: Frame
    light: Light
    command: str  # that makes this run again
    implicit: Implicit | None = None  # of which `scene` is a mesh, where it is one
    scene_facts: Mapping[str, Any] = field(default_factory=dict)  # for the report

    @cached_property
    def scene_key(self) -> dict[str, Any]:
        """What every artifact of this scene depends on."""
        own = {"field": self.implicit.field.digest()} if self.implicit else {}
        return {"version": VERSION, "scene": self.scene.digest()} | own

    @cached_property
    def tracer(self) -> Tracer:
        """Rays against the triangles."""
        kind = self.config.transfer.tracer
        if not self.implicit:
            return Tracer(self.scene, kind=kind)
        return MeshTracer(self.scene, self.config.sdf.resolution, kind="auto" if kind in MARCHING else kind)

    @cached_property
    def marched(self) -> MarchTracer:
        """Rays against the field of an implicit surface."""
        assert self.implicit
        return MarchTracer(self.implicit.field)

    @property
    def reference_tracer(self) -> Tracer | MarchTracer:
        """Of what others are held against: the surface itself."""
        return self.marched if self.implicit else self.tracer

    @property
    def training_tracer(self) -> Tracer | MarchTracer:
        """Of what is learned from. Shapes are marched nearly as fast as their mesh is traced, networks are not."""
        kind = self.config.transfer.tracer
        shapes = self.implicit is not None and isinstance(self.implicit.field, Analytic)
        return self.marched if kind == MARCHED or (kind == AUTO and shapes) else self.tracer

    @property
    def baseline(self) -> str:
        """The method that others are timed against."""
        return scenes.baseline(self.config.scene)

    @property
    def material(self) -> Material:
        return _material(self.config)

    @property
    def display(self) -> Display:
        return _display(self.config)

    @property
    def bounces(self) -> int:
        """Diffuse bounces of light between surfaces, 0 unless the transport is interreflected."""
        options = self.config.transfer
        return options.bounces if options.transport == "interreflected" else 0

    @property
    def groups(self) -> int:
        """Groups of SH coefficients in a point's transfer: see `pipeline.transport`."""
        return _groups(self.config)

    @property
    def shading_macs(self) -> int:
        """Multiply-adds from a pixel's transfer to its colour."""
        return _shading_macs(self.config)

    @property
    def light_name(self) -> str:
        return self.light.name

    def rng(self, purpose: str, *numbers: int) -> np.random.Generator:
        """A generator of its own for each purpose, so that one stage's draws never move another's; and for each of its
        `numbers`, where it has several parts."""
        return np.random.default_rng([self.config.seed, zlib.crc32(purpose.encode()), *numbers])


def open_job(config: Config, command: str, sweep_point: str | None) -> Job:
    """Check all options before any work, load and centre the scene, make the run folder. Raises PrtnetError."""
    config = scenes.with_methods(config)
    _check(config)
    job = opened(config, command, sweep_point)
    write_text(job.out / "config.yaml", OmegaConf.to_yaml(OmegaConf.structured(config)))
    return job


def opened(config: Config, command: str, sweep_point: str | None) -> Job:
    """The job of options that have been checked, without its run folder. Raises PrtnetError for scene and light."""
    chosen = _light(config.light)
    _display(config).check(chosen)
    loaded = scenes.load(config, lambda name: _store(config, name))
    vertex.check(loaded.scene, config.vertex.subdivide, config.vertex.level)
    reflectance.check(_material(config), loaded.scene)
    found = loaded.scene
    base = _base(config, found.name)
    out = base / sweep_point if sweep_point else base
    log.info("%s: %d triangles in %d parts -> %s", found.name, len(found.faces), len(found.materials), out)
    store = _store(config, found.name)
    return Job(config, out, store, found, loaded.frame, chosen, command, loaded.implicit, loaded.facts)


def _base(config: Config, name: str) -> Path:
    """The run folder, or that above a sweep's."""
    return Path(config.out or f"runs/{name}")


def _store(config: Config, name: str) -> Store:
    return Store(Path(config.cache) if config.cache else _base(config, name) / "cache")


def _material(config: Config) -> Material:
    options = config.material
    made = Material(
        options.diffuse,
        tuple(options.specular),
        options.exponent,
        options.product,
        {name: reflectance.of_part(name, words) for name, words in options.parts.items()},
        options.roughness,
        options.light_bands,
        options.radiance_bands,
    )
    orders = made.orders(config.transfer.bands)
    if made.glossy:
        gloss.check(config.transfer.bands, *orders)
    return made


def _shading_macs(config: Config) -> int:
    bands, material = config.transfer.bands, _material(config)
    bands_light, _ = material.orders(bands)
    return score.diffuse_macs(sh.count(min(bands, bands_light))) + material.gloss_macs(bands)


def _display(config: Config) -> Display:
    options = config.render
    return Display(options.tone, options.bloom, options.highlights)


def _light(options: LightOptions) -> Light:
    found = light.from_file(options.path, options.mapping) if options.path else light.by_name(options.name, options)
    return light.adjust(found, rotation=options.rotation, window=options.window, window_size=options.window_size)


def _check_atlas(config: Config) -> None:
    options = config.atlas
    quantise.check(options.format)
    atlas_set.check(options.sets)
    atlas.check(options.unwrap, 1 if options.padding is None else options.padding)
    transfer_map.check(options.level_of_detail)
    if config.train.texel_size and options.sets != "one":
        raise PrtnetError(
            f"train.texel_size: found {config.train.texel_size} with atlas.sets={options.sets}, expected"
            " atlas.sets=one: the texels of a net are one image over the whole scene"
        )


def _check_export(config: Config) -> None:
    """A net that cannot be exported is not trained, unless nobody asks for its export."""
    drawn_by.check(config.render.net)
    form, outputs = candidates.form_of(config), _groups(config) * sh.count(config.transfer.bands)
    if "size" in config.stages or split_options.sized(config):
        candidates.check(config, outputs, _shading_macs(config))
    elif {"net", "clusters"} & set(config.methods) and {"export", "score", "view"} & set(config.stages):
        form.of_sizes(recipe.layer_sizes(config.model, config.train, outputs), _groups(config))


def _groups(config: Config) -> int:
    """Groups of coefficients: see `pipeline.transport`."""
    return 4 if config.transfer.transport == "interreflected" else 1


def _check(config: Config) -> None:
    unknown = [stage for stage in config.stages if stage not in STAGES]
    if unknown or not config.stages:
        raise PrtnetError(f"stages: found {config.stages}, expected some of {', '.join(STAGES)}")
    least = {
        "transfer.bands": 1,
        "transfer.directions": 1,
        "transfer.bounces": 1,
        "samples.count": 1,
        "samples.test_count": 1,
        "samples.directions": 1,
        "atlas.size": 16,
        "atlas.dilation": 0,
        "vertex.level": 0,
        "model.width": 1,
        "model.depth": 0,
        "train.batch": 1,
        "render.size": 16,
        "render.views": 1,
        "render.traced_directions": 1,
        "render.exact_samples": 0,
        "render.exact_views": 1,
    }
    values = asdict(config)
    for key, minimum in least.items():
        group, name = key.split(".")
        found = values[group][name]
        if found is not None and found < minimum:
            raise PrtnetError(f"{key}: found {found}, expected at least {minimum}")
    if "lit_texture" in config.methods and config.transfer.transport != "interreflected":
        raise PrtnetError(
            "methods: found lit_texture, which keeps light between surfaces, expected transfer.transport=interreflected"
        )
    if "view" in config.stages:
        window.check()
    recipe.check(config.train)
    split_options.check(config)
    data_driven_options.check(config)
    linear_options.check(config)
    _material(config)
    _display(config)
    _check_atlas(config)
    if config.transfer.kind not in directions.KINDS:
        expected = ", ".join(directions.KINDS)
        raise PrtnetError(f"transfer.kind: found {config.transfer.kind!r}, expected one of {expected}")
    if config.transfer.transport not in transfer.TRANSPORTS:
        expected = ", ".join(transfer.TRANSPORTS)
        raise PrtnetError(f"transfer.transport: found {config.transfer.transport!r}, expected one of {expected}")
    # last, since it starts the driver
    texel_bytes = quantise.FORMATS[config.atlas.format]
    count = sh.count(config.transfer.bands)
    atlas_set.check_limits(config.atlas.size, count, texel_bytes, config.atlas.memory_limit, _groups(config))
    _check_export(config)
