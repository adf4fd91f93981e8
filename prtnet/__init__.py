"""prtnet: precomputed radiance transfer in vertices, textures and small networks.

Heavy modules are imported where they are used, so that `import prtnet` and `prtnet --help` stay quick.
"""

__version__ = "0.1.0"


class PrtnetError(Exception):
    """Base of every error a user can cause. The message says what was found, what was expected, what to do."""
