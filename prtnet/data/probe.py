"""Light probes in files: lat-long, angular, cube maps as a cross or as six faces; EXR, HDR, linear radiance.

Cube faces are those of OpenGL (`prtnet.data.mapping`). A cross is the cube unfolded, every cell the right way up:

    horizontal 4:3           vertical 3:4; -z hangs below -y, so it is turned by 180 degrees
         +y                       +y
    -x   +z   +x   -z        -x   +z   +x
         -y                       -y
                                  -z
"""

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

from prtnet import PrtnetError, sh
from prtnet.data import mapping

log = logging.getLogger(__name__)
Array = np.ndarray

# light.mapping, with what an image of each must be
EXPECTED = {
    "lat_long": "twice as wide as high (2:1)",
    "angular": "square (1:1)",
    "cross": "4:3 or 3:4, of square cells",
    "faces": "a folder with six square images px nx py ny pz nz",
}
# of each face in the order of the cube map, the names of its file; all mean the same side
FACE_NAMES = (
    ("px", "posx", "right"),
    ("nx", "negx", "left"),
    ("py", "posy", "top"),
    ("ny", "negy", "bottom"),
    ("pz", "posz", "front"),
    ("nz", "negz", "back"),
)
HORIZONTAL = ((1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (1, 3))  # row, column of the cell of each face
VERTICAL = ((1, 2), (1, 0), (0, 1), (2, 1), (1, 1), (3, 1))

# directions of `project` per step: a few MB of basis values at a time
STEP = 1 << 14


@dataclass(frozen=True, eq=False)
class Probe:
    """Radiance as panels "p h w 3" of a mapping of `prtnet.data.mapping`: finite, not negative, not all 0."""

    mapping: str
    radiance: Float[Array, "p h w 3"]


def load(path: str | Path, kind: str = "auto") -> Probe:
    """A light probe from an image, or from a folder of six. `kind`: auto = by the shape, or a key of EXPECTED.

    Grey becomes RGB; alpha goes. Negative, NaN and infinite values become 0, with their count in the log; what lies
    outside an angular map's disc, and in the empty cells of a cross, is not looked at. Raises PrtnetError when a file
    is missing or unreadable, has another shape than `kind` asks for, or holds no light.
    """
    path = Path(path)
    if kind not in ("auto", *EXPECTED):
        raise PrtnetError(f"light.mapping: found {kind!r}, expected one of auto, {', '.join(EXPECTED)}")
    if path.is_dir() and kind in ("auto", "faces"):
        return _made("cube", _faces(path), path)
    if path.is_dir():
        raise PrtnetError(f"light: {path} is a folder; expected an image, {EXPECTED[kind]}, for light.mapping={kind}")
    if kind == "faces" and path.is_file():
        raise PrtnetError(f"light: {path} is a file; expected {EXPECTED[kind]} for light.mapping=faces")
    pixels = read(path)
    kind = _kind(path, pixels, kind)
    if kind == "cross":
        return _made("cube", cut_cross(pixels), path)
    return _made(kind, pixels[None], path)


def read(path: Path) -> Float32[Array, "h w 3"]:
    """The pixels of one image as they are, grey made RGB. Raises PrtnetError when it is missing or unreadable."""
    import OpenImageIO as oiio

    if not path.is_file():
        raise PrtnetError(f"light: {path} is not a file; expected an EXR or HDR image, or a folder of cube faces")
    if path.stat().st_size == 0:
        raise PrtnetError(f"light: {path} cannot be read: the file has 0 bytes; expected an EXR or HDR image")
    image = oiio.ImageBuf(str(path))
    pixels = image.get_pixels(oiio.FLOAT) if image.read() else None
    if pixels is None or not np.size(pixels):
        raise PrtnetError(f"light: {path} cannot be read: {image.geterror().strip() or 'no pixels'}")
    pixels = np.atleast_3d(np.asarray(pixels, np.float32))
    return pixels[..., :3] if pixels.shape[2] >= 3 else np.repeat(pixels[..., :1], 3, axis=2)


def clean(radiance: Float[Array, "*n 3"], name: str) -> Float32[Array, "*n 3"]:
    """Negative, NaN and infinite radiance becomes 0 and is counted in the log."""
    infinite = ~np.isfinite(radiance)
    negative = ~infinite & (radiance < 0)
    if infinite.any() or negative.any():
        lowest = float(radiance.min(where=~infinite, initial=0))
        log.warning(
            "light: %s: set to 0: %d negative values (lowest %.4g) and %d NaN or infinite ones of %d",
            name, int(negative.sum()), lowest, int(infinite.sum()), radiance.size,
        )  # fmt: skip
    cleaned = np.where(infinite | negative, 0, radiance).astype(np.float32)
    if not cleaned.any():
        raise PrtnetError(f"light: {name} holds no light at all: every value is 0, negative, NaN or infinite")
    return cleaned


def project(probe: Probe, bands: int) -> Float32[Array, "k 3"]:
    """SH coefficients per colour, L_i = integral of L Y_i dw: each texel at its centre with its exact solid angle."""
    _, height, width, _ = probe.radiance.shape
    weights = mapping.solid_angles(probe.mapping, height, width).reshape(-1)
    towards = mapping.directions(probe.mapping, height, width).reshape(-1, 3)
    radiance = probe.radiance.reshape(-1, 3)
    total = np.zeros((sh.count(bands), 3))
    for first in range(0, len(weights), STEP):
        part = slice(first, first + STEP)
        total += sh.project(np.asarray(radiance[part], np.float64), towards[part], weights[part], bands)
    return total.astype(np.float32)


def to_lat_long(probe: Probe) -> Float32[Array, "rows columns 3"]:
    """A lat-long image of the probe, for what needs an image: bilinear, so a little softer than the probe itself."""
    return mapping.to_lat_long(probe.mapping, probe.radiance)


def cut_cross(pixels: Float[Array, "h w 3"]) -> Float[Array, "6 s s 3"]:
    """The six faces of a cross, 4:3 or 3:4."""
    height, width = pixels.shape[:2]
    size = height // 3 if width > height else height // 4
    cells = HORIZONTAL if width > height else VERTICAL
    faces = [pixels[row * size : (row + 1) * size, column * size : (column + 1) * size] for row, column in cells]
    if height > width:
        faces[5] = faces[5][::-1, ::-1]
    return np.stack(faces)


def _kind(path: Path, pixels: Float[Array, "h w 3"], kind: str) -> str:
    """What the shape says, or `kind` where the shape agrees."""
    height, width = pixels.shape[:2]
    fitting = {
        "lat_long": width == 2 * height,
        "angular": width == height,
        "cross": (width * 3 == height * 4 and height % 3 == 0) or (width * 4 == height * 3 and width % 3 == 0),
    }
    found = next((name for name, fits in fitting.items() if fits), None)
    if kind == "auto" and found is None:
        known = ", ".join(f"{name}: {EXPECTED[name]}" for name in fitting)
        raise PrtnetError(f"light: {path} is {width} x {height} pixels, of no known mapping; expected {known}")
    if kind != "auto" and not fitting[kind]:
        raise PrtnetError(
            f"light: {path} is {width} x {height} pixels; expected an image {EXPECTED[kind]} for light.mapping={kind}"
        )
    return found if kind == "auto" and found else kind


def _faces(folder: Path) -> Float32[Array, "6 s s 3"]:
    """The images of a folder that are named like faces, in the order of the cube map."""
    files = sorted(file for file in folder.iterdir() if file.is_file())
    chosen = [_face(folder, names, files) for names in FACE_NAMES]
    faces = [read(file) for file in chosen]
    for file, pixels in zip(chosen, faces, strict=True):
        height, width = pixels.shape[:2]
        if width != height or height != len(faces[0]):
            size = len(faces[0])
            raise PrtnetError(
                f"light: {file} is {width} x {height} pixels; expected six square faces of one size, "
                f"{size} x {size} as {chosen[0].name} is high"
            )
    return np.stack(faces)


def _face(folder: Path, names: Iterable[str], files: Iterable[Path]) -> Path:
    found = [file for file in files if file.stem.lower() in names]
    if len(found) != 1:
        stated = f"{len(found)} files ({', '.join(file.name for file in found)})" if found else "no file"
        raise PrtnetError(
            f"light: {folder} has {stated} named {' or '.join(names)}; expected one, and six faces in all"
        )
    return found[0]


def _made(kind: str, panels: Float[Array, "p h w 3"], path: Path) -> Probe:
    _, height, width, _ = panels.shape
    used = mapping.solid_angles(kind, height, width) > 0
    radiance = np.zeros(panels.shape, np.float32)
    radiance[used] = clean(panels[used], str(path))
    return Probe(kind, radiance)
