"""Occlusion rays: Embree through embreex, by itself or driven from a compiled kernel that sums SH on the way.

`fused` calls Embree's packet queries inside the embreex wheel from a numba kernel. `embreex` is its plain twin:
EmbreeScene.run and NumPy, on the same float32 rays. Both work in the scene's unit coordinates.
"""

import logging
import time
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int32

from prtnet import PrtnetError, sh
from prtnet.data import directions as sets
from prtnet.data.directions import QUARTER, Table
from prtnet.data.embree import EmbreeUnavailable, PacketScene
from prtnet.data.samples import morton_order
from prtnet.data.scene import Scene
from prtnet.data.surface import Surface

log = logging.getLogger(__name__)

KINDS = ("auto", "fused", "embreex")
FAR = 1e30  # embreex gives rays that hit nothing a length of 1e37


class Tracer:
    """Rays against one scene. `kind`: fused, embreex, or auto (fused where the wheel's library allows, else embreex).

    `rays_traced` counts rays; `offset` is the distance in unit coordinates at which rays start off the surface.
    Raises PrtnetError without embreex, and for kind=fused where that path is not available.
    """

    def __init__(self, scene: Scene, *, kind: str = "auto", width: int | None = None, offset: float | None = None):
        if kind not in KINDS:
            raise PrtnetError(f"tracer: found kind {kind!r}, expected one of {', '.join(KINDS)}")
        self.frame = scene.frame
        vertices = self.frame.to_unit(scene.vertices)
        faces = np.ascontiguousarray(scene.faces, np.int32)
        self.offset = _offset(vertices) if offset is None else offset
        self.rays_traced = 0
        started = time.perf_counter()
        self._mesh = np.ascontiguousarray(vertices, np.float32), faces
        self._scene = _open(*self._mesh, kind, width)
        self.kind = "fused" if isinstance(self._scene, PacketScene) else "embreex"
        how = f"packets of {self._scene.width}" if isinstance(self._scene, PacketScene) else "single rays"
        seconds = time.perf_counter() - started
        log.info("tracer: %s (Embree, %s), %d triangles, built in %.2f s", self.kind, how, len(faces), seconds)

    @property
    def packets(self) -> PacketScene | None:
        """What compiled kernels trace against; None with plain embreex."""
        return self._scene if isinstance(self._scene, PacketScene) else None

    def origins(
        self, positions: Float[np.ndarray, "n 3"], geometric_normals: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n 3"]:
        """Where rays start: unit coordinates, float32, off the surface along the unit geometric normals."""
        unit = self.frame.to_unit(positions)
        return (unit + self.offset * geometric_normals).astype(np.float32)

    def occluded(
        self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> Bool[np.ndarray, " n"]:
        """Whether rays from `origins` (scene coordinates; no offset is added) hit anything."""
        start = self.frame.to_unit(origins).astype(np.float32)
        self.rays_traced += len(start)
        return self.trace(start, np.ascontiguousarray(directions, np.float32))

    def clearance(
        self, positions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], directions: int = 32
    ) -> Float[np.ndarray, " n"]:
        """How far one sees from points (scene coordinates) into the half-space of their unit normals, at the most.

        In unit lengths, infinite where one sees out of the scene. A point on the bottom of a box that stands on a floor
        has almost none; a point on the wall of a dark room has some.
        """
        scene = _plain(*self._mesh)
        local, _ = sets.local_set("cosine_fibonacci", directions, np.random.default_rng(0))
        frames = sets.frames(sets.turns(normals, np.zeros(len(normals))))
        start, aim = rays(self.origins(positions, normals), frames, local.astype(np.float32))
        far = scene.run(start, aim, query="DISTANCE").reshape(len(positions), -1).max(axis=1)
        return np.where(far > FAR, np.inf, far)

    def trace(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        if not isinstance(self._scene, PacketScene):
            return self._scene.run(origins, directions, query="OCCLUDED") != -1
        from prtnet.data import kernels

        hit = np.empty(len(origins), np.bool_)
        rays, valid = kernels.packet(self._scene.width)
        trace = kernels.occluded_kernel(self._scene.width)
        trace(self._scene.function, self._scene.address, self._scene.options, rays, valid, origins, directions, hit)
        return hit

    def hits(
        self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> tuple[Int32[np.ndarray, " n"], Float32[np.ndarray, "n 2"], Float32[np.ndarray, " n"]]:
        """What rays hit first: face of the scene (-1: nothing), barycentric (u, v), distance in unit lengths or inf.

        The point hit is (1 - u - v) a + u b + v c. Origins in unit coordinates, as `origins` gives them; directions of
        unit length.
        """
        origins, directions = (np.ascontiguousarray(each, np.float32) for each in (origins, directions))
        self.rays_traced += len(origins)
        if not isinstance(self._scene, PacketScene):
            found = self._scene.run(origins, directions, query="INTERSECT", output=True)
            distance = np.where(found["primID"] < 0, np.inf, found["tfar"]).astype(np.float32)
            return found["primID"].astype(np.int32), np.stack([found["u"], found["v"]], axis=1), distance
        from prtnet.data import kernels

        count, scene = len(origins), self._scene
        face, where = np.empty(count, np.int32), np.empty((count, 2), np.float32)
        distance = np.empty(count, np.float32)
        rays, valid = kernels.packet(scene.width)
        closest = kernels.closest_kernel(scene.width)
        closest(scene.closest, scene.address, scene.options, rays, valid, origins, directions, face, where, distance)
        return face, where, distance

    def gather(
        self, origins: Float[np.ndarray, "n 3"], turns: Float[np.ndarray, "n 6"], table: Table
    ) -> Float[np.ndarray, "n k"]:
        """The transfer of points: sum of the table's rows over the free directions, turned to the world, float32.

        `origins` as `self.origins` gives them, `turns` as `directions.turns`. Every point is computed by itself, so
        its bits do not depend on its neighbours. Safe to call from several threads.
        """
        frames = sets.frames(turns)
        if isinstance(self._scene, PacketScene):
            return self._gather_fused(self._scene, origins, frames, turns, table)
        free = ~self.trace(*rays(origins, frames, table.directions)).reshape(len(origins), -1)
        return to_world(free.astype(np.float32) @ table.rows, turns).astype(np.float32)

    def _gather_fused(
        self, scene: PacketScene, origins: np.ndarray, frames: np.ndarray, turns: np.ndarray, table: Table
    ) -> np.ndarray:
        from prtnet.data import kernels

        out = np.empty((len(origins), table.rows.shape[1]), np.float32)
        rays, valid = kernels.packet(scene.width)
        gather = kernels.gather_kernel(scene.width)
        packed = table.packed(scene.width, kernels.LANES)
        gather(
            scene.function, scene.address, scene.options, rays, valid, origins, frames, turns, *packed, *table.flip, out
        )
        return out

    def bounced(
        self,
        origins: Float[np.ndarray, "n 3"],
        turns: Float[np.ndarray, "n 6"],
        local: Float32[np.ndarray, "m 3"],
        rows: Float32[np.ndarray, "m h"],
        surface: Surface,
        values: Float32[np.ndarray, "t c"],
    ) -> Float64[np.ndarray, "n c h"]:
        """Sum over the directions that hit something of values there times the direction's row, in each point's frame.

        `local` is a direction set, `rows` its weights or its weighted SH, `values` what the rows of `surface` send.
        Every point is computed by itself. Safe to call from several threads.
        """
        frames = sets.frames(turns)
        if isinstance(self._scene, PacketScene):
            return self._bounced_fused(self._scene, origins, frames, local, rows, surface, values)
        start, towards = rays(origins, frames, local)
        found = self._scene.run(start, towards, query="INTERSECT", output=True)
        front = np.einsum("ni,ni->n", towards, found["Ng"]) < 0
        texel = surface.rows(found["primID"], np.stack([found["u"], found["v"]], axis=1), front)
        sent = np.where(texel[:, None] < 0, 0, values[texel]).reshape(len(origins), len(local), -1)
        return np.einsum("nmc,mh->nch", sent.astype(np.float64), rows.astype(np.float64))

    def _bounced_fused(
        self,
        scene: PacketScene,
        origins: np.ndarray,
        frames: np.ndarray,
        local: np.ndarray,
        rows: np.ndarray,
        surface: Surface,
        values: np.ndarray,
    ) -> np.ndarray:
        from prtnet.data import kernels

        out = np.empty((len(origins), values.shape[1] * rows.shape[1]))
        rays, valid = kernels.packet(scene.width)
        bounce = kernels.bounce_kernel(scene.width)
        packets = np.ascontiguousarray(local.reshape(-1, scene.width, 3).transpose(0, 2, 1))
        found = surface.corners, surface.behind, surface.place, surface.texels
        bounce(
            scene.closest,
            scene.address,
            scene.options,
            rays,
            valid,
            origins,
            frames,
            packets,
            *found,
            values,
            rows,
            out,
        )
        return out.reshape(len(origins), values.shape[1], rows.shape[1])

    def measure(
        self,
        positions: Float[np.ndarray, "n 3"],
        normals: Float[np.ndarray, "n 3"],
        *,
        bands: int = 5,
        points: int = 1024,
    ) -> float:
        """Rays per second of one thread on some of these points: what an estimate of a bake's time needs.

        Traces short runs of neighbours, as a bake does, and forgets them: no count, no result, no random state is
        touched. The first call in a process also loads the compiled kernel, outside the clock.
        """
        return rate(self, positions, normals, bands=bands, points=points)


def rate(
    tracer: Any, positions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], *, bands: int, points: int
) -> float:
    """`measure` of a tracer of any kind."""
    rng = np.random.default_rng(0)
    table = Table(*sets.local_set("cosine_fibonacci", 512, rng), bands)
    order = morton_order(tracer.frame.to_unit(positions))
    runs = np.array_split(order, 16)
    chosen = np.concatenate([run[: max(1, points // 16)] for run in runs])
    origins = tracer.origins(positions[chosen], normals[chosen])
    turns = sets.turns(normals[chosen], rng.random(len(chosen)) * 2 * np.pi)
    tracer.gather(origins[:1], turns[:1], table)
    started = time.perf_counter()
    tracer.gather(origins, turns, table)
    return len(chosen) * len(table.directions) / (time.perf_counter() - started)


def _offset(vertices: np.ndarray) -> float:
    """Clears the rounding of float32 vertices, origins and hits: two floors, of the diagonal and of the coordinates."""
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    return max(1e-5 * diagonal, 1e-6 * float(np.abs(vertices).max()))


def _open(vertices: np.ndarray, faces: np.ndarray, kind: str, width: int | None) -> Any:
    try:
        import embreex.mesh_construction
        import embreex.rtcore_scene  # noqa: F401
    except ImportError as error:
        raise PrtnetError(f"tracer: embreex cannot be imported ({error}): type `pip install 'embreex>=4.4'`") from error
    if kind != "embreex":
        try:
            return PacketScene(vertices, faces, width)
        except EmbreeUnavailable as error:
            if kind == "fused":
                raise
            log.warning("tracer: NOT the fused path but plain embreex, about 7 times slower: %s", error)
    return _plain(vertices, faces)


def _plain(vertices: np.ndarray, faces: np.ndarray) -> Any:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene(robust=True)
    TriangleMesh(scene, vertices, faces)
    return scene


def rays(origins: np.ndarray, frames: np.ndarray, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every direction at every point, float32, in the order of operations of the compiled kernel."""
    x, y, z = local.T
    world = np.empty((len(frames), len(local), 3), np.float32)
    for axis in range(3):
        a, b, n = (frames[:, axis, column, None] for column in range(3))
        world[..., axis] = x * a + y * b + z * n
    return np.repeat(origins, len(local), axis=0), world.reshape(-1, 3)


def to_world(local: Float[np.ndarray, "n k"], turns: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n k"]:
    """SH coefficients in the frames of `turns`, rotated to world axes (the NumPy twin of the kernel's), float64."""
    bands = sh.bands_of(local.shape[1])
    flip = sh.rotation_matrix(QUARTER, bands)
    out = _turn_z(np.asarray(local, np.float64), turns[:, 0], turns[:, 1], bands)
    out = _turn_z(out @ flip, turns[:, 2], turns[:, 3], bands) @ flip.T
    return _turn_z(out, turns[:, 4], turns[:, 5], bands)


def _turn_z(c: np.ndarray, cosine: np.ndarray, sine: np.ndarray, bands: int) -> np.ndarray:
    """Turns about z mix Y_l,m and Y_l,-m by the angle m a."""
    l = sh.band_index(bands)
    m = np.arange(bands * bands) - l * l - l
    steps = np.repeat((cosine + 1j * sine)[:, None], bands, axis=1)
    steps[:, 0] = 1
    powers = np.cumprod(steps, axis=1)[:, np.abs(m)]
    return powers.real * c - np.sign(m) * powers.imag * c[:, l * l + l - m]
