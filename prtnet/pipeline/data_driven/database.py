"""The database of data-driven transfer: random lights, and under each of them a direct vector and a lightmap.

Lightmaps are kept shard by shard, some configurations each, so that a killed run goes on; what is measured at the
points is kept by itself, and other points need no other lightmaps. Lights that are learned from and unseen ones are
rendered with rays of their own: what noise they have in common would flatter an operator.
"""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields

import numpy as np
from jaxtyping import Float32, Float64, Int

from prtnet import console, store
from prtnet.data.lighting import direct as lit
from prtnet.data.lighting import lamp
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.lightmap import bounces
from prtnet.data.lightmap.rendered import Rendered
from prtnet.data_driven import Measurement
from prtnet.pipeline.data_driven import options as words
from prtnet.pipeline.data_driven.ground import Ground, Keyframe
from prtnet.pipeline.data_driven.lights import lights_of
from prtnet.render.measure import Measure
from prtnet.render.shadow_maps import ShadowMaps
from prtnet.store import Arrays

log = logging.getLogger(__name__)
Array = np.ndarray

GROUP = 64  # configurations of a shard: rays that find 64 are 1.6 times as quick as those that find 32


@dataclass(frozen=True, eq=False)
class Database:
    """Configurations with what was measured under them. `lightmaps` as of `prtnet.data_driven.DataDriven`."""

    key: str
    lightings: tuple[Lighting, ...]
    lightmaps: Float32[Array, "c t 3"]
    direct: Float32[Array, "c m 3"]
    keyframe: Int[Array, " c"]
    noise: Float64[Array, " t"]  # standard error of a texel of the lightmaps, RMS over configurations and colours
    seconds: float


def database(ground: Ground, purpose: str) -> Database:
    """The configurations to learn from, or the unseen ones, of all keyframes. Raises PrtnetError for scenarios without
    light."""
    found = [_of_keyframe(ground, keyframe, purpose) for keyframe in ground.keyframes]
    return Database(
        store.content_key({"keyframes": [each.key for each in found]}),
        tuple(lighting for each in found for lighting in each.lightings),
        np.concatenate([each.lightmaps for each in found]),
        np.concatenate([each.direct for each in found]),
        np.concatenate([each.keyframe for each in found]),
        np.sqrt(np.mean([each.noise**2 for each in found], axis=0)),
        sum(each.seconds for each in found),
    )


def _of_keyframe(ground: Ground, keyframe: Keyframe, purpose: str) -> Database:
    job, options = ground.job, ground.job.config.data_driven
    lightings = lights_of(job, keyframe.scene, keyframe.tracer, purpose, keyframe.number)
    names = ("renderer", "directions", "bounces", "density")
    inputs = ground.inputs | {name: getattr(options, name) for name in names}
    inputs |= {
        "purpose": purpose,
        "pose": [asdict(pose) for pose in keyframe.pose],
        "lights": [lamp.to_dict(each) for each in lightings],
        "group": GROUP,
    }
    if words.environments(options):
        inputs["transfer"] = asdict(job.config.transfer)

    def make() -> store.Artifact:
        title = f"lightmaps, {purpose}" + (f", keyframe {keyframe.number + 1}" if keyframe.pose else "")
        with console.progress(title, len(lightings), "lights") as reach:
            render = _renderer(ground, keyframe, purpose)

            def shard(number: int, some: slice) -> Arrays:
                made = render(lightings[some], number)
                reach(some.stop)
                return {"lightmaps": made.values, "squares": (len(made.values) * made.noise**2)[None]}

            return job.store.put_shards("lightmaps", inputs, len(lightings), GROUP, shard)

    kept = job.store.once("lightmaps", inputs, make)
    direct = _measured(ground, keyframe, lightings)
    noise = np.sqrt(kept.arrays["squares"].sum(axis=0, dtype=np.float64) / len(lightings))
    return Database(
        store.content_key({"lightmaps": kept.key, "measured": direct.key}),
        tuple(lightings),
        kept.arrays["lightmaps"],
        direct.arrays["direct"],
        np.full(len(lightings), keyframe.number),
        noise,
        kept.facts["seconds"] + direct.facts["seconds"],
    )


def _renderer(ground: Ground, keyframe: Keyframe, purpose: str) -> Callable[[Sequence[Lighting], int], Rendered]:
    """What makes lightmaps of some lights, the shard's number given."""
    options = ground.job.config.data_driven
    if options.renderer == words.SUBSURFACE:
        from prtnet.data.lightmap import subsurface

        return lambda lightings, number: subsurface.lightmaps(
            keyframe.scene,
            keyframe.points,
            lightings,
            albedo=ground.albedo,
            samples=options.directions,
            density=options.density,
            seed=int(ground.job.rng(purpose, keyframe.number, number).integers(1 << 31)),
        )

    def render(lightings: Sequence[Lighting], number: int) -> Rendered:
        points = keyframe.points
        received = lit.irradiances(
            lightings,
            keyframe.tracer,
            points.positions,
            points.normals,
            points.geometric_normals,
            transfer=keyframe.transfer,
        )
        return bounces.indirect(
            keyframe.tracer,
            points,
            ground.albedo,
            ground.surface,
            received,
            bounces=options.bounces,
            directions=options.directions,
            rng=ground.job.rng(purpose, keyframe.number, number),
            threads=ground.job.config.threads,
        )

    return render


def _measured(ground: Ground, keyframe: Keyframe, lightings: Sequence[Lighting]) -> store.Artifact:
    """The direct vectors {"direct": "c m 3"}, by the shader that measures them at run time."""
    measured = keyframe.measurement
    inputs = ground.job.scene_key | {
        "points": {field.name: _digest(getattr(measured, field.name)) for field in fields(Measurement)},
        "pose": [asdict(pose) for pose in keyframe.pose],
        "lights": [lamp.to_dict(each) for each in lightings],
    }

    def make() -> tuple[Arrays, dict[str, float]]:
        start = time.perf_counter()
        measure = Measure(measured, ShadowMaps(keyframe.scene))
        found = []
        for lighting in lightings:
            measure.draw(lighting)
            found.append(measure.read())
        return {"direct": np.stack(found).astype(np.float32)}, {"seconds": time.perf_counter() - start}

    return ground.job.store.make("measured", inputs, make)


def _digest(values: Array) -> str:
    return store.content_key({"bytes": values.tobytes().hex(), "shape": list(values.shape)})
