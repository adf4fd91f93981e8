"""Transfer textures as files for others: EXR with a layer for each band, JSON that says what it is, and the mesh with
its texture coordinates (docs/texture-transfer.md).
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from jaxtyping import Float, Float32, Float64

from prtnet import PrtnetError, sh, store
from prtnet.data import quantise
from prtnet.data.atlas import Atlas
from prtnet.data.scene import Frame
from prtnet.data.texture import Page

Array = np.ndarray

FORMAT = 1
EXR, JSON, MESH = "transfer_texture.exr", "transfer_texture.json", "transfer_texture_mesh.safetensors"
CONVENTION = (
    "V(p, w) max(0, n.w) in real orthonormal spherical harmonics over the world axes x, y, z, without the "
    "Condon-Shortley phase; index l*l + l + m; Y_1 = sqrt(3 / 4 pi) (y, z, x); steradians; no albedo, no 1/pi"
)
# of channels, where there is light between surfaces
GROUPS = ("direct", "red", "green", "blue")
UV_ORIGIN = "lower left: row 0 of the image is v = 1, texel centres lie at half-integers"
KEYS = (
    "format", "name", "bands", "groups", "channels", "convention", "light_independent", "storage", "uv_origin",
    "centre", "scale", "sets", "pages", "dilation", "mipmaps", "coordinates", "mesh",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class TextureFile:
    """What a reader gets back: the first level of each page as a shader decodes it, and the JSON beside it."""

    pages: tuple[Float32[Array, "_ _ c"], ...]
    about: dict[str, Any]

    @property
    def centre(self) -> Float64[Array, " 3"]:
        return np.array(self.about["centre"], np.float64)


def write(
    folder: Path,
    atlas: Atlas,
    pages: tuple[Page, ...],
    frame: Frame,
    *,
    storage: str = "float32",
    dilation: int = 3,
    groups: int = 1,
) -> None:
    """Write the three files of an atlas in unit coordinates, each atomically. `frame` leads back to the scene's file.

    Channels come in one group of coefficients, or in the four that GROUPS names.

    EXR has no bytes: of uint8 it holds the values that they stand for, as float32. Inverse: `read`.
    """
    stored = [quantise.encode(page.levels[:1], page.used, storage) for page in pages]
    images = [quantise.decode(each)[0] for each in stored]
    names = [material.name for material in atlas.scene.materials] if atlas.sides else [None]
    entries = [
        {"part": name, "subimage": place, "size": len(image), "texels": int(page.used.sum())}
        | ({"least": each.offset.tolist(), "span": each.scale.tolist()} if storage == "uint8" else {})
        for place, (name, image, page, each) in enumerate(zip(names, images, pages, stored, strict=True))
    ]
    bands = sh.bands_of(images[0].shape[2] // groups)
    channels = channel_names(bands, groups)
    about = {
        "format": FORMAT,
        "name": atlas.scene.name,
        "bands": bands,
        "groups": list(GROUPS[:groups]),
        "channels": channels,
        "convention": CONVENTION,
        "light_independent": True,
        "storage": storage,
        "uv_origin": UV_ORIGIN,
        "centre": frame.centre.tolist(),
        "scale": frame.scale,
        "sets": "parts" if atlas.sides else "one",
        "pages": entries,
        "dilation": dilation,
        "mipmaps": len(pages[0].levels) > 1,
        "coordinates": atlas.source,
        "mesh": MESH,
    }
    _write_mesh(folder / MESH, atlas, frame)
    write_exr(folder / EXR, images, half=storage == "float16", names=[name or "" for name in names], channels=channels)
    store.write_text(folder / JSON, json.dumps(about, indent=1) + "\n")


def _write_mesh(path: Path, atlas: Atlas, frame: Frame) -> None:
    scene = atlas.scene
    arrays = {
        # float32 keeps the distance to the centre, however far from the origin that is
        "positions": (scene.vertices / frame.scale).astype(np.float32),
        "normals": scene.normals,
        "uv": atlas.uv,
        "faces": scene.faces,
        "page": atlas.page_of_face.astype(np.int32),
    }
    store.save_arrays(path, arrays)


def channel_names(bands: int, groups: int = 1) -> list[str]:
    """`l<band>.<coefficient>`: an EXR layer for each band. Readers sort channels by name, so numbers are padded.

    With four groups the name of each stands before: `direct.l0.00`, ..., `red.l0.00`, ...
    """
    digits, count = max(1, len(str(bands - 1))), sh.count(bands)
    names = [f"l{band:0{digits}}.{i:0{max(2, len(str(count - 1)))}}" for i, band in enumerate(sh.band_index(bands))]
    return names if groups == 1 else [f"{group}.{name}" for group in GROUPS for name in names]


def write_exr(
    path: Path, images: list[Float[Array, "_ _ c"]], *, half: bool = False, names: list[str], channels: list[str]
) -> None:
    """Save pages as the parts of one EXR, 16 or 32 bit floats, ZIP, atomically. Inverse: `read_exr`."""
    specs = []
    for place, (image, name) in enumerate(zip(images, names, strict=True)):
        spec = oiio.ImageSpec(image.shape[1], image.shape[0], len(channels), "half" if half else "float")
        spec.channelnames = channels
        spec.attribute("compression", "zip")
        if len(images) > 1:
            # the parts of an EXR share a display window and need names of their own
            spec.full_width = spec.full_height = max(len(other) for other in images)
            spec.attribute("oiio:subimagename", f"{place:02d} {name}")
        specs.append(spec)
    if not path.parent.is_dir():
        raise PrtnetError(f"{path}: cannot be written, expected the folder {path.parent}")
    with store.atomic(path) as temporary:
        output = oiio.ImageOutput.create("exr")
        if output is None or not output.open(str(temporary), tuple(specs)):
            raise PrtnetError(f"{path}: cannot be written as EXR: {output.geterror() if output else oiio.geterror()}")
        for place, image in enumerate(images):
            begun = place == 0 or output.open(str(temporary), specs[place], "AppendSubimage")
            if not (begun and output.write_image(np.ascontiguousarray(image, np.float32))):
                raise PrtnetError(f"{path}: writing the EXR failed: {output.geterror()}")
        if not output.close():
            raise PrtnetError(f"{path}: writing the EXR failed: {output.geterror()}")


def read_exr(path: Path, channels: list[str]) -> list[Float32[Array, "_ _ c"]]:
    """The named channels of all parts of an EXR, in that order. Inverse of `write_exr`.

    Raises PrtnetError for a file that is missing, empty, cut short, no EXR, or has no finite value in a part.
    """
    if not path.is_file():
        raise PrtnetError(f"{path}: no such file, expected an EXR texture")
    if path.stat().st_size == 0:
        raise PrtnetError(f"{path}: the file has 0 bytes, expected an EXR texture; export it again")
    image = oiio.ImageInput.open(str(path))
    if image is None:
        raise PrtnetError(f"{path}: not a readable EXR texture ({_last(oiio.geterror())}); export it again")
    found = []
    while image.seek_subimage(len(found), 0):
        pixels = image.read_image(len(found), 0, 0, image.spec().nchannels, "float")
        if pixels is None:
            raise PrtnetError(f"{path}: the EXR texture is cut short ({_last(image.geterror())}); export it again")
        kept = list(image.spec().channelnames)
        if sorted(kept) != sorted(channels):
            raise PrtnetError(f"{path}: found channels {kept[0]} to {kept[-1]}, expected those of {JSON}; export again")
        pixels = np.asarray(pixels, np.float32).reshape(image.spec().height, image.spec().width, -1)
        found.append(pixels[..., [kept.index(channel) for channel in channels]])
        if not np.isfinite(found[-1]).any():
            raise PrtnetError(f"{path}: found only NaN and infinite values, expected transfer; export it again")
    image.geterror()  # of looking for one more part
    image.close()
    return found


def _last(message: str) -> str:
    """The last line of a message: OpenEXR's come with their whole history."""
    return message.strip().rpartition("\n")[2]


def read(folder: Path) -> TextureFile:
    """Inverse of `write`, but for the mesh. Raises PrtnetError, naming the file and what it lacks."""
    path = folder / JSON
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise PrtnetError(f"{path}: not a readable JSON file ({error}), expected that of a transfer texture") from None
    found = about.get("format") if isinstance(about, dict) else None
    if found != FORMAT:
        raise PrtnetError(f"{path}: found format {found}, expected {FORMAT}; export it again")
    absent = [key for key in KEYS if key not in about]
    if absent:
        raise PrtnetError(f"{path}: found no {', '.join(absent)}, expected them; export it again")
    images = read_exr(folder / EXR, about["channels"])
    shapes = [image.shape for image in images]
    expected = [(page["size"], page["size"], len(about["channels"])) for page in about["pages"]]
    if shapes != expected:
        raise PrtnetError(f"{folder / EXR}: found images of {shapes}, expected {expected} as in {JSON}; export again")
    return TextureFile(tuple(images), about)
