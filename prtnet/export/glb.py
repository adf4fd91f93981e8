"""Binary glTF 2.0 (Khronos 2021): the container, its buffer, materials and images, for every file that holds a mesh."""

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32
from PIL import Image

from prtnet import PrtnetError, store

Array = np.ndarray
Json = dict[str, Any]

EXTRAS_KEY = "prtnet"
# numbers of the standard: component types, buffer targets, chunk types, filters and wrapping of samplers
FLOAT, UNSIGNED_INT, UNSIGNED_SHORT = 5126, 5125, 5123
VERTICES, INDICES = 34962, 34963
MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942
LINEAR, CLAMP_TO_EDGE = 9729, 33071
COMPONENTS = {"float32": FLOAT, "uint32": UNSIGNED_INT, "uint16": UNSIGNED_SHORT}


class Binary:
    """The buffer of a GLB, and what describes it."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[Json] = []
        self.accessors: list[Json] = []

    def view(self, content: bytes, target: int | None = None) -> int:
        """The index of a new buffer view, at a multiple of 4 bytes."""
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)})
        if target is not None:
            self.views[-1]["target"] = target
        self.data += content + bytes(-len(content) % 4)
        return len(self.views) - 1

    def accessor(self, values: Array, target: int, *, bounds: bool = False) -> int:
        """The index of a new accessor of float32 vectors, or of uint32 or uint16 numbers."""
        kind = "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
        view = self.view(np.ascontiguousarray(values).tobytes(), target)
        component = COMPONENTS[values.dtype.name]
        self.accessors.append({"bufferView": view, "componentType": component, "count": len(values), "type": kind})
        if bounds:
            self.accessors[-1] |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        return len(self.accessors) - 1

    def image(self, header: Json, content: bytes, name: str = "", sampler: int | None = None) -> int:
        """The index of a new texture of `header`: a PNG inside of the file."""
        images, textures = header.setdefault("images", []), header.setdefault("textures", [])
        named = {"name": name} if name else {}
        images.append(named | {"mimeType": "image/png", "bufferView": self.view(content)})
        textures.append(named | {"source": len(images) - 1} | ({} if sampler is None else {"sampler": sampler}))
        return len(textures) - 1


def write(path: Path, header: Json, binary: Binary) -> None:
    """Write a GLB, atomically. `header` lacks what describes the buffer. Inverse: `opened`."""
    described = {"buffers": [{"byteLength": len(binary.data)}]}
    described |= {"bufferViews": binary.views, "accessors": binary.accessors}
    with store.atomic(path) as temporary:
        temporary.write_bytes(_container(header | described, binary.data))


def _container(header: Json, binary: bytes | bytearray) -> bytes:
    text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), JSON_CHUNK) + text + struct.pack("<II", len(binary), BINARY_CHUNK) + binary
    return struct.pack("<III", MAGIC, 2, 12 + len(chunks)) + chunks


def opened(path: Path) -> tuple[Json, bytes]:
    """Header and buffer of a GLB. Raises PrtnetError, naming the file, for what is none. Inverse: `write`."""
    try:
        content = path.read_bytes()
        magic, version, total, length, kind = struct.unpack_from("<IIIII", content)
        if (magic, version, kind) != (MAGIC, 2, JSON_CHUNK) or total != len(content):
            raise ValueError(f"{len(content)} bytes that begin with {content[:4]!r}")
        return json.loads(content[20 : 20 + length]), content[28 + length :]
    except FileNotFoundError:
        raise PrtnetError(f"{path}: no such file") from None
    except (OSError, ValueError, struct.error) as error:
        raise PrtnetError(f"{path}: not a whole GLB file ({error}); export it again") from None


def values(header: Json, binary: bytes, index: int) -> Array:
    """What an accessor of `Binary` reads."""
    about = header["accessors"][index]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[about["type"]]
    kind = {number: name for name, number in COMPONENTS.items()}[about["componentType"]]
    start = header["bufferViews"][about["bufferView"]]["byteOffset"]
    found = np.frombuffer(binary, kind, about["count"] * width, start)
    return found.copy() if width == 1 else found.reshape(-1, width).copy()


def material(name: str, albedo: Float32[Array, " 3"], texture: int | None) -> Json:
    """A rough surface without metalness: linear base colour, and the index of its sRGB texture."""
    surface: Json = {"baseColorFactor": [*albedo.tolist(), 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}
    if texture is not None:
        surface["baseColorTexture"] = {"index": texture}
    return {"name": name, "pbrMetallicRoughness": surface}


def coordinates(uv: Float[Array, "v 2"]) -> Float32[Array, "v 2"]:
    """Texture coordinates with v up as glTF has them: v points down. Its own inverse."""
    return np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1).astype(np.float32)


def srgb_png(linear: Float[Array, "h w 3"]) -> bytes:
    """An 8-bit PNG of linear RGB in [0, 1], sRGB-encoded (IEC 61966-2-1); row 0 on top."""
    clipped = np.clip(np.asarray(linear, np.float64), 0, 1)
    return png(np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * np.maximum(clipped, 1e-9) ** (1 / 2.4) - 0.055))


def png(encoded: Float[Array, "h w *c"]) -> bytes:
    """An 8-bit PNG of values in [0, 1] as they are, grey or RGB."""
    written = io.BytesIO()
    Image.fromarray(np.rint(255 * np.clip(encoded, 0, 1)).astype(np.uint8)).save(written, format="PNG")
    return written.getvalue()
