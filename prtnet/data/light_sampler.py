"""Directions drawn in proportion to a distant light's radiance, with their density: what a Monte Carlo estimate needs.

An image is taken as constant over each texel. A row is drawn by its share of the light, then a texel in it, then a
direction in the texel, uniform in solid angle (Pharr, Jakob and Humphreys 2016, *Physically Based Rendering*, 14.2.4);
the weight of a texel is the mean of its channels times its exact solid angle. A disc is drawn from its cone, uniform
in solid angle, and of a light from one direction there is nothing to draw.
"""

import numpy as np
from jaxtyping import Float, Float64, Int

from prtnet import PrtnetError
from prtnet.data import mapping
from prtnet.data.analytic_light import Beam
from prtnet.data.light import Light, about_y

Array = np.ndarray


class ImageSampler:
    """A lat-long radiance image."""

    # whether all light comes from one direction
    single = False

    def __init__(self, image: Float[Array, "h w 3"]):
        self.image = np.asarray(image, np.float64)
        self.height, self.width = self.image.shape[:2]
        self._mean = self.image.mean(axis=2)
        weights = self._mean * mapping.lat_long_solid_angles(self.height, self.width)[:, None]
        # running sums over all texels, row by row: columns are searched in the same numbers as rows
        self._running = np.cumsum(weights.ravel())
        self._row_ends = self._running[self.width - 1 :: self.width]
        self.total = float(self._running[-1])

    def draw(
        self, numbers: Float[Array, "n 2"]
    ) -> tuple[Float64[Array, "n 3"], Float64[Array, "n 3"], Float64[Array, " n"]]:
        """Unit directions, their radiance and their density per steradian, from numbers in [0, 1)."""
        texel, down, right = self._texels(numbers)
        row, column = np.divmod(texel, self.width)
        edges = np.sin((0.5 - np.arange(self.height + 1) / self.height) * np.pi)
        up = edges[row] + down * (edges[row + 1] - edges[row])
        angle = ((column + right) / self.width - 0.5) * 2 * np.pi
        level = np.sqrt(np.maximum(1 - up * up, 0))
        directions = np.stack([level * np.sin(angle), up, -level * np.cos(angle)], axis=-1)
        return directions, self.image[row, column], self._mean[row, column] / self.total

    def _texels(
        self, numbers: Float[Array, "n 2"]
    ) -> tuple[Int[Array, " n"], Float64[Array, " n"], Float64[Array, " n"]]:
        """Texels by their weights, and where in them: what is left of the numbers, stretched to [0, 1]."""
        wanted = numbers[:, 0] * self.total
        row = np.minimum(np.searchsorted(self._row_ends, wanted, side="right"), self.height - 1)
        start = np.where(row > 0, self._row_ends[row - 1], 0)
        share = np.maximum(self._row_ends[row] - start, np.finfo(float).tiny)
        down = (wanted - start) / share
        wanted = start + numbers[:, 1] * share
        # rounding must not lead out of the row
        texel = np.minimum(np.searchsorted(self._running, wanted, side="right"), row * self.width + self.width - 1)
        before = np.where(texel > 0, self._running[texel - 1], 0)
        right = (wanted - before) / np.maximum(self._running[texel] - before, np.finfo(float).tiny)
        return texel, np.clip(down, 0, 1), np.clip(right, 0, 1)

    def radiance(self, directions: Float[Array, "n 3"]) -> Float64[Array, "n 3"]:
        """Linear radiance from unit directions."""
        return self.image[self._locate(directions)]

    def density(self, directions: Float[Array, "n 3"]) -> Float64[Array, " n"]:
        """Of `draw`, per steradian."""
        return self._mean[self._locate(directions)] / self.total

    def _locate(self, directions: Float[Array, "n 3"]) -> tuple[Int[Array, " n"], Int[Array, " n"]]:
        _, row, column = mapping.locate("lat_long", directions, self.height, self.width)
        nearest = np.clip(np.floor(row + 0.5), 0, self.height - 1), np.floor(column + 0.5) % self.width
        return nearest[0].astype(int), nearest[1].astype(int)


class BeamSampler:
    """A disc of constant radiance, or all light from one direction."""

    def __init__(self, beam: Beam):
        self.beam, self.single = beam, beam.depth == 0
        self.axis = np.asarray(beam.axis, np.float64)
        across = np.eye(3)[np.argmin(np.abs(self.axis))]
        first = np.cross(across, self.axis)
        first /= np.linalg.norm(first)
        self._frame = np.stack([first, np.cross(self.axis, first), self.axis])
        self._solid_angle = 2 * np.pi * beam.depth

    def draw(
        self, numbers: Float[Array, "n 2"]
    ) -> tuple[Float64[Array, "n 3"], Float64[Array, "n 3"], Float64[Array, " n"]]:
        """As `ImageSampler.draw`; of a light from one direction the radiance is its irradiance, of density 1."""
        value = np.broadcast_to(np.asarray(self.beam.colour, np.float64), (len(numbers), 3))
        # 1 - cos without its loss of digits in a small cone
        sunk, angle = numbers[:, 0] * self.beam.depth, 2 * np.pi * numbers[:, 1]
        level = np.sqrt(sunk * (2 - sunk))
        local = np.stack([level * np.cos(angle), level * np.sin(angle), 1 - sunk], axis=-1)
        density = np.full(len(numbers), 1.0 if self.single else 1 / self._solid_angle)
        return local @ self._frame, value, density

    def radiance(self, directions: Float[Array, "n 3"]) -> Float64[Array, "n 3"]:
        """Linear radiance from unit directions; nothing drawn at random meets a single one."""
        return self._inside(directions)[:, None] * np.asarray(self.beam.colour)

    def density(self, directions: Float[Array, "n 3"]) -> Float64[Array, " n"]:
        """Of `draw`, per steradian."""
        return self._inside(directions) / (1.0 if self.single else self._solid_angle)

    def _inside(self, directions: Float[Array, "n 3"]) -> Float64[Array, " n"]:
        # |w - axis|^2 / 2 is 1 - cos, exact where the two are close
        away = np.sum(np.square(np.asarray(directions, np.float64) - self.axis), axis=1) / 2
        return ((away <= self.beam.depth) & (not self.single)).astype(np.float64)


Sampler = ImageSampler | BeamSampler


def of_light(light: Light) -> Sampler:
    """The sampler of a light as it is turned. A window is an affair of SH and does not apply.

    Lights by formula that have an image are taken from it; probes of other mappings from their lat-long image.
    """
    if light.image is not None:
        return ImageSampler(light.image)
    if light.beam is None:
        raise PrtnetError(f"light: {light.name} has neither an image nor a disc, expected one to draw directions from")
    x, y, z = about_y(light.rotation) @ np.asarray(light.beam.axis)
    return BeamSampler(Beam((float(x), float(y), float(z)), light.beam.colour, light.beam.depth))
