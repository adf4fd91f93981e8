"""A mesh as an implicit surface: a network fitted to its signed distance, kept under a hash of the mesh and the fit."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from prtnet import PrtnetError, console
from prtnet.config import SdfOptions
from prtnet.data import samples
from prtnet.data.albedo import albedo
from prtnet.data.implicit import neural
from prtnet.data.implicit.neural import Neural
from prtnet.data.implicit.surface import Implicit
from prtnet.data.implicit.surface_error import SurfaceError, surface_error
from prtnet.data.scene import Frame, Material, Scene
from prtnet.data.signed_distance import Distance
from prtnet.models import neural_sdf
from prtnet.store import Artifact, Store

# part of every key: raised when a fit changes for the same inputs
VERSION = 1
FILLED = 0.97  # of [-1, 1] by the mesh: a fit may bulge, and what is beyond is neither learned nor seen
STEPS_A_SECOND = 200  # of CPU time at the default size; for the estimate alone


@dataclass(frozen=True)
class Fitted:
    """The surface, and what a report says of it: `SurfaceError`, its chamfer and worst, lipschitz and cpu_seconds."""

    implicit: Implicit
    facts: Mapping[str, Any]


def check(options: SdfOptions) -> None:
    """Raises PrtnetError for options that no network can have."""
    for key, least in {"width": 1, "depth": 1, "steps": 1}.items():
        found = getattr(options, key)
        if found < least:
            raise PrtnetError(f"sdf.{key}: found {found}, expected at least {least}")


def implicit_of_mesh(scene: Scene, options: SdfOptions, store: Store) -> Fitted:
    """A mesh, in the file's coordinates, as an implicit surface with its frame, its camera and its mean albedo.

    Raises PrtnetError for a mesh without an inside, and for a fit whose surface is worse than `largest_error`; then
    nothing is kept.
    """
    check(options)
    scene = replace(scene, frame=Frame(scene.frame.centre, scene.frame.scale * FILLED))
    words = {key: getattr(options, key) for key in ("width", "depth", "steps", "seed", "largest_error")}
    inputs = {"version": VERSION, "scene": scene.digest(), "fit": words}
    kept = store.once("neural_sdf", inputs, lambda: _fitted(scene, options, store, inputs))
    field = neural.load(kept.path)
    implicit = Implicit(scene.name, field, (_material(scene),), scene.frame, scene.camera)
    return Fitted(implicit, kept.facts)


def _fitted(scene: Scene, options: SdfOptions, store: Store, inputs: Mapping[str, Any]) -> Artifact:
    title = f"neural distance: {options.steps} steps, {options.depth} layers of {options.width}"
    console.estimate(title, seconds=10 + options.steps / STEPS_A_SECOND, memory=4e8, disk=1e5)
    distance = Distance(scene)
    fit = neural_sdf.fit(
        distance, width=options.width, depth=options.depth, steps=options.steps, seed=options.seed, frame=scene.frame
    )
    error = _error(fit.field, distance, options)
    derived = {"chamfer": error.chamfer, "worst": error.worst, "lipschitz": fit.field.lipschitz}
    facts = asdict(error) | derived | {"cpu_seconds": fit.cpu_seconds}
    return store.put("neural_sdf", inputs, lambda path: neural.save(fit.field, path), facts)


def _error(field: Neural, distance: Distance, options: SdfOptions) -> SurfaceError:
    advice = "raise sdf.width or sdf.steps"
    try:
        error = surface_error(field, distance, np.random.default_rng(options.seed + 1))
    except PrtnetError as reason:
        raise PrtnetError(f"{reason}; the fit has not converged: {advice}") from reason
    if error.worst > options.largest_error:
        raise PrtnetError(
            f"{distance.scene.name}: found a neural surface that is off by up to {100 * error.worst:.2g} % of the "
            f"longest side of the mesh ({100 * error.chamfer:.2g} % in the mean), expected at most "
            f"{100 * options.largest_error:.2g} %; {advice}, or sdf.largest_error"
        )
    return error


def _material(scene: Scene) -> Material:
    """One for all: linear RGB, mean over the area. Texture coordinates do not outlive the triangles."""
    points = samples.area_uniform(scene, 4096, np.random.default_rng(0))
    assert points.weights is not None
    split = scene.split_sides()
    mean = albedo(split, points.face, points.weights).mean(axis=0, dtype=np.float64)
    return Material(scene.name, mean.astype(np.float32))
