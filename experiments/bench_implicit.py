"""Targets of implicit surfaces, for `bench.py`: speed and error of rays against the surface and against its mesh.

Errors are root mean square of 25 coefficients relative to theirs, from 256 directions at the same points, so that they
are of visibility alone. Their reference walks with epsilon 1e-6 from 1e-5 off the surface, up to 4096 steps.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from prtnet.data import directions, samples
from prtnet.data.implicit import accuracy, builtin, mesh, project
from prtnet.data.implicit.march import EPSILON, OFFSET, STEPS, MarchTracer, evaluated, walked
from prtnet.data.implicit.mesh_tracer import MeshTracer
from prtnet.data.implicit.surface import Implicit
from prtnet.data.samples import Samples
from prtnet.data.tracer import Tracer, rays

POINTS, DIRECTIONS = 2000, 256
FINEST = {"offset": 1e-5, "epsilon": 1e-6, "steps": 4096}
SETTINGS = [
    (2e-5, 2e-6, 4096),
    (OFFSET, EPSILON, STEPS),
    (1e-4, 1e-5, 512),
    (1e-4, 5e-5, 512),
    (3e-4, 1e-5, 256),
    (1e-3, 1e-5, 256),
    (1e-3, 1e-5, 64),
    (1e-3, 5e-4, 256),
    (3e-3, 1e-4, 256),
]
RESOLUTIONS, OFFSETS = (64, 128, 256, 384), (0.1, 0.2, 0.35, 0.5)
Row = dict[str, str | float]


def implicit() -> list[Row]:
    """All scenes at the settings in use; the rabbit at others as well."""
    rows = []
    for name in builtin.NAMES:
        surface = mesh.implicit_of(builtin.make(name))
        finest = MarchTracer(surface.field, frame=surface.frame, **FINEST)
        points = _points(surface)
        expected = accuracy.baked(finest, points, 5, DIRECTIONS)
        rows += _marched(name, surface, points, expected)
        rows += [row for resolution in RESOLUTIONS for row in _meshed(name, surface, points, expected, resolution)]
        rows += _density(name, surface)
    return rows


def _points(surface: Implicit) -> Samples:
    found = samples.area_uniform(mesh.scene_of(surface, 256), POINTS, np.random.default_rng(0))
    return project.projected(surface.field, found, surface.frame)


def _marched(name: str, surface: Implicit, points: Samples, expected: np.ndarray) -> list[Row]:
    common = {"scene": name, "triangles": 0}
    many = np.random.default_rng(0).uniform(-1, 1, (1 << 18, 3)).astype(np.float32)
    seconds = _cpu_seconds(lambda: evaluated(surface.field, many))[0]
    rows: list[Row] = [
        {**common, "what": "steps of the distance's code", "value": len(surface.field.program)},
        {**common, "what": "ns per distance", "value": seconds / len(many) * 1e9},
        {**common, "what": "plain NumPy, Mray per CPU-s", "value": _plain(surface, points)},
    ]
    for offset, epsilon, steps in SETTINGS if name == "sdf_rabbit" else [(OFFSET, EPSILON, STEPS)]:
        tracer = MarchTracer(surface.field, frame=surface.frame, offset=offset, epsilon=epsilon, steps=steps)
        what = f"marched, offset {offset:g}, epsilon {epsilon:g}, {steps} steps"
        rows += _rated(common, what, tracer, points, expected)
        if tracer.rays_lost:
            rows.append({**common, "what": f"{what}: rays lost, %", "value": _lost(tracer, points)})
    return rows


def _lost(tracer: MarchTracer, points: Samples) -> float:
    tracer.rays_lost = 0
    accuracy.baked(tracer, points, 5, DIRECTIONS)
    return 100 * tracer.rays_lost / (len(points.positions) * DIRECTIONS)


def _plain(surface: Implicit, points: Samples) -> float:
    """Rays of a few points by the twin of the walk."""
    few = samples.select(points, np.arange(40))
    tracer = MarchTracer(surface.field, frame=surface.frame)
    local, _ = directions.local_set("cosine_fibonacci", DIRECTIONS, np.random.default_rng(0))
    frames = directions.frames(directions.turns(few.normals, np.zeros(40)))
    start, towards = rays(tracer.origins(few.positions, few.normals), frames, local.astype(np.float32))
    seconds, _ = _cpu_seconds(lambda: walked(surface.field, start.astype(np.float64), towards.astype(np.float64)), 1)
    return len(start) / seconds / 1e6


def _meshed(name: str, surface: Implicit, points: Samples, expected: np.ndarray, resolution: int) -> list[Row]:
    seconds, scene = _cpu_seconds(lambda: mesh.scene_of(surface, resolution), 1)
    common = {"scene": name, "triangles": len(scene.faces)}
    rows: list[Row] = [{**common, "what": f"mesh of {resolution} voxels, CPU-s", "value": seconds}]
    rows += _rated(common, f"mesh of {resolution}, lifted", MeshTracer(scene, resolution), points, expected)
    for offset in OFFSETS:
        tracer = Tracer(scene, offset=offset * 2 / resolution)
        rows += _rated(common, f"mesh of {resolution}, offset {offset:g} voxels", tracer, points, expected)
    return rows


def _rated(common: Row, what: str, tracer: Tracer | MarchTracer, points: Samples, expected: np.ndarray) -> list[Row]:
    accuracy.baked(tracer, samples.select(points, np.arange(2)), 5, DIRECTIONS)
    seconds, found = _cpu_seconds(lambda: accuracy.baked(tracer, points, 5, DIRECTIONS))
    error = accuracy.compared(found, expected)
    return [
        {**common, "what": f"{what}, Mray per CPU-s", "value": len(found) * DIRECTIONS / seconds / 1e6},
        {**common, "what": f"{what}: error, %", "value": 100 * error.relative},
    ]


def _density(name: str, surface: Implicit) -> list[Row]:
    """How equal samples on the mesh are on the surface: the mesh's share of the area in cells of the box against that
    of a finer mesh, root mean square over the area."""
    shares = []
    for resolution in (256, 448):
        scene = mesh.scene_of(surface, resolution).centred()
        centres = scene.vertices[scene.faces].mean(axis=1)
        cells = [np.linspace(-1.01, 1.01, 9)] * 3
        shares.append(np.histogramdd(centres, bins=cells, weights=scene.face_areas / scene.face_areas.sum())[0])
    # cells that a corner of the surface touches tell of the cells, not of the surface
    full = shares[1] > 1e-3
    off = shares[0][full] / shares[1][full] - 1
    value = 100 * float(np.sqrt(np.average(off**2, weights=shares[1][full])))
    common = {"scene": name, "triangles": 0}
    return [{**common, "what": "density of samples on 256 voxels in cells of 1/4, rms %", "value": value}]


def _cpu_seconds(work: Callable[[], Any], times: int = 3) -> tuple[float, Any]:
    """The least of some runs, and the last result."""
    least, found = np.inf, None
    for _ in range(times):
        started = time.process_time()
        found = work()
        least = min(least, time.process_time() - started)
    return float(least), found
