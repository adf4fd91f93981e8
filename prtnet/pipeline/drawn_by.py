"""What draws a net: its shader, or the CPU, from the G-buffer."""

import logging

from prtnet import PrtnetError, gl
from prtnet.export import bundle, form, limits
from prtnet.export.bundle import Bundle
from prtnet.export.form import Form
from prtnet.netspec import NetSpec

log = logging.getLogger(__name__)
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


def shaders(net: NetSpec, wanted: Form) -> tuple[Bundle, str]:
    """The shaders, and what the least of drivers may refuse of them. Of a browser no more than that is known here, and
    uniform blocks should fit everywhere."""
    if wanted.version.endswith("es") or wanted.storage == "ubo":
        return bundle.bundle(net, wanted), ""
    try:
        return bundle.bundle(net, wanted), ""
    except PrtnetError as error:
        made = bundle.bundle(net, wanted, driver())
        log.warning("export: this driver holds the shaders, others may not: %s", error)
        return made, str(error)


def driver() -> limits.Limits:
    """Of the driver at hand."""
    return limits.of_driver(gl.context().info)
