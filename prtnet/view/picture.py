"""What a state of the viewer looks like: the methods drawn, tone-mapped and laid beside each other into a frame."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import moderngl
import numpy as np
from jaxtyping import Float

from prtnet import PrtnetError, gl, score, sh
from prtnet.data.scene import Scene
from prtnet.gl import Target
from prtnet.render import reflectance
from prtnet.render.camera import Camera, before
from prtnet.render.material import Material, OfPart
from prtnet.render.method import Shaded
from prtnet.view.state import State
from prtnet.view.text import help_image

Array = np.ndarray

BASELINE = "texture"  # what others are compared with
MARGIN = 12  # pixels around the help


@dataclass(frozen=True, eq=False)
class Show:
    """A scene, its lights and materials, and what makes its methods."""

    scene: Scene  # in unit coordinates
    cameras: Sequence[Camera]  # views by which the exposure is chosen
    lights: Mapping[str, Float[Array, "k 3"]]
    diffuse: Material
    glossy: Material | None  # takes any light; None where there are too many bands for gloss
    make: Callable[[str, Material], Shaded]  # a method by its name


class Picture:
    """Draws states. Methods are made when they are first shown, and drawn when what they show has changed."""

    def __init__(self, show: Show, *, scale: float = 1.0):
        self.show, self._scale = show, scale
        self._points = show.scene.vertices[np.unique(show.scene.faces)]
        self._methods: dict[tuple[str, bool], Shaded] = {}
        self._frames: dict[str, Frame] = {}
        self._exposures: dict[tuple[int, bool], float] = {}
        self.milliseconds = float("nan")  # of the method's last frame

    def ready(self, state: State) -> bool:
        """Whether the method is made already."""
        return (state.method, state.glossy) in self._methods

    def draw(self, state: State, target: Target) -> None:
        """The state in a frame of any size, encoded in sRGB."""
        width, height = target.size
        exposure = self._exposure(state, (width, height))
        shown = self._frame("shown", state.method, state, (width, height))
        self.milliseconds = shown.milliseconds
        compared = state.split or state.error
        other = self._frame("other", BASELINE, state, (width, height)) if compared else shown
        program, overlay = self._present
        for unit, texture in enumerate((shown.texture, other.texture, overlay)):
            texture.use(unit)
        gl.put(program, shown=0, other=1, overlay=2, exposure=exposure, split=state.split, error=state.error)
        corner = MARGIN, height - MARGIN - overlay.height
        gl.put(program, bar=state.mouse * width, corner=corner, covering=float(state.help))
        gl.fullscreen(program, target)

    def camera(self, state: State) -> Camera:
        """The state's camera with the near plane before the scene."""
        return before(state.orbit.camera(), self._points)

    def _frame(self, slot: str, name: str, state: State, size: tuple[int, int]) -> "Frame":
        """The method's picture, linear, drawn anew where it is not the slot's last one."""
        key = (name, state.glossy, state.sharpness, state.light, state.azimuth, state.tilt, state.orbit, size)
        kept = self._frames.get(slot)
        if kept and kept.key == key:
            return kept
        fresh = (name, state.glossy) not in self._methods
        method = self._method(name, state, size)
        light = list(self.show.lights.values())[state.light]
        method.set_light(sh.rotate(light, state.rotation()).astype(np.float32))
        camera = self.camera(state)
        target = kept.target if kept and kept.key[-1] == size else gl.target(*size)
        if fresh:
            method.render(camera)  # compilers and drivers put much off until the first frame
        gl.context().finish()
        start = time.perf_counter()
        method.render(camera)
        gl.context().finish()
        spent = 1000 * (time.perf_counter() - start)
        gl.context().copy_framebuffer(target.framebuffer, method.raster.target.framebuffer)
        self._frames[slot] = Frame(key, target, spent)
        return self._frames[slot]

    def _method(self, name: str, state: State, size: tuple[int, int]) -> Shaded:
        """A method with the state's material and a frame of that size."""
        found = self._methods.get((name, state.glossy))
        glossy = self.show.glossy if state.glossy else None
        material = sharpened(glossy, self.show.scene, state.sharper) if glossy else self.show.diffuse
        if found is None:
            found = self._methods[name, state.glossy] = self.show.make(name, material)
        elif found.material != material:
            found.set_material(material)
        if found.raster.target.size != size:
            found.raster.resize(*size)
        return found

    def _exposure(self, state: State, size: tuple[int, int]) -> float:
        """As in scores, but by the texture's pictures: one for each light, however it is turned, and material."""
        key = state.light, state.glossy
        if key not in self._exposures:
            unturned = replace(state, azimuth=0.0, tilt=0.0, sharpness=0)
            method = self._method(BASELINE, unturned, size)
            images = [self._drawn(method, unturned, camera) for camera in self.show.cameras]
            self._exposures[key] = 1.0
            with suppress(PrtnetError):  # all of it is black, and stays so
                masks = [image[..., 3] > 0 for image in images]
                self._exposures[key] = score.exposure([image[..., :3] for image in images], masks)
        return self._exposures[key]

    def _drawn(self, method: Shaded, state: State, camera: Camera) -> Float[Array, "h w 4"]:
        method.set_light(list(self.show.lights.values())[state.light])
        method.render(camera)
        return method.raster.target.read()

    @cached_property
    def _present(self) -> tuple[moderngl.Program, moderngl.Texture]:
        program = gl.program(gl.shader("fullscreen.vert.glsl"), gl.shader("present.frag.glsl"))
        return program, gl.upload(help_image(self._scale))


@dataclass(frozen=True, eq=False)
class Frame:
    """A method's picture, and what it shows."""

    key: tuple[Any, ...]
    target: Target
    milliseconds: float

    @property
    def texture(self) -> moderngl.Texture:
        texture = self.target.framebuffer.color_attachments[0]
        assert isinstance(texture, moderngl.Texture)
        return texture


def sharpened(material: Material, scene: Scene, factor: float) -> Material:
    """A material with all its exponents times a factor, but for those that follow from the file's roughness.

    Every part has an exponent of its own, so that a program takes any of them without being compiled again.
    """
    by_file = material.roughness == "file"
    parts = {}
    for name in reflectance.names_of(scene):
        part = material.parts.get(name, OfPart())
        exponent = part.exponent if part.exponent or by_file else material.exponent
        parts[name] = replace(part, exponent=exponent and factor * exponent)
    # a program for one exponent is written where no part has another than the material's
    other = 1 + max([factor * material.exponent, *(part.exponent or 0 for part in parts.values())])
    return replace(material, parts=parts, exponent=other)
