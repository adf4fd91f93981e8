"""Mitsuba 3 as a renderer of light that our own tracer does not follow: whether it runs here, and what it is given.

Jakob et al. 2022, *Mitsuba 3 renderer*; Jakob, Speierer, Roussel and Vicini 2022, *Dr.Jit*. Dr.Jit compiles with LLVM;
some versions of LLVM kill the process when they first compile (15: "Cannot select fminimum"), so a library is tried in
a process of its own before it is loaded in this one. Scenes are given to Mitsuba in unit coordinates.
"""

import importlib.util
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int

from prtnet import PrtnetError, sh
from prtnet.data.lighting.lamp import Lamp, Lighting

Array = np.ndarray

VARIANT = "llvm_ad_rgb"
INSTALL = "pip install 'mitsuba>=3.7'"
INSTALL_LLVM = "apt-get install libllvm19"
SETTING = "DRJIT_LIBLLVM_PATH"
FOLDERS = ("/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib", "/usr/local/lib")
PATIENCE = 120.0  # seconds; a trial takes about one
# the smallest thing that meets Embree, loops, textures and virtual functions
TRIAL = f"""
import mitsuba
mitsuba.set_variant({VARIANT!r})
box = mitsuba.cornell_box()
box["sensor"]["film"].update(width=4, height=4)
print("rendered", float(mitsuba.render(mitsuba.load_dict(box), spp=1).array[0]) >= 0)
"""
# rows of the lat-long image of an environment, and texels along one side of a spot's
HEIGHT, SPOT = 64, 256


def check() -> None:
    """Raises PrtnetError, with the line to type, where Mitsuba is absent or no LLVM works; chooses one that does.

    Takes about a second, once in a process.
    """
    if importlib.util.find_spec("mitsuba") is None:
        raise PrtnetError(f"mitsuba: it is not installed, expected the extra paths: type `{INSTALL}`")
    given = os.environ.get(SETTING)
    found = usable(tuple(libraries()) if given is None else (given,))
    if found is None:
        which = f"{SETTING}={given}" if given else ", ".join(libraries()) or "no libLLVM in the usual folders"
        raise PrtnetError(
            f"mitsuba: found no LLVM that it can compile with ({which}), expected one such as version 19: type"
            f" `{INSTALL_LLVM}`, or set {SETTING} to the file of another"
        )
    os.environ[SETTING] = found


@lru_cache
def usable(candidates: tuple[str, ...]) -> str | None:
    """The first library with which a process renders a picture and lives."""
    return next((each for each in candidates if survives(each)), None)


def survives(library: str) -> bool:
    """Whether Mitsuba renders with this LLVM, tried in another process."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", TRIAL],
            env={**os.environ, SETTING: library},
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0 and "rendered True" in done.stdout


def libraries() -> list[str]:
    """Shared libraries of LLVM on this machine, the newest version first."""
    found = {}
    for folder in [*FOLDERS, *map(str, Path("/usr/lib").glob("llvm-*/lib"))]:
        for path in Path(folder).glob("libLLVM*.so*"):
            version = re.fullmatch(r"libLLVM(?:-(\d+))?[\d.]*\.so(?:\.(\d+))?[\d.]*", path.name)
            if version and any(version.groups()):
                found.setdefault(path.resolve(), (int(version[1] or version[2]), str(path)))
    return [path for _, path in sorted(found.values(), reverse=True)]


def module() -> Any:
    """Mitsuba, checked, with the variant that everything here is written for."""
    check()
    import mitsuba

    if mitsuba.variant() != VARIANT:
        mitsuba.set_variant(VARIANT)
    return mitsuba


def mesh(
    name: str,
    vertices: Float[Array, "v 3"],
    faces: Int[Array, "f 3"],
    normals: Float[Array, "v 3"],
    bsdf: Mapping[str, Any],
    interior: Mapping[str, Any] | None = None,
) -> Any:
    """A mesh in unit coordinates with shading normals, its surface and the medium inside."""
    mi = module()
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(dict(bsdf))
    if interior is not None:
        properties["interior"] = mi.load_dict(dict(interior))
    found = mi.Mesh(name, len(vertices), len(faces), props=properties, has_vertex_normals=True)
    values = mi.traverse(found)
    values["vertex_positions"] = np.ascontiguousarray(vertices, np.float32).ravel()
    values["vertex_normals"] = np.ascontiguousarray(normals, np.float32).ravel()
    values["faces"] = np.ascontiguousarray(faces, np.uint32).ravel()
    values.update()
    return found


def emitters(lighting: Lighting) -> dict[str, Any]:
    """Lamps, and the environment as an image: the same light as `prtnet.data.lighting`.

    A spot's falloff, which Mitsuba has linear in the angle, is an image that the spot throws. SH radiance below 0 is
    light that no path tracer has: it is 0.
    """
    mi = module()
    found: dict[str, Any] = {f"lamp{number}": _emitter(mi, lamp) for number, lamp in enumerate(lighting.lamps)}
    if lighting.environment is not None:
        image = sphere_image(lighting.environment)
        found["environment"] = {"type": "envmap", "bitmap": mi.Bitmap(image), "scale": 1.0}
    return found


def _emitter(mi: Any, lamp: Lamp) -> dict[str, Any]:
    colour = {"type": "rgb", "value": list(lamp.colour)}
    if lamp.kind == "point":
        return {"type": "point", "position": list(lamp.position), "intensity": colour}
    if lamp.kind == "directional":
        return {"type": "directional", "direction": list(lamp.aim), "irradiance": colour}
    up = [0.0, 1.0, 0.0] if abs(lamp.aim[1]) < 0.9 else [1.0, 0.0, 0.0]
    target = (np.asarray(lamp.position) + lamp.aim).tolist()
    return {
        "type": "spot",
        "to_world": mi.ScalarTransform4f().look_at(list(lamp.position), target, up),
        "intensity": colour,
        "cutoff_angle": lamp.outer,
        # up to its very edge: what falls off is the image
        "beam_width": lamp.outer * (1 - 1e-6),
        "texture": {"type": "bitmap", "bitmap": mi.Bitmap(spot_image(lamp)), "raw": True, "wrap_mode": "clamp"},
    }


def spot_image(lamp: Lamp) -> Float32[Array, "size size 3"]:
    """A spot's falloff over the square that its cone fits in, at distance 1."""
    outer, inner = np.cos(np.radians([lamp.outer, lamp.inner]))
    across = ((np.arange(SPOT) + 0.5) / SPOT * 2 - 1) * np.tan(np.radians(lamp.outer))
    cosine = 1 / np.sqrt(1 + across**2 + across[:, None] ** 2)
    step = np.clip((cosine - outer) / (inner - outer), 0, 1)
    return np.repeat((step * step * (3 - 2 * step)).astype(np.float32)[..., None], 3, axis=2)


def sphere_image(environment: Float[Array, "k 3"], height: int = HEIGHT) -> Float32[Array, "h w 3"]:
    """Radiance of SH light, at least 0, as Mitsuba's envmap maps it: the first and last row are the poles themselves,
    and the middle looks down +z."""
    angle = (np.arange(2 * height) + 0.5) / height * np.pi
    polar = (np.arange(height) / (height - 1) * np.pi)[:, None]
    level = np.sin(polar)
    parts = level * np.sin(angle), np.cos(polar), -level * np.cos(angle)
    return clipped(np.stack(np.broadcast_arrays(*parts), axis=-1), environment)


def clipped(directions: Float[Array, "*n 3"], environment: Float[Array, "k 3"]) -> Float32[Array, "*n 3"]:
    """Radiance of SH light from directions, 0 where the sum is below."""
    basis = sh.evaluate(directions, sh.bands_of(len(environment)))
    return np.maximum(basis @ np.asarray(environment, np.float64), 0).astype(np.float32)


def perspective(eye: Array, target: Array, up: Array, fov_y: float, size: int) -> dict[str, Any]:
    """A square pinhole camera whose pixels are boxes. Fields as in `prtnet.render.camera.Camera`."""
    mi = module()
    place = mi.ScalarTransform4f().look_at(*(np.asarray(each, np.float64).tolist() for each in (eye, target, up)))
    film = {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    return {"type": "perspective", "fov": float(fov_y), "to_world": place, "film": film, "near_clip": 1e-3}


def render(scene: Any, size: int, samples: int, seed: int) -> Float32[Array, "size size 3"]:
    """A view by Mitsuba's own integrator: linear radiance, row 0 on top."""
    mi = module()
    image = np.array(mi.render(scene, spp=samples, seed=seed), np.float32)
    assert image.shape == (size, size, 3)
    return image
