"""The door to Embree: C calls into the library that the embreex wheel carries.

embreex itself traces one ray at a time. The same library has packet queries, which a compiled kernel can call at their
address. The layouts are those of Embree 4 (embree4/rtcore_*.h); another major version is refused.
"""

import ctypes
from ctypes import POINTER, c_char_p, c_float, c_int, c_size_t, c_ssize_t, c_uint, c_void_p
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from prtnet import PrtnetError

VERSION_MAJOR = 1
NATIVE_WIDTHS = {16: 34, 8: 33, 4: 32}  # RTCDeviceProperty: native support of each packet width
TRIANGLES, INDICES, VERTICES, UINT3, FLOAT3 = 0, 0, 1, 0x5003, 0x9003
ROBUST = 4  # RTCSceneFlags
COHERENT = 1 << 16  # RTCRayQueryFlags
# Packets of neighbouring directions walk the tree together, which pays (5 to 20 %) until triangles are so small that
# the rays of a packet part at once: measured break-even between 70 k and 600 k triangles.
COHERENT_BELOW = 200_000

SIGNATURES: dict[str, tuple[Any, list[Any]]] = {
    "rtcNewDevice": (c_void_p, [c_char_p]),
    "rtcReleaseDevice": (None, [c_void_p]),
    "rtcGetDeviceProperty": (c_ssize_t, [c_void_p, c_int]),
    "rtcGetDeviceError": (c_int, [c_void_p]),
    "rtcNewScene": (c_void_p, [c_void_p]),
    "rtcReleaseScene": (None, [c_void_p]),
    "rtcSetSceneFlags": (None, [c_void_p, c_int]),
    "rtcNewGeometry": (c_void_p, [c_void_p, c_int]),
    "rtcSetNewGeometryBuffer": (c_void_p, [c_void_p, c_int, c_uint, c_int, c_size_t, c_size_t]),
    "rtcCommitGeometry": (None, [c_void_p]),
    "rtcAttachGeometry": (c_uint, [c_void_p, c_void_p]),
    "rtcReleaseGeometry": (None, [c_void_p]),
    "rtcCommitScene": (None, [c_void_p]),
    "rtcOccluded4": (None, [c_void_p] * 4),
    "rtcOccluded8": (None, [c_void_p] * 4),
    "rtcOccluded16": (None, [c_void_p] * 4),
    "rtcIntersect4": (None, [c_void_p] * 4),
    "rtcIntersect8": (None, [c_void_p] * 4),
    "rtcIntersect16": (None, [c_void_p] * 4),
}


class QueryContext(ctypes.Structure):
    """RTCRayQueryContext: no instancing."""

    _fields_ = (("instance", c_uint * 16),)


class QueryArguments(ctypes.Structure):
    """RTCOccludedArguments and RTCIntersectArguments, which have one layout."""

    _fields_ = (
        ("flags", c_int),
        ("feature_mask", c_uint),
        ("context", POINTER(QueryContext)),
        ("filter", c_void_p),
        ("geometry", c_void_p),
    )


class EmbreeUnavailable(PrtnetError):
    """The wheel's library cannot be called directly; the message is the reason."""


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """The Embree that embreex is linked to, with its calls declared. Raises EmbreeUnavailable with the reason."""
    import embreex

    package = Path(embreex.__file__).parent
    folders = (package.parent / "embreex.libs", package / ".dylibs", package)
    found = [file for folder in folders for file in sorted(folder.glob("*embree4*")) if file.is_file()]
    if not found:
        raise EmbreeUnavailable(f"no libembree4 beside {package}: this build of embreex keeps its Embree elsewhere")
    try:
        loaded = ctypes.CDLL(str(found[0]))
        for name, (result, arguments) in SIGNATURES.items():
            call = getattr(loaded, name)
            call.restype, call.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise EmbreeUnavailable(f"{found[0].name} cannot be used: {error}") from error
    return loaded


class PacketScene:
    """Triangles in an Embree scene of our own.

    Robust, as its embreex twin: otherwise one ray in ten that is aimed at an edge slips between its two triangles, and
    which ones do depends on the tree and on the packet width.
    """

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], width: int | None = None):
        self._embree = embree = library()
        self._device = embree.rtcNewDevice(None)
        if not self._device:
            raise EmbreeUnavailable("Embree could not open a device")
        major = embree.rtcGetDeviceProperty(self._device, VERSION_MAJOR)
        if major != 4:
            raise EmbreeUnavailable(f"the wheel's Embree is version {major}, expected 4")
        self.width = width or self._native_width()
        # any hit, and the closest one
        self.function, self.closest = (
            ctypes.cast(getattr(embree, f"{query}{self.width}"), c_void_p).value or 0
            for query in ("rtcOccluded", "rtcIntersect")
        )
        flags = COHERENT if len(faces) < COHERENT_BELOW else 0
        context = QueryContext((c_uint * 16)(*[0xFFFFFFFF] * 16))
        self._arguments = QueryArguments(flags, 0xFFFFFFFF, ctypes.pointer(context), None, None)
        self.options: int = ctypes.addressof(self._arguments)
        self.address: int = self._build(vertices, faces)

    def _native_width(self) -> int:
        """The widest packet that this processor traces natively."""
        native = [w for w, key in NATIVE_WIDTHS.items() if self._embree.rtcGetDeviceProperty(self._device, key)]
        if not native:
            raise EmbreeUnavailable("Embree reports no native ray packets on this processor")
        return max(native)

    def _build(self, vertices: np.ndarray, faces: np.ndarray) -> int:
        embree = self._embree
        geometry = embree.rtcNewGeometry(self._device, TRIANGLES)
        self._fill(geometry, VERTICES, FLOAT3, c_float, vertices)
        self._fill(geometry, INDICES, UINT3, c_uint, faces)
        embree.rtcCommitGeometry(geometry)
        scene = embree.rtcNewScene(self._device)
        embree.rtcSetSceneFlags(scene, ROBUST)
        embree.rtcAttachGeometry(scene, geometry)
        embree.rtcReleaseGeometry(geometry)
        embree.rtcCommitScene(scene)
        if code := embree.rtcGetDeviceError(self._device):
            raise EmbreeUnavailable(f"Embree could not build the scene of {len(faces)} triangles: error {code}")
        return scene

    def _fill(self, geometry: int, slot: int, layout: int, kind: Any, rows: np.ndarray) -> None:
        buffer = self._embree.rtcSetNewGeometryBuffer(geometry, slot, 0, layout, 12, len(rows))
        np.ctypeslib.as_array(ctypes.cast(buffer, POINTER(kind)), (len(rows), 3))[:] = rows

    def close(self) -> None:
        if getattr(self, "address", None):
            self._embree.rtcReleaseScene(self.address)
            self.address = 0
        if getattr(self, "_device", None):
            self._embree.rtcReleaseDevice(self._device)
            self._device = None

    def __del__(self) -> None:
        self.close()
