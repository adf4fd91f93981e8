"""Diffuse colours and textures out of glTF headers and OBJ material libraries, as linear RGB.

glTF: baseColorFactor is linear, baseColorTexture is sRGB. OBJ: Kd and map_Kd are both taken as sRGB. What a file asks
for and does not come with is logged by name; the factor alone is used then.
"""

import json
import logging
import struct
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32
from numpy.typing import ArrayLike
from PIL import Image, UnidentifiedImageError

from prtnet import PrtnetError
from prtnet.data.part import GREY

log = logging.getLogger(__name__)
Array = np.ndarray
GLB_MAGIC = b"glTF"
# words of MTL files, in lower case
NORMAL_MAPS = ("norm", "map_bump", "bump")


@dataclass(frozen=True, eq=False)
class Finish:
    """What a file says of a material; `two_sided` is None where the format has no word for it."""

    albedo: Float[Array, " 3"] = field(default_factory=lambda: np.full(3, GREY))
    texture: Float32[Array, "h w 3"] | None = None
    two_sided: bool | None = None
    # in tangent space
    normal_map: Float32[Array, "_ _ 3"] | None = None


def to_linear(srgb: ArrayLike) -> Float[Array, "*n"]:
    """sRGB values in [0, 1] to linear ones (IEC 61966-2-1)."""
    srgb = np.asarray(srgb, np.float64)
    return np.where(srgb <= 0.04045, srgb / 12.92, ((np.maximum(srgb, 0) + 0.055) / 1.055) ** 2.4)


def linear_image(image: Image.Image) -> Float32[Array, "h w 3"]:
    """An 8-bit sRGB image as linear RGB; alpha is left out."""
    table = to_linear(np.arange(256) / 255).astype(np.float32)
    # through RGBA: Pillow warns about palettes with transparency otherwise
    return table[np.asarray(image.convert("RGBA"))[..., :3]]


def vectors(image: Image.Image, scale: float = 1.0) -> Float32[Array, "h w 3"]:
    """An 8-bit normal map as vectors of about unit length; `scale` is that of x and y, as glTF has it."""
    coded = np.asarray(image.convert("RGBA"), np.float32)[..., :3] / 255 * 2 - 1
    return coded * np.array([scale, scale, 1], np.float32)


def gltf_header(path: Path) -> dict[str, Any]:
    """The JSON of a .gltf or .glb file. Raises PrtnetError when there is none."""
    try:
        content = path.read_bytes()
        if content[:4] == GLB_MAGIC:
            (length,) = struct.unpack_from("<I", content, 12)
            content = content[20 : 20 + length]
        header = json.loads(content)
    except (struct.error, ValueError) as error:
        raise PrtnetError(
            f"{path}: no glTF header found ({error}), expected glTF 2.0; export the file again"
        ) from error
    if not isinstance(header, dict):
        raise PrtnetError(f"{path}: glTF header: found {type(header).__name__}, expected an object")
    return header


def gltf_finish(material: Any, header: dict[str, Any], path: Path) -> Finish:
    """The finish of a glTF material as trimesh read it, with the factors in full precision from the header."""
    if material is None or not hasattr(material, "baseColorFactor"):
        return Finish(two_sided=False)
    entries = [m for m in header.get("materials", []) if m.get("name") == material.name]
    rough = entries[0].get("pbrMetallicRoughness", {}) if len(entries) == 1 else {}
    factor = rough.get("baseColorFactor")
    if factor is None:
        # extensions such as specular-glossiness end here, in 8 bits
        factor = np.full(4, 1.0) if material.baseColorFactor is None else np.asarray(material.baseColorFactor) / 255
    image = material.baseColorTexture
    if image is None and "baseColorTexture" in rough:
        log.warning("%s: texture %s is missing: the factor alone is used", path, _texture_name(header, rough))
    texture = None if image is None else linear_image(image)
    albedo = np.clip(np.asarray(factor, np.float64)[:3], 0, 1)
    return Finish(albedo, texture, bool(material.doubleSided), _gltf_normal_map(material, entries, path))


def _gltf_normal_map(material: Any, entries: list[dict[str, Any]], path: Path) -> Float32[Array, "h w 3"] | None:
    entry = entries[0].get("normalTexture") if len(entries) == 1 else None
    image = getattr(material, "normalTexture", None)
    if image is None and entry:
        log.warning("%s: material %s: the normal map is missing: it is left out", path, material.name)
    return None if image is None else vectors(image, float((entry or {}).get("scale", 1.0)))


def _texture_name(header: dict[str, Any], rough: dict[str, Any]) -> str:
    try:
        texture = header["textures"][rough["baseColorTexture"]["index"]]
        image = header["images"][texture["source"]]
        return str(image.get("uri", image.get("name", "(embedded)")))[:80]
    except (KeyError, IndexError, TypeError):
        return "(in a format that is not supported)"


def obj_finishes(text: str, path: Path) -> dict[str, Finish]:
    """The materials of every library that an OBJ file names. Missing ones are logged."""
    found: dict[str, Finish] = {}
    for line in text.splitlines():
        if line.startswith("mtllib"):
            library = path.parent / line[len("mtllib") :].strip().replace("\\", "/")
            if library.is_file():
                found |= read_mtl(library)
            else:
                log.warning("%s: material library %s is missing: grey is used", path, library.name)
    return found


def read_mtl(path: Path) -> dict[str, Finish]:
    """Kd and map_Kd of each material of an MTL file."""
    finishes: dict[str, Finish] = {}
    name = ""
    for line in path.read_text(errors="replace").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "newmtl":
            name = line.strip()[len("newmtl") :].strip()
            finishes[name] = Finish()
        elif words[0] == "Kd" and name in finishes:
            finishes[name] = replace(finishes[name], albedo=_kd(words[1:4], path))
        elif words[0] == "map_Kd" and name in finishes:
            finishes[name] = replace(finishes[name], texture=_map(line, path))
        elif words[0].lower() in NORMAL_MAPS and name in finishes:
            finishes[name] = replace(finishes[name], normal_map=_normal_map(line, path))
    return {name: _undo_black(finish, name, path) for name, finish in finishes.items()}


def _normal_map(line: str, path: Path) -> Float32[Array, "h w 3"] | None:
    """The image of a norm, map_Bump or bump line; -bm is its scale. A grey one is a height map, which is not read."""
    words = line.split()
    file = _file(line, path)
    if file is None:
        log.warning("%s: normal map %s is missing: it is left out", path, words[-1])
        return None
    try:
        with Image.open(file) as image:
            coded = np.asarray(image.convert("RGBA"))[..., :3]
            scale = float(words[words.index("-bm") + 1]) if "-bm" in words else 1.0
            found = vectors(image, scale)
    except (UnidentifiedImageError, OSError, ValueError) as error:
        log.warning("%s: normal map cannot be read (%s): it is left out", path, error)
        return None
    if (coded == coded[..., :1]).all():
        log.warning("%s: %s is grey, a height map: only normal maps are read", path, file.name)
        return None
    return found


def _kd(words: list[str], path: Path) -> Float[Array, " 3"]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) not in (1, 3):
        log.warning("%s: Kd %s: expected three numbers: grey is used", path, " ".join(words))
        return np.full(3, GREY)
    return to_linear(np.clip(np.broadcast_to(values, 3), 0, 1))


def _file(line: str, path: Path) -> Path | None:
    """The file of a map line; options may stand before the name, which may hold spaces."""
    rest = line.strip().partition(" ")[2].strip().replace("\\", "/")
    candidates = [path.parent / rest, path.parent / rest.split()[-1] if rest else path, path.parent / Path(rest).name]
    return next((candidate for candidate in candidates if candidate.is_file() and candidate != path), None)


def _map(line: str, path: Path) -> Float32[Array, "h w 3"] | None:
    """The image of a map_Kd line."""
    found = _file(line, path)
    if found is not None:
        return read_image(found)
    log.warning("%s: texture %s is missing: Kd alone is used", path, line.strip().partition(" ")[2].strip())
    return None


def read_image(path: Path) -> Float32[Array, "h w 3"] | None:
    """An image file as linear RGB, or None (logged) when Pillow cannot read it."""
    try:
        with Image.open(path) as image:
            return linear_image(image)
    except (UnidentifiedImageError, OSError) as error:
        log.warning("%s: texture cannot be read (%s): it is left out", path, error)
        return None


def _undo_black(finish: Finish, name: str, path: Path) -> Finish:
    """Some exporters write Kd 0 0 0 beside a texture, which would multiply it away."""
    if finish.texture is None or finish.albedo.any():
        return finish
    log.info("%s: material %s: Kd 0 under a texture is taken as 1", path, name)
    return replace(finish, albedo=np.ones(3))
