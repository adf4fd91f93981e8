"""What draws a net: its shader, or the CPU, from the G-buffer."""

from prtnet import PrtnetError
from prtnet.export import form
from prtnet.netspec import NetSpec

SHADER, DEFERRED = "shader", "deferred"
CHOICES = ("auto", SHADER, DEFERRED)


def check(wanted: str) -> None:
    """Raises PrtnetError for a word that is none of `render.net`."""
    if wanted not in CHOICES:
        raise PrtnetError(f"render.net: found {wanted!r}, expected one of {', '.join(CHOICES)}")


def chosen(wanted: str, net: NetSpec) -> str:
    """SHADER or DEFERRED, by the configuration's `render.net`.

    auto leaves to the CPU what is too large for literals: a weight texture of that size is slow on software drivers.
    """
    if wanted != "auto":
        return wanted
    few = form.padded_macs_of(form.sizes_of(net), net.groups) <= form.MAX_LITERAL_MACS
    return SHADER if few else DEFERRED
