"""Transfer without shadows as GLSL: the cosine lobe about the normal, which open points have, and no network.

    void prt_transfer(vec3 position, vec3 normal, out vec4 t0, out vec4 t1, ...)

The function has the name and form of a net's (`prtnet.export.glsl`), so that it stands wherever that does: what is left
of a frame's time is what the net costs. Twin: `sh.cosine_lobe` (Ramamoorthi and Hanrahan 2001, *An Efficient
Representation for Irradiance Environment Maps*).
"""

from prtnet import sh
from prtnet.export.spelling import grouped, quads, zonal_harmonics


def transfer(bands: int) -> str:
    """The text of `prt_transfer`."""
    names = [f"out vec4 t{i}" for i in range(quads(sh.count(bands)))]
    lines = [f"void prt_transfer(vec3 position, vec3 normal, {', '.join(names)}) {{", *_statements(bands)]
    return "\n  ".join(lines) + "\n}\n"


def macs(bands: int) -> int:
    """Multiply-adds of it at one point: a product each."""
    return sum(line.count(" * ") for line in _statements(bands))


def _statements(bands: int) -> list[str]:
    terms: list[str] = []
    lines = list(zonal_harmonics("normal", sh.cosine_zonal(bands), terms))
    return lines + [f"t{i} = {group};" for i, group in enumerate(grouped(terms))]
