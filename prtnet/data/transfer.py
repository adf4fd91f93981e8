"""Transfer by ray tracing: t_i(p) = integral of V(p, w) max(0, n.w) Y_i(w) dw at many points.

Sloan, Kautz and Snyder 2002, *Precomputed Radiance Transfer for Real-Time Rendering in Dynamic, Low-Frequency
Lighting Environments*. No albedo, no 1/pi. Where nothing occludes it equals sh.cosine_lobe.
"""

import logging
import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Float32

from prtnet import PrtnetError
from prtnet.data import directions as sets
from prtnet.data.directions import Table
from prtnet.data.implicit.march import MarchTracer
from prtnet.data.samples import morton_order
from prtnet.data.surface import Surface
from prtnet.data.tracer import Tracer, to_world

log = logging.getLogger(__name__)
Chunk = TypeVar("Chunk")

# the cosine lobe of the normal, no rays; what is seen of the light; and what comes from other surfaces besides
TRANSPORTS = ("unshadowed", "shadowed", "interreflected")
CHUNK_RAYS = 1 << 19  # a few tens of milliseconds: threads stay busy to the end and Ctrl-C is quick
LOG_SECONDS = 10.0


def bake(
    tracer: Tracer | MarchTracer,
    positions: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    *,
    bands: int = 5,
    directions: int = 512,
    rng: np.random.Generator,
    geometric_normals: Float[np.ndarray, "n 3"] | None = None,
    kind: str = "cosine_fibonacci",
    progress: Callable[[int], None] | None = None,
    threads: int | None = None,
) -> Float[np.ndarray, "n k"]:
    """Transfer of points on the scene's surface, float32, on world axes.

    Positions in scene coordinates; unit shading normals choose the hemisphere, unit geometric normals (the shading
    normals when absent) the side on which rays start. `directions` is rounded up to a multiple of 16. A point's bits
    depend on rng, its own row and its place in the input, not on threads or on other points. `progress` gets the
    number of points done.
    """
    table = Table(*sets.local_set(kind, directions, rng), bands)
    out = np.empty((len(positions), bands * bands), np.float32)

    def gather(index: np.ndarray, origins: np.ndarray, turns: np.ndarray) -> None:
        out[index] = tracer.gather(origins, turns, table)

    _over_points(tracer, positions, normals, geometric_normals, len(table.directions), rng, gather, progress, threads)
    return out


def bounce(
    tracer: Tracer,
    positions: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    surface: Surface,
    sent: Float32[np.ndarray, "t k 3"],
    *,
    directions: int = 512,
    rng: np.random.Generator,
    geometric_normals: Float[np.ndarray, "n 3"] | None = None,
    kind: str = "cosine_fibonacci",
    progress: Callable[[int], None] | None = None,
    threads: int | None = None,
) -> Float32[np.ndarray, "n k 3"]:
    """One diffuse bounce: t^b_i(p) = integral of (1 - V) max(0, n.w) albedo(q) / pi t^(b-1)_i(q) dw, q the point hit.

    Sloan, Kautz and Snyder 2002, section 5. `sent` is albedo / pi t^(b-1) at the rows of `surface`
    (`surface.outgoing`): responses to the light's coefficients, not functions of direction, so they never turn and
    never enter a triple product. The receiver's albedo is not in it. Other arguments as for `bake`.
    """
    local, weights = sets.local_set(kind, directions, rng)
    aims, rows = local.astype(np.float32), weights.astype(np.float32)[:, None]
    values = np.ascontiguousarray(sent.reshape(len(sent), -1), np.float32)
    out = np.empty((len(positions), values.shape[1]), np.float32)

    def gather(index: np.ndarray, origins: np.ndarray, turns: np.ndarray) -> None:
        out[index] = tracer.bounced(origins, turns, aims, rows, surface, values)[..., 0]

    _over_points(tracer, positions, normals, geometric_normals, len(aims), rng, gather, progress, threads)
    return out.reshape(len(positions), *sent.shape[1:])


def incident(
    tracer: Tracer,
    positions: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    surface: Surface,
    sent: Float32[np.ndarray, "t 3"],
    *,
    bands: int = 5,
    directions: int = 512,
    rng: np.random.Generator,
    geometric_normals: Float[np.ndarray, "n 3"] | None = None,
    kind: str = "cosine_fibonacci",
    progress: Callable[[int], None] | None = None,
    threads: int | None = None,
) -> Float32[np.ndarray, "n k 3"]:
    """Light from other surfaces, J_k(p) = integral of (1 - V) B(q) max(0, n.w) Y_k(w) dw, on world axes.

    Dhawal, Aakash KT and Narayanan 2022, *PRTT*: under one fixed light of which `sent` is the radiance B at the rows
    of `surface`, the same in all directions. A function of direction, so gloss can look at it. sqrt(4 pi) J_0 is the
    irradiance. Other arguments as for `bake`.
    """
    table = Table(*sets.local_set(kind, directions, rng), bands)
    out = np.empty((len(positions), bands * bands, 3), np.float32)

    def gather(index: np.ndarray, origins: np.ndarray, turns: np.ndarray) -> None:
        seen = tracer.bounced(origins, turns, table.directions, table.rows, surface, sent)
        for colour in range(3):
            out[index, :, colour] = to_world(seen[:, colour], turns)

    _over_points(tracer, positions, normals, geometric_normals, len(table.directions), rng, gather, progress, threads)
    return out


def _over_points(
    tracer: Tracer | MarchTracer,
    positions: np.ndarray,
    normals: np.ndarray,
    geometric_normals: np.ndarray | None,
    directions: int,
    rng: np.random.Generator,
    gather: Callable[[np.ndarray, np.ndarray, np.ndarray], None],
    progress: Callable[[int], None] | None,
    threads: int | None,
) -> None:
    """gather(index, origins, turns) for chunks of neighbouring points, in threads, with progress."""
    sides = normals if geometric_normals is None else geometric_normals
    _check(positions, normals, sides)
    azimuth = rng.random(len(positions)) * 2 * np.pi
    if not len(positions):
        return

    def work(index: np.ndarray) -> int:
        gather(index, tracer.origins(positions[index], sides[index]), sets.turns(normals[index], azimuth[index]))
        return len(index)

    rays = len(positions) * directions
    count = min(len(positions), -(-rays // CHUNK_RAYS))
    chunks = np.array_split(morton_order(tracer.frame.to_unit(positions)), count)
    started = spoken = time.perf_counter()
    done = 0
    for count in in_threads(work, chunks, threads or cores()):
        done += count
        if progress is not None:
            progress(done)
        if time.perf_counter() - spoken > LOG_SECONDS:
            spoken = time.perf_counter()
            _log(tracer.kind, done, len(positions), directions, spoken - started)
    _log(tracer.kind, done, len(positions), directions, time.perf_counter() - started)
    tracer.rays_traced += rays


def _check(positions: np.ndarray, normals: np.ndarray, sides: np.ndarray) -> None:
    if not np.isfinite(positions).all():
        raise PrtnetError("transfer: found positions that are not finite")
    for name, vectors in (("normal", normals), ("geometric normal", sides)):
        length = np.sqrt(np.einsum("ni,ni->n", vectors, vectors, dtype=np.float64))
        if not np.allclose(length, 1, atol=1e-3):
            worst = length[np.argmax(np.abs(length - 1))]
            raise PrtnetError(f"transfer: found a {name} of length {worst:.3g}, expected unit vectors")


def in_threads(work: Callable[[Chunk], int], chunks: Iterable[Chunk], threads: int) -> Iterator[int]:
    """Results of work(chunk) in order. On any exception, Ctrl-C included, chunks that have not begun are dropped."""
    pool = ThreadPoolExecutor(threads)
    try:
        futures: list[Future[int]] = [pool.submit(work, chunk) for chunk in chunks]
        for future in futures:
            yield future.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _log(tracer: str, done: int, total: int, directions: int, seconds: float) -> None:
    rate = done * directions / max(seconds, 1e-9)
    left = f"{(total - done) * directions / rate:.0f} s left" if done < total else f"in {seconds:.1f} s"
    log.debug("transfer: %s, %d of %d points, %.1f Mray/s, %s", tracer, done, total, rate / 1e6, left)


def cores() -> int:
    """Processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
