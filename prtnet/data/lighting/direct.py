"""Direct irradiance at points: exact, by shadow rays to every lamp; from far away by transfer.

A point lamp or a spot sends colour / distance^2 times the cosine at the shading normal, a directional lamp its colour
times that. Rays start off the surface along the geometric normal and end at the lamp, so that what stands behind a
lamp casts no shadow. Light from behind the geometric side is 0. Everything is linear in the light: SH that ring below
0 are left so.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Float32, Float64

from prtnet import PrtnetError
from prtnet.data.embree import PacketScene
from prtnet.data.implicit.march import MarchTracer
from prtnet.data.lighting.lamp import Lamp, Lighting, arriving
from prtnet.data.samples import morton_order
from prtnet.data.tracer import Tracer
from prtnet.data.transfer import cores, in_threads

Array = np.ndarray


def irradiance(
    lighting: Lighting,
    tracer: Tracer | MarchTracer,
    positions: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    geometric_normals: Float[Array, "n 3"],
    *,
    transfer: Float[Array, "n k"] | None = None,
) -> Float32[Array, "n 3"]:
    """Linear RGB irradiance, no albedo. Unit coordinates; unit normals.

    `transfer` of the points is needed where the lighting has an environment: PrtnetError without, or with fewer bands
    than the environment has.
    """
    return irradiances([lighting], tracer, positions, normals, geometric_normals, transfer=transfer, threads=1)[0]


def irradiances(
    lightings: Sequence[Lighting],
    tracer: Tracer | MarchTracer,
    positions: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    geometric_normals: Float[Array, "n 3"],
    *,
    transfer: Float[Array, "n k"] | None = None,
    threads: int | None = None,
) -> Float32[Array, "c n 3"]:
    """`irradiance` of the same points under each lighting, in threads."""
    _check(lightings, positions, transfer)
    # neighbours side by side: their rays fill packets that walk the tree together
    order = morton_order(positions) if len(positions) else np.zeros(0, int)
    places, leaning, sides = (
        np.ascontiguousarray(each[order], np.float64) for each in (positions, normals, geometric_normals)
    )
    starts = (places + tracer.offset * sides).astype(np.float32)
    out = np.zeros((len(lightings), len(positions), 3), np.float32)

    def work(index: int) -> int:
        total = np.zeros((len(positions), 3))
        for lamp in lightings[index].lamps:
            total += from_lamp(lamp, tracer, places, leaning, sides, starts)[:, None] * np.asarray(lamp.colour)
        total[order] = total.copy()
        distant = lightings[index].environment
        if distant is not None and transfer is not None:
            total += np.asarray(transfer[:, : len(distant)], np.float64) @ distant
        out[index] = total
        return 1

    traced = tracer.rays_traced
    for _ in in_threads(work, range(len(lightings)), threads or cores()):
        pass
    tracer.rays_traced = traced + len(positions) * sum(len(each.lamps) for each in lightings)
    return out


def from_lamp(
    lamp: Lamp,
    tracer: Tracer | MarchTracer,
    positions: Float64[Array, "n 3"],
    normals: Float64[Array, "n 3"],
    geometric_normals: Float64[Array, "n 3"],
    starts: Float32[Array, "n 3"],
) -> Float64[Array, " n"]:
    """Irradiance of the lamp, were its colour 1; rays begin at `starts`."""
    packets = tracer.packets if isinstance(tracer, Tracer) else None
    if packets is None:
        return _plain(lamp, tracer, positions, normals, geometric_normals, starts)
    return _compiled(lamp, packets, positions, normals, geometric_normals, starts)


def _plain(
    lamp: Lamp, tracer: Tracer | MarchTracer, positions: Array, normals: Array, sides: Array, starts: Array
) -> Array:
    towards, _, strength = arriving(lamp, positions)
    cosine = np.einsum("ni,ni->n", towards, normals)
    found = strength * np.maximum(cosine, 0) * (np.einsum("ni,ni->n", towards, sides) > 0)
    lit = np.flatnonzero(found > 0)
    aims, lengths, _ = arriving(lamp, starts[lit])
    found[lit] *= tracer.hits(starts[lit], aims.astype(np.float32))[2] >= lengths.astype(np.float32)
    return found


def _compiled(lamp: Lamp, scene: PacketScene, positions: Array, normals: Array, sides: Array, starts: Array) -> Array:
    from prtnet.data.kernels import packet
    from prtnet.data.lighting import kernels

    kind = {"directional": kernels.DIRECTIONAL, "point": kernels.POINT, "spot": kernels.SPOT}[lamp.kind]
    outer, inner = np.cos(np.radians([lamp.outer, lamp.inner]))
    found, slots = np.empty(len(positions)), np.empty(scene.width, np.int64)
    rays, valid = packet(scene.width)
    kernels.lamp_kernel(scene.width)(
        scene.function, scene.address, scene.options, rays, valid,
        kind, np.asarray(lamp.position, np.float64), np.asarray(lamp.aim, np.float64), outer, inner,
        positions, normals, sides, starts, slots, found,
    )  # fmt: skip
    return found


def _check(lightings: Sequence[Lighting], positions: Array, transfer: Array | None) -> None:
    longest = max((len(each.environment) for each in lightings if each.environment is not None), default=0)
    given = 0 if transfer is None else transfer.shape[1]
    if longest > given:
        raise PrtnetError(
            f"direct light: found an environment of {longest} SH coefficients and a transfer of {given}, expected the"
            " points' transfer with at least as many"
        )
    if not np.isfinite(positions).all():
        raise PrtnetError("direct light: found positions that are not finite")
