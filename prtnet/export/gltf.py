"""Transfer at vertices as GLB: the mesh with its materials, and the coefficients as vertex attributes of their own.

glTF 2.0 (Khronos 2021): attributes that an application defines begin with an underscore, and none is wider than a
vec4, so k coefficients stand in ceil(k / 4) of them, `_PRT_0`, `_PRT_1`, ..., the last one padded with 0; with bounces
transfer per colour follows in `_PRT_R_0`, ..., `_PRT_G_0`, ..., `_PRT_B_0`, ... (docs/gltf-transfer.md).
"""

import io
import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32
from PIL import Image

from prtnet import PrtnetError, sh, store
from prtnet.data.scene import Scene
from prtnet.export.vertices import VertexFile

Array = np.ndarray
Json = dict[str, Any]

FORMAT = 1
EXTRAS_KEY = "prtnet"
CONVENTION = (
    "t_i = integral of V(p, w) max(0, n.w) Y_i(w) dw over steradians, no albedo, no 1/pi; real orthonormal spherical "
    "harmonics on world x, y, z without Condon-Shortley phase, i = l*l + l + m, Y_1 = sqrt(3/4pi) (y, z, x)"
)
GROUPS = {1: ("",), 4: ("", "R_", "G_", "B_")}
# numbers of the standard: component types, buffer targets, chunk types
FLOAT, UNSIGNED_INT = 5126, 5125
VERTICES, INDICES = 34962, 34963
MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942


def attributes(transfer: Float[Array, "v c"], groups: int = 1) -> dict[str, Float32[Array, "v 4"]]:
    """Vertex attributes by name, of one group of coefficients or of four. Inverse: `transfer_of`."""
    grouped = transfer.reshape(len(transfer), groups, -1)
    count = -(-grouped.shape[2] // 4)
    padded = np.zeros((len(transfer), groups, 4 * count), np.float32)
    padded[:, :, : grouped.shape[2]] = grouped
    return {
        f"_PRT_{letter}{index}": np.ascontiguousarray(padded[:, group, 4 * index : 4 * index + 4])
        for group, letter in enumerate(GROUPS[groups])
        for index in range(count)
    }


def transfer_of(found: Mapping[str, Array], bands: int, groups: int = 1) -> Float32[Array, "v c"]:
    """Inverse of `attributes`. Raises KeyError with the name of an attribute that is not there."""
    count = sh.count(bands)
    parts = [
        np.concatenate([found[f"_PRT_{letter}{index}"] for index in range(-(-count // 4))], axis=1)[:, :count]
        for letter in GROUPS[groups]
    ]
    return np.concatenate(parts, axis=1)


def write(path: Path, file: VertexFile, mesh: Scene) -> None:
    """Write transfer_vertices.glb, atomically; `mesh` has the materials and texture coordinates of the same vertices.

    Faces come grouped by part, a primitive each; all share the vertices. Inverse: `read`.
    """
    binary = _Binary()
    content = {"POSITION": file.positions, "NORMAL": file.normals} | attributes(file.transfer, file.groups)
    textured = mesh.uv is not None and any(material.texture is not None for material in mesh.materials)
    if textured and mesh.uv is not None:
        # glTF's v points down
        content["TEXCOORD_0"] = np.stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]], axis=1).astype(np.float32)
    shared = {name: binary.accessor(values, VERTICES, bounds=name == "POSITION") for name, values in content.items()}
    primitives = [
        {
            "attributes": shared,
            "indices": binary.accessor(file.faces[file.part == part].astype(np.uint32).ravel(), INDICES),
            "material": part,
        }
        for part in range(len(file.parts))
        if (file.part == part).any()
    ]
    about = {"format": FORMAT, "bands": file.bands, "groups": file.groups, "kind": file.kind, "convention": CONVENTION}
    header: Json = {
        "asset": {"version": "2.0", "generator": "prtnet"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        # in JSON the centre keeps its digits, as float32 positions could not
        "nodes": [{"mesh": 0, "name": file.name, "translation": file.centre.tolist()}],
        "meshes": [{"name": file.name, "primitives": primitives, "extras": {EXTRAS_KEY: about}}],
        "materials": [],
    }
    for material in mesh.materials:
        image = _image(header, binary, material.texture) if textured and material.texture is not None else None
        header["materials"].append(_material(material.name, material.albedo, image))
    binary.describe(header)
    with store.atomic(path) as temporary:
        temporary.write_bytes(_container(header, binary.data))


def _material(name: str, albedo: Float32[Array, " 3"], texture: int | None) -> Json:
    surface: Json = {"baseColorFactor": [*albedo.tolist(), 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}
    if texture is not None:
        surface["baseColorTexture"] = {"index": texture}
    return {"name": name, "pbrMetallicRoughness": surface}


def _image(header: Json, binary: "_Binary", texture: Float[Array, "h w 3"]) -> int:
    """An sRGB PNG inside the file; the index of its texture."""
    linear = np.clip(np.asarray(texture, np.float64), 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    written = io.BytesIO()
    Image.fromarray(np.rint(255 * encoded).astype(np.uint8)).save(written, format="PNG")
    images, textures = header.setdefault("images", []), header.setdefault("textures", [])
    images.append({"mimeType": "image/png", "bufferView": binary.view(written.getvalue())})
    textures.append({"source": len(images) - 1})
    return len(textures) - 1


class _Binary:
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
        """The index of a new accessor of float32 vectors or uint32 numbers."""
        kind = "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
        view = self.view(np.ascontiguousarray(values).tobytes(), target)
        component = UNSIGNED_INT if values.dtype == np.uint32 else FLOAT
        self.accessors.append({"bufferView": view, "componentType": component, "count": len(values), "type": kind})
        if bounds:
            self.accessors[-1] |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        return len(self.accessors) - 1

    def describe(self, header: Json) -> None:
        header["buffers"] = [{"byteLength": len(self.data)}]
        header["bufferViews"], header["accessors"] = self.views, self.accessors


def _container(header: Json, binary: bytes | bytearray) -> bytes:
    text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), JSON_CHUNK) + text + struct.pack("<II", len(binary), BINARY_CHUNK) + binary
    return struct.pack("<III", MAGIC, 2, 12 + len(chunks)) + chunks


def read(path: Path) -> VertexFile:
    """Inverse of `write`, less texture coordinates and materials: faces come by part.

    Raises PrtnetError, naming the file and what it lacks, for what `write` did not write.
    """
    header, binary = _opened(path)
    try:
        mesh, node = header["meshes"][0], header["nodes"][0]
        about = mesh.get("extras", {}).get(EXTRAS_KEY, {})
        if about.get("format") != FORMAT:
            found = f"found {EXTRAS_KEY} of format {about.get('format')}, expected {FORMAT}"
            raise PrtnetError(f"{path}: {found}; export it again")
        first = mesh["primitives"][0]["attributes"]
        content = {name: _values(header, binary, index) for name, index in first.items()}
        faces = [_values(header, binary, each["indices"]).reshape(-1, 3) for each in mesh["primitives"]]
        parts = [each["material"] for each in mesh["primitives"]]
        return VertexFile(
            positions=content["POSITION"],
            normals=content["NORMAL"],
            faces=np.concatenate(faces).astype(np.int32),
            part=np.repeat(np.array(parts, np.int32), [len(each) for each in faces]),
            transfer=transfer_of(content, about["bands"], about["groups"]),
            centre=np.array(node["translation"], np.float64),
            parts=tuple(material["name"] for material in header["materials"]),
            kind=about["kind"],
            name=node["name"],
        )
    except (KeyError, IndexError) as error:
        raise PrtnetError(f"{path}: found no {error}, expected it in a vertex transfer; export it again") from None


def _opened(path: Path) -> tuple[Json, bytes]:
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


def _values(header: Json, binary: bytes, index: int) -> Array:
    about = header["accessors"][index]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[about["type"]]
    kind = {FLOAT: np.float32, UNSIGNED_INT: np.uint32}[about["componentType"]]
    start = header["bufferViews"][about["bufferView"]]["byteOffset"]
    values = np.frombuffer(binary, kind, about["count"] * width, start)
    return values.copy() if width == 1 else values.reshape(-1, width).copy()
