"""Lightmaps of translucent solids: a boundary that refracts, a medium inside that scatters, by Mitsuba 3.

A texel holds what leaves its surface point as radiance, the mean over directions weighted by the cosine
(exitance / pi), with what the boundary itself reflects. It is shown the same in all directions.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Float64

from prtnet import PrtnetError
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.lightmap import many_lights, mitsuba
from prtnet.data.lightmap.rendered import Rendered
from prtnet.data.samples import Samples
from prtnet.data.scene import Scene

Array = np.ndarray

# of the boundary: microfacets after Walter et al. 2007 (GGX), which pass the light of lamps without a size. Smoother
# ones take more samples; rougher ones lose more light between facets, at every reflection inside: a medium that takes
# nothing shows 0.71 of even light at 0.3, 0.51 at 0.5
ROUGHNESS, INDEX = 0.3, 1.4
# how far off the surface the rays start that look at it, in unit lengths
NEAR = 1e-4


def lightmaps(
    scene: Scene,
    points: Samples,
    lightings: Sequence[Lighting],
    *,
    samples: int,
    density: float,
    seed: int,
    albedo: Float[Array, "t 3"] | None = None,
    solid: Sequence[str] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Rendered:
    """Exitance / pi at points of a scene, under each lighting. All paths serve all lightings.

    `density` is the extinction per unit length inside of the parts named `solid`, by themselves all that are closed;
    the others are diffuse. A part has one colour: the mean `albedo` of its points, or without it that of its material.
    Raises PrtnetError without a working Mitsuba, and where nothing is solid.
    """
    colours = None if albedo is None else _means(scene, points, albedo)
    made = made_of(scene, density=density, solid=solid, colours=colours)
    mi = mitsuba.module()
    positions, normals = (
        mi.Point3f(np.ascontiguousarray(each, np.float32).T)
        for each in (scene.frame.to_unit(points.positions), points.geometric_normals)
    )

    def start(sampler: Any, texel: Any) -> Any:
        import drjit as dr

        place, normal = dr.gather(mi.Point3f, positions, texel), dr.gather(mi.Point3f, normals, texel)
        local = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
        towards = mi.Frame3f(mi.Normal3f(normal)).to_world(local)
        return mi.Ray3f(place + NEAR * towards, -towards)

    return many_lights.radiance(
        made, start, len(points.positions), lightings, samples=samples, seed=seed, density=density, progress=progress
    )


def view(
    scene: Scene,
    camera: tuple[Array, Array, Array, float],
    lighting: Lighting,
    *,
    size: int,
    samples: int,
    density: float,
    seed: int,
    solid: Sequence[str] | None = None,
) -> Float32[Array, "size size 3"]:
    """The reference: radiance of a square frame by Mitsuba's own integrator of volumes, under one lighting.

    `camera`: eye, target, up in unit coordinates, and the field of view in degrees.
    """
    made = made_of(
        scene,
        density=density,
        solid=solid,
        extra={
            **mitsuba.emitters(lighting),
            "sensor": mitsuba.perspective(*camera, size),
            "integrator": {"type": "volpath", "max_depth": 4096, "rr_depth": 64},
        },
    )
    return mitsuba.render(made, size, samples, seed)


def made_of(
    scene: Scene,
    *,
    density: float,
    solid: Sequence[str] | None = None,
    colours: Float[Array, "parts 3"] | None = None,
    extra: dict[str, Any] | None = None,
) -> Any:
    """The scene for Mitsuba, in unit coordinates; `colours` of its parts, by themselves those of their materials."""
    mi = mitsuba.module()
    if not density > 0:
        raise PrtnetError(f"data_driven.density: found {density}, expected an extinction above 0 per unit length")
    chosen = solids(scene, solid)
    unit = scene.centred()
    shapes: dict[str, Any] = {}
    for number, material in enumerate(unit.materials):
        of_part = unit.part == number
        if not of_part.any():
            continue
        colour = _colour(material) if colours is None or np.isnan(colours[number]).any() else colours[number]
        is_solid = number in chosen
        used, corner = np.unique(unit.faces[of_part], return_inverse=True)
        shapes[f"part{number}"] = mitsuba.mesh(
            f"part{number}",
            unit.vertices[used],
            corner.reshape(-1, 3),
            unit.normals[used],
            _boundary() if is_solid else _diffuse(colour),
            _medium(colour, density) if is_solid else None,
        )
    return mi.load_dict({"type": "scene", **shapes, **(extra or {})})


def solids(scene: Scene, named: Sequence[str] | None) -> set[int]:
    """Numbers of the parts that light goes into. Raises PrtnetError for unknown or open ones, and for none at all."""
    names = [material.name for material in scene.materials]
    closed = {i for i in range(len(names)) if (scene.part == i).any() and not scene.two_sided[scene.part == i].any()}
    if named is None:
        if not closed:
            raise PrtnetError(f"{scene.name}: subsurface: found only open parts ({', '.join(names)}), expected a solid")
        return closed
    unfit = [name for name in named if name not in names or names.index(name) not in closed]
    if unfit or not named:
        raise PrtnetError(
            f"{scene.name}: subsurface: found {unfit or 'no part'}, expected some of the closed parts"
            f" {', '.join(names[i] for i in sorted(closed))}"
        )
    return {names.index(name) for name in named}


def _colour(material: Any) -> Float64[Array, " 3"]:
    """Media and surfaces have one colour: a textured part has the mean of its texture."""
    found = np.asarray(material.albedo, np.float64)
    return found if material.texture is None else found * material.texture.mean(axis=(0, 1), dtype=np.float64)


def _means(scene: Scene, points: Samples, albedo: Float[Array, "t 3"]) -> Float64[Array, "parts 3"]:
    """Mean albedo of the points of each part; not a number where a part has none."""
    part = scene.split_sides().part[points.face]
    counts = np.bincount(part, minlength=len(scene.materials))
    sums = [np.bincount(part, albedo[:, c].astype(np.float64), len(scene.materials)) for c in range(3)]
    return np.where(counts[:, None] > 0, np.stack(sums, axis=1) / np.maximum(counts, 1)[:, None], np.nan)


def _boundary() -> dict[str, Any]:
    return {"type": "roughdielectric", "distribution": "ggx", "alpha": ROUGHNESS, "int_ior": INDEX, "ext_ior": 1.0}


def _diffuse(colour: Float[Array, " 3"]) -> dict[str, Any]:
    surface = {"type": "diffuse", "reflectance": {"type": "rgb", "value": colour.tolist()}}
    return {"type": "twosided", "bsdf": surface}


def _medium(colour: Float[Array, " 3"], density: float) -> dict[str, Any]:
    albedo = {"type": "rgb", "value": scattering_albedo(colour).tolist()}
    return {"type": "homogeneous", "albedo": albedo, "sigma_t": float(density), "phase": {"type": "isotropic"}}


def scattering_albedo(colour: Float[Array, "*n"]) -> Float64[Array, "*n"]:
    """Of a medium that scatters evenly and whose thick layer reflects about `colour`: 1 - s^2.

    Kulla and Conty 2017, *Revisiting Physically Based Shading at Imageworks*, fitted to a medium without a boundary;
    what the boundary throws back into it makes colours a little deeper.
    """
    a = np.clip(np.asarray(colour, np.float64), 0, 0.999)
    s = 4.09712 + 4.20863 * a - np.sqrt(9.59217 + 41.6808 * a + 17.7126 * a * a)
    return 1 - s * s
