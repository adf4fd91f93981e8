"""Small worlds that lightmap tests share, with what a lightmap of them takes."""

from dataclasses import dataclass

import numpy as np
import trimesh

from prtnet.data import atlas, builtin, surface, texture
from prtnet.data.part import Part
from prtnet.data.samples import Samples
from prtnet.data.scene import Scene, assemble
from prtnet.data.surface import Surface
from prtnet.data.tracer import Tracer


@dataclass(frozen=True, eq=False)
class Ground:
    scene: Scene
    tracer: Tracer
    points: Samples
    albedo: np.ndarray
    surface: Surface

    @property
    def texels(self):
        """The first arguments of `bounces.indirect`."""
        return self.tracer, self.points, self.albedo, self.surface


def ground(scene, size):
    made = atlas.make(scene, size=size)
    pages = texture.gbuffers(made, size)
    albedo = surface.texel_albedo(made, pages)
    return Ground(scene, Tracer(scene), texture.points(pages), albedo, surface.of_atlas(scene, made, pages))


def closed_box(albedo):
    """Seen from inside."""
    box = trimesh.creation.box((2, 2, 2))
    walls = Part("walls", np.asarray(box.vertices), box.faces[:, ::-1], albedo=np.asarray(albedo), two_sided=False)
    return assemble("box", [walls]).centred()


def cornell():
    return builtin.make("cornell", tessellation=0.25).centred()


def quad(name, corner, right, up, **options):
    """Its front looks along right x up."""
    corner, right, up = (np.asarray(each, np.float64) for each in (corner, right, up))
    vertices = np.array([corner, corner + right, corner + right + up, corner + up])
    return Part(name, vertices, np.array([[0, 1, 2], [0, 2, 3]]), **options)
