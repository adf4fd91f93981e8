"""What a web page knows of an implicit scene: its net and its surface as text, the lobe of open points, test points."""

from typing import Any

import numpy as np

from prtnet import PrtnetError
from prtnet.data.implicit.surface import Implicit
from prtnet.export import packing, sphere_tracing, unshadowed
from prtnet.export.packing import Block
from prtnet.export.web_content import net_content, numbers
from prtnet.netspec import NetSpec


def content(net: NetSpec, surface: Implicit, storage: str) -> tuple[dict[str, Any], dict[str, Block]]:
    """What the page knows of net and surface, and the arrays. Parameters as of `prtnet.export.web.surface_page`."""
    if net.groups > 1 or net.texels:
        raise PrtnetError(
            f"web page: found a net of {net.groups} groups with {len(net.texels)} images over an atlas, expected 1 and "
            "none: implicit surfaces have no atlas to keep light or features in"
        )
    about, blocks = net_content(net, storage, [])
    texts = {"surface": sphere_tracing.emit(surface.field), "unshadowed": unshadowed.transfer(net.bands)}
    return about | {
        "pages": [],
        "parts": [{"name": part.name, "albedo": numbers(np.asarray(part.albedo))} for part in surface.materials],
        "steps": [sphere_tracing.STEPS, sphere_tracing.REFINEMENTS],
        "radius": float(np.sqrt(3)) * sphere_tracing.BOX,
    }, blocks | {name: packing.pack_text(text) for name, text in texts.items()}
