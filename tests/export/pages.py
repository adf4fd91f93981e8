"""A small page for the tests of what a browser makes of it."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from prtnet import sh
from prtnet.data import atlas, atlas_set, builtin, light, texture
from prtnet.data.atlas import Atlas
from prtnet.data.texture import Page
from prtnet.export import web
from prtnet.export.web import Cost, Look, PageLight
from prtnet.netspec import NetSpec
from tests.nets import random_grid, random_hash, random_net, random_texels

BANDS, SIDE = 3, 64
LOOK = Look(eye=(0.4, 0.3, 3.2), target=(0.0, 0.0, 0.0), fov=45.0)
EXPOSURES = {"sky": 0.25, "green": 0.5}


@dataclass(frozen=True)
class Small:
    """What a page is made of."""

    net: NetSpec
    atlas: Atlas
    pages: tuple[Page, ...]
    lights: list[PageLight]
    more: dict = field(default_factory=dict)  # of the page's arguments
    net_atlas: Atlas | None = None  # that the net's coordinates are of, where it is another

    def text(self, **changes) -> str:
        """The HTML."""
        values = {"lights": self.lights, "look": LOOK, "texture_cost": Cost(123, 4567)} | self.more | changes
        return web.page(self.net, self.atlas, self.pages, **values)

    def write(self, path: Path, **changes) -> str:
        """The HTML on disk; its address."""
        path.write_text(self.text(**changes), encoding="utf-8")
        return path.as_uri()


def small(groups: int = 1, *, sets: bool = False) -> Small:
    """A box of two lit walls: transfer without shadows in the texture, a net that has learned nothing.

    `sets`: a texture for each part.
    """
    scene = builtin.make("cornell", tessellation=0.25).centred()
    make = atlas_set.make if sets else atlas.make
    made = make(scene, size=SIDE, single_chart=False, unwrap_mode="auto", padding=1)
    pages = [
        texture.page(texels, np.tile(sh.cosine_lobe(texels.normals, BANDS), groups), dilation=1)
        for texels in texture.gbuffers(made, SIDE)
    ]
    features = {"grids": (random_grid(4, 3, 2, channels=8),), "hashes": (random_hash(8),)}
    net = random_net(width=8, depth=1, bands=BANDS, groups=groups, residual=True, output_scale=0.3, **features)
    lights = [
        PageLight(name, light.by_name(name).coefficients(BANDS), exposure) for name, exposure in EXPOSURES.items()
    ]
    return Small(net, made, tuple(pages), lights)


def over_atlas() -> Small:
    """The same box with a net that has features over an atlas, which is not that of the page's texture."""
    made = small()
    scene = builtin.make("cornell", tessellation=0.25).centred()
    other = atlas.make(scene, size=2 * SIDE, padding=4)
    both, net_uv = atlas.joined(made.atlas, other)
    # coarse, since rasterisers place pixels to a 16th only
    texels = (random_texels(8, 6, channels=8), random_texels(3, 5, kind="float32"))
    net = random_net(
        width=8, depth=1, bands=BANDS, position_frequencies=0, texels=texels, residual=True, output_scale=0.3
    )
    return replace(made, net=net, atlas=both, more={"net_uv": net_uv}, net_atlas=other)
