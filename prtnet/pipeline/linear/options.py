"""What the options of the methods `pca` and `cpca` mean, and whether they fit together."""

from prtnet import PrtnetError, sh
from prtnet.config import Config
from prtnet.models import pca

METHODS = ("pca", "cpca")
STORES = ("texel", "vertex")
BYTES = ("free", "net", "texture")


def clusters_of(config: Config, name: str) -> int:
    """Of a method."""
    return config.linear.clusters if name == "cpca" else 1


def check(config: Config) -> None:
    """Raises PrtnetError, naming the key, where the options of these methods mean nothing, before any work."""
    options = config.linear
    if not set(METHODS) & set(config.methods):
        return
    for name, allowed in (("store", STORES), ("bytes", BYTES)):
        found = getattr(options, name)
        if found not in allowed:
            raise PrtnetError(f"linear.{name}: found {found!r}, expected one of {', '.join(allowed)}")
    groups = 3 if config.transfer.transport == "interreflected" else 1
    pca.check(options.elements, options.clusters, groups * sh.count(config.transfer.bands))
    if options.bytes == "net" and "net" not in config.methods:
        raise PrtnetError("linear.bytes: found net without the method net, expected it in methods, or free or texture")
    if options.size is None:
        return
    if options.size < 16:
        raise PrtnetError(f"linear.size: found {options.size}, expected at least 16, or null for atlas.size")
    for key, found, expected in (("bytes", options.bytes, "free"), ("store", options.store, "texel")):
        if found != expected:
            raise PrtnetError(
                f"linear.size: found {options.size} with linear.{key}={found}, expected linear.{key}={expected}"
            )
