"""What a viewer shows, and what keys and the mouse do to it. No window, no OpenGL."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import cos, radians, sin, tan

import numpy as np
from jaxtyping import Float64

from prtnet.data.light import about_y
from prtnet.render.camera import Camera, Point, look

Array = np.ndarray

TURN = 0.35  # degrees of the orbit or the light for each pixel of a drag
STEP = 5.0  # degrees of the light for each press of an arrow
ZOOM = 0.9  # of the distance, for each notch of the wheel
STEEPEST = 89.0  # degrees above and below the horizon
NEAREST, FARTHEST = 0.02, 20.0  # of the eye to what it looks at, in unit lengths
SHARPEST = 8  # steps of the exponent, a factor of sqrt 2 each, up or down

KEYS = (
    ("drag", "turn the view; right button: the light; middle, or shift: move"),
    ("wheel", "nearer, farther"),
    ("1 2 3", "method"),
    ("L", "next light"),
    ("arrows", "turn the light"),
    ("G", "diffuse or glossy"),
    ("[ ]", "exponent of the gloss"),
    ("S", "split at the mouse: the method to the left, the texture to the right"),
    ("E", "8 x the difference from the texture; with S to the right of the mouse"),
    ("R", "the first view and light again"),
    ("P", "screenshot"),
    ("H", "this help"),
    ("Esc", "quit"),
)


@dataclass(frozen=True)
class Orbit:
    """An eye around a point, in unit coordinates and degrees; azimuth 0 is +z, 90 is +x."""

    target: Point
    azimuth: float
    elevation: float
    distance: float
    fov_y: float

    @classmethod
    def of(cls, camera: Camera) -> "Orbit":
        """The orbit that a camera with y up stands on. Inverse of `camera`, but for near and far."""
        away = np.subtract(camera.eye, camera.target)
        distance = float(np.linalg.norm(away))
        azimuth, elevation = np.degrees([np.arctan2(away[0], away[2]), np.arcsin(away[1] / distance)])
        return cls(camera.target, float(azimuth), float(elevation), distance, camera.fov_y)

    def camera(self) -> Camera:
        azimuth, elevation = radians(self.azimuth), radians(self.elevation)
        away = np.array([sin(azimuth) * cos(elevation), sin(elevation), cos(azimuth) * cos(elevation)])
        return look(np.array(self.target) + self.distance * away, np.array(self.target), self.fov_y)

    def turned(self, right: float, down: float) -> "Orbit":
        """The scene follows the mouse: dragged to the right the eye goes to the left. In degrees."""
        elevation = min(max(self.elevation + down, -STEEPEST), STEEPEST)
        return replace(self, azimuth=(self.azimuth - right + 180) % 360 - 180, elevation=elevation)

    def zoomed(self, notches: float) -> "Orbit":
        return replace(self, distance=min(max(self.distance * ZOOM**notches, NEAREST), FARTHEST))

    def moved(self, right: float, down: float) -> "Orbit":
        """The point that is looked at stays under the mouse. In shares of the frame's height."""
        height = 2 * tan(radians(self.fov_y) / 2) * self.distance
        x, y, _ = self.camera().basis()
        a, b, c = (float(v) for v in np.array(self.target) + height * (down * y - right * x))
        return replace(self, target=(a, b, c))


@dataclass
class State:
    """The choices, by name where there are names. `light` 0 is the run's own."""

    orbit: Orbit
    methods: Sequence[str]  # the texture among them
    lights: Sequence[str]
    method: str = "texture"
    light: int = 0
    azimuth: float = 0.0  # of the light's turns, about y and then about the x of the world, in degrees
    tilt: float = 0.0
    glossy: bool = False
    has_gloss: bool = True  # else `glossy` stays as it is
    sharpness: int = 0  # steps of the exponent
    split: bool = False
    error: bool = False
    help: bool = False
    mouse: float = 0.5  # its place as a share of the width, from the left
    _first: tuple[Orbit, int] = field(init=False)

    def __post_init__(self) -> None:
        self._first = self.orbit, self.light

    def key(self, name: str) -> None:
        """A key was pressed: a letter or digit, a bracket, LEFT, RIGHT, UP or DOWN. Others do nothing."""
        if name.isdecimal() and 1 <= int(name) <= len(self.methods):
            self.method = self.methods[int(name) - 1]
        elif name == "L":
            self.light = (self.light + 1) % len(self.lights)
        elif name in ("LEFT", "RIGHT"):
            self.turn_light(STEP if name == "RIGHT" else -STEP, 0)
        elif name in ("UP", "DOWN"):
            self.turn_light(0, STEP if name == "DOWN" else -STEP)
        elif name in ("[", "]") and self.glossy:
            self.sharpness = min(max(self.sharpness + (1 if name == "]" else -1), -SHARPEST), SHARPEST)
        elif name == "R":
            (self.orbit, self.light), self.azimuth, self.tilt = self._first, 0.0, 0.0
        for switch, letter in (("glossy", "G"), ("split", "S"), ("error", "E"), ("help", "H")):
            if name == letter and (switch != "glossy" or self.has_gloss):
                setattr(self, switch, not getattr(self, switch))

    def drag(self, button: str, right: float, down: float, height: int) -> None:
        """The mouse moved by some pixels of a frame of `height` with a button held: left, right or middle."""
        if button == "left":
            self.orbit = self.orbit.turned(TURN * right, TURN * down)
        elif button == "right":
            self.turn_light(TURN * right, TURN * down)
        elif button == "middle":
            self.orbit = self.orbit.moved(right / height, down / height)

    def scroll(self, notches: float) -> None:
        """The wheel was turned away from the hand, by so many notches."""
        self.orbit = self.orbit.zoomed(notches)

    def turn_light(self, azimuth: float, tilt: float) -> None:
        """By degrees."""
        self.azimuth = (self.azimuth + azimuth + 180) % 360 - 180
        self.tilt = (self.tilt + tilt + 180) % 360 - 180

    def rotation(self) -> Float64[Array, "3 3"]:
        """Takes directions of the light as it is baked to where it is now."""
        cosine, sine = cos(radians(self.tilt)), sin(radians(self.tilt))
        return np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]]) @ about_y(self.azimuth)

    @property
    def sharper(self) -> float:
        """The factor of all exponents."""
        return 2 ** (self.sharpness / 2)

    def words(self) -> str:
        """What is shown, in a line."""
        light = self.lights[self.light]
        if self.azimuth or self.tilt:
            light += f" turned {self.azimuth:g}" + (f", {self.tilt:g}" if self.tilt else "")
        gloss = "glossy" + (f", exponents x {self.sharper:.3g}" if self.sharpness else "")
        compared = [word for word, on in (("split", self.split), ("8 x error", self.error)) if on]
        return " · ".join([self.method, gloss if self.glossy else "diffuse", light, *compared])
