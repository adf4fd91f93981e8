"""Lightmaps of hair: fibres that scatter light along cones, by Mitsuba 3.

A texel is a tenth of a strand. It holds the mean radiance towards the directions it is seen from, even over the sphere,
and over the width that a viewer there sees; it is shown the same in all of them. What goes further into the hair would
outweigh them, since fibres send most light on. Fibres after Chiang, Bitterli, Tappan and Burley 2016, *A Practical and
Controllable Hair and Fur Model for Production Path Tracing*, as Mitsuba has them.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Float64, Int

from prtnet import PrtnetError
from prtnet.data.lighting.lamp import Lighting
from prtnet.data.lightmap import many_lights, mitsuba
from prtnet.data.lightmap.rendered import Rendered
from prtnet.data.lightmap.strands import TEXELS, Strands, blend, texels, text
from prtnet.data.normals import face_cross
from prtnet.data.part import Part

Array = np.ndarray

# of the width of a strand, that rays aim at: beside its very edge they would pass
EDGE = 0.999
# radii from its middle, where they start: outside of it. And how many directions are tried until one is free; a texel
# that is seen from hardly anywhere makes do with the last
CLEAR, TRIES = 2.0, 16
BOUNCES = 32


@dataclass(frozen=True)
class Fibre:
    """What hair is made of."""

    eumelanin: float = 0.15  # the pigment of brown and black hair, in Mitsuba's units of concentration
    pheomelanin: float = 0.25  # that of red hair
    longitudinal_roughness: float = 0.5  # 0 to 1, along the fibre
    azimuthal_roughness: float = 0.5  # 0 to 1, around it
    scale_tilt: float = 2.0  # of the scales on its surface, in degrees


def lightmaps(
    strands: Strands,
    lightings: Sequence[Lighting],
    *,
    samples: int,
    seed: int,
    body: Part | None = None,
    fibre: Fibre | None = None,
    progress: Callable[[int], None] | None = None,
) -> Rendered:
    """Radiance of the texels of strands under each lighting, ten to a strand; `body` is a diffuse mesh between them.

    All paths serve all lightings. Raises PrtnetError without a working Mitsuba.
    """
    made = made_of(strands, body=body, fibre=fibre)
    mi = mitsuba.module()
    places, tangents = (mi.Point3f(np.ascontiguousarray(each.T, np.float32)) for each in texels(strands))

    def start(sampler: Any, texel: Any) -> Any:
        import drjit as dr

        middle, tangent = dr.gather(mi.Point3f, places, texel), mi.Vector3f(dr.gather(mi.Point3f, tangents, texel))

        def draw(tries: Any, place: Any, towards: Any, sampler: Any) -> tuple[Any, ...]:
            towards = mi.warp.square_to_uniform_sphere(sampler.next_2d())
            across = dr.normalize(dr.cross(tangent, towards))
            place = mi.Point3f(middle + across * (strands.radius * EDGE * (2 * sampler.next_1d() - 1)))
            # a strand looks as wide as the sine of the angle that it is seen under
            hidden = sampler.next_1d() > dr.norm(dr.cross(tangent, towards))
            hidden |= made.ray_test(mi.Ray3f(place + CLEAR * strands.radius * towards, towards))
            return dr.select(hidden, tries + 1, TRIES), place, towards, sampler

        state = mi.UInt32(0), mi.Point3f(middle), mi.Vector3f(0, 0, 1), sampler
        _, place, towards, _ = dr.while_loop(
            state, lambda tries, place, towards, sampler: tries < TRIES, draw, label="seen from"
        )
        return mi.Ray3f(place + CLEAR * strands.radius * towards, -towards)

    count = TEXELS * strands.count
    return many_lights.radiance(made, start, count, lightings, samples=samples, seed=seed, progress=progress)


def view(
    strands: Strands,
    camera: tuple[Array, Array, Array, float],
    lighting: Lighting,
    *,
    size: int,
    samples: int,
    seed: int,
    body: Part | None = None,
    fibre: Fibre | None = None,
) -> Float32[Array, "size size 3"]:
    """The reference: radiance of a square frame by Mitsuba's own path tracer, under one lighting.

    `camera`: eye, target, up in unit coordinates, and the field of view in degrees.
    """
    extra = {
        **mitsuba.emitters(lighting),
        "sensor": mitsuba.perspective(*camera, size),
        "integrator": {"type": "path", "max_depth": BOUNCES, "rr_depth": 16},
    }
    return mitsuba.render(made_of(strands, body=body, fibre=fibre, extra=extra), size, samples, seed)


@dataclass(frozen=True, eq=False)
class Seen:
    """What rays through the pixels of a frame hit first, of those that hit a strand."""

    pixel: Int[Array, " n"]  # row * size + column
    texels: Int[Array, "n 2"]
    weights: Float64[Array, "n 2"]  # of the two texels
    size: int
    rays: int  # through each pixel

    def shown(self, values: Float[Array, "t 3"]) -> Float32[Array, "size size 3"]:
        """The frame that a lightmap makes: black where no strand is."""
        colours = np.einsum("nk,nkc->nc", self.weights, np.asarray(values, np.float64)[self.texels])
        image = [np.bincount(self.pixel, colours[:, c], self.size**2) for c in range(3)]
        return (np.stack(image, axis=1) / self.rays).astype(np.float32).reshape(self.size, self.size, 3)


def seen(
    strands: Strands,
    camera: tuple[Array, Array, Array, float],
    *,
    size: int,
    rays: int,
    seed: int,
    body: Part | None = None,
) -> Seen:
    """(strand, arc length) under each pixel, by `rays` random rays through each."""
    mi = mitsuba.module()
    import drjit as dr

    scene = made_of(strands, body=body, extra={"sensor": mitsuba.perspective(*camera, size)})
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, size * size * rays)
    pixel = dr.arange(mi.UInt32, size * size * rays) // rays
    offset = sampler.next_2d()
    place = mi.Point2f((pixel % size + offset.x) / size, (pixel // size + offset.y) / size)
    ray, _ = scene.sensors()[0].sample_ray(0.0, 0.0, place, mi.Point2f(0.5))
    found = scene.ray_intersect_preliminary(ray)
    hit = np.array(found.is_valid() & ~found.shape.is_mesh())
    strand, segment = np.divmod(np.array(found.prim_index)[hit].astype(int), strands.segments)
    share = strands.share(strand, segment + np.array(found.prim_uv.x)[hit].astype(np.float64))
    at, weights = blend(strand, share)
    return Seen(np.array(pixel)[hit].astype(int), at, weights, size, rays)


def made_of(
    strands: Strands, *, body: Part | None = None, fibre: Fibre | None = None, extra: dict[str, Any] | None = None
) -> Any:
    """The scene for Mitsuba: the strands as B-splines, and the body."""
    mi = mitsuba.module()
    own = fibre or Fibre()
    rough = own.longitudinal_roughness, own.azimuthal_roughness
    if min(asdict(own).values()) < 0 or not 0 < min(rough) <= max(rough) <= 1:
        raise PrtnetError(f"hair: found {own}, expected pigments of at least 0 and roughness above 0 and up to 1")
    things: dict[str, Any] = {"type": "scene", **(extra or {})}
    if body is not None:
        normals = body.normals if body.normals is not None else _normals(body)
        diffuse = {"type": "diffuse", "reflectance": {"type": "rgb", "value": np.asarray(body.albedo).tolist()}}
        things["body"] = mitsuba.mesh("body", body.vertices, body.faces, normals, {"type": "twosided", "bsdf": diffuse})
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "strands.txt"
        path.write_text(text(strands), encoding="ascii")
        things["strands"] = {"type": "bsplinecurve", "filename": str(path), "bsdf": {"type": "hair", **asdict(own)}}
        return mi.load_dict(things)


def _normals(body: Part) -> Float64[Array, "v 3"]:
    """Of vertices, by the areas around them."""
    cross = face_cross(body.vertices, body.faces)
    sums = np.zeros_like(np.asarray(body.vertices, np.float64))
    for corner in range(3):
        np.add.at(sums, body.faces[:, corner], cross)
    return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
