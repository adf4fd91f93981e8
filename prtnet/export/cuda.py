"""A net as CUDA kernels: their source (cuda/transfer.cu, cuda/shading.cu) and the buffer of numbers that they read.

    prt_pack      pixels of a G-buffer that show a surface -> packed points
    prt_transfer  packed points -> SH coefficients of their transfer, by the net
    prt_diffuse, prt_gloss   transfer -> radiance of the points
    prt_unpack    radiance of the points -> pixels

Sizes and choices of the net are macros, so that a compiler knows all loops; its numbers are in one buffer
(`parameters`). Each kernel takes one structure (`ARGUMENTS`) and runs over blocks of as many points as
`points_per_block` says. How many points there are is read from the device's memory, so that a frame runs through
without waiting for the host.
"""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32

from prtnet import PrtnetError, sh
from prtnet.encoding import encoded_size
from prtnet.export.spelling import number, quads
from prtnet.netspec import NetSpec

Array = np.ndarray

SOURCES = Path(__file__).parent / "cuda"
THREADS = 128  # of a block of prt_transfer
PACK_THREADS, SHADE_THREADS = 256, 64
SHARED_BYTES = 48 << 10  # of a block, which every GPU has without being asked
SUMS = 64 * THREADS  # outputs times points of a block: more and the sums of a thread leave its registers
TILES = (64, 32, 16)  # points a block of prt_transfer
PADDING = 4  # floats at the end of each row of its tile

# what each kernel takes, in order: addresses are u8
ARGUMENTS = {
    "prt_pack": ["positions", "normals", "albedo", "points", "pixel", "packed_positions", "packed_normals",
                 "packed_uv", ("pixels", "i4")],
    "prt_transfer": ["parameters", "positions", "normals", "uv", "points", "transfer"],
    "prt_diffuse": ["transfer", "points", "pixel", "albedo", "reflectance", "light", "radiance",
                    ("coefficients", "i4"), ("weight", "f4")],
    "prt_gloss": ["transfer", "points", "pixel", "positions", "normals", "reflectance", "matrix", "radiance",
                  ("eye", "3f4"), ("specular", "3f4"), ("exponent", "f4")],
    "prt_unpack": ["radiance", "points", "pixel", "picture"],
}  # fmt: skip


class Table(NamedTuple):
    """A dense or hashed grid, or an image over the atlas, in the buffer."""

    first: int  # row of the net's inputs
    offset: int  # of the first number, in float32
    values: Array


class Layout(NamedTuple):
    """Where the numbers of a net stand in its buffer, in float32 from its start, each on 16 bytes."""

    weights: tuple[int, ...]
    biases: tuple[int, ...]
    grids: tuple[Table, ...]
    hashes: tuple[Table, ...]
    texels: tuple[Table, ...]
    size: int


def source(net: NetSpec, radiance_bands: int | None = None) -> str:
    """The text of all kernels for a net. `radiance_bands` of prt_gloss are those of the transfer where left out.

    Raises PrtnetError for a net that has no room on a GPU's multiprocessor.
    """
    _check_inputs(net)
    lines = [f"#define PRT_{name} {value}" for name, value in defines(net, radiance_bands).items()]
    texts = [(SOURCES / name).read_text(encoding="utf-8") for name in ("transfer.cu", "shading.cu")]
    return "\n".join([*lines, *texts])


def tile(net: NetSpec) -> int:
    """Points of a block of prt_transfer, as many as its registers and shared memory hold."""
    rows, outputs = _rows(net), 4 * max(quads(len(bias)) for bias in net.biases)
    for points in TILES:
        if points * outputs <= SUMS and 4 * (points + PADDING) * rows <= SHARED_BYTES:
            return points
    most, inputs = SUMS // TILES[-1], SHARED_BYTES // 4 // (TILES[-1] + PADDING)
    raise PrtnetError(
        f"net for CUDA: found layers of up to {outputs} outputs and {rows} rows, expected at most {most} outputs and "
        f"{inputs} inputs; choose a smaller model.width, or fewer bands, grids, hashes or texel channels"
    )


def points_per_block(net: NetSpec, kernel: str) -> int:
    """Points, or pixels for prt_pack, that a block of a kernel sees to."""
    return tile(net) if kernel == "prt_transfer" else threads(kernel)


def threads(kernel: str) -> int:
    """Threads of a block."""
    if kernel == "prt_transfer":
        return THREADS
    return PACK_THREADS if kernel in ("prt_pack", "prt_unpack") else SHADE_THREADS


def arguments(kernel: str, **values: object) -> np.void:
    """The structure that a kernel takes, of addresses and numbers by name.

    Raises KeyError for one that is missing.
    """
    kind = np.dtype([(each, "u8") if isinstance(each, str) else each for each in ARGUMENTS[kernel]], align=True)
    made = np.zeros((), kind)
    for name in kind.names or ():
        made[name] = values.pop(name)
    assert not values, f"{kernel} takes no {', '.join(values)}"
    found = made[()]
    assert isinstance(found, np.void)
    return found


def parameters(net: NetSpec) -> Float32[Array, " n"]:
    """The buffer: weights as (inputs, outputs) with outputs padded by 0 to a multiple of 4, biases padded likewise,
    then grids, tables and images as they are stored, two float16 in the place of a float32."""
    layout = _layout(net)
    buffer = np.zeros(layout.size, np.float32)
    for weight, bias, first, second in zip(net.weights, net.biases, layout.weights, layout.biases, strict=True):
        outputs, inputs = weight.shape
        block = buffer[first : first + 4 * quads(outputs) * inputs].reshape(inputs, -1)
        block[:, :outputs] = weight.T
        buffer[second : second + outputs] = bias
    for table in (*layout.grids, *layout.hashes, *layout.texels):
        words = np.ascontiguousarray(table.values).reshape(-1).view(np.float32)
        buffer[table.offset : table.offset + len(words)] = words
    return buffer


def _check_inputs(net: NetSpec) -> None:
    found = net.weights[0].shape[1]
    known = encoded_size(net.position_frequencies, net.normal_frequencies, net.encoding)
    known += sum(values.shape[-1] for values in _features(net))
    if found != known:
        raise PrtnetError(
            f"net for CUDA: found {found} inputs, expected {known}: encoded position and normal, grids, hashed "
            "grids and texels are all that its kernels know; train a net without other features"
        )


def _features(net: NetSpec) -> list[Array]:
    """In the order of the net's inputs, of which they are the last."""
    return [*net.grids, *(each.table for each in net.hashes), *net.texels]


def _rows(net: NetSpec) -> int:
    return max(net.weights[0].shape[1], *(len(bias) for bias in net.biases))


def _layout(net: NetSpec) -> Layout:
    end, weights, biases = 0, [], []
    for weight in net.weights:
        outputs, inputs = weight.shape
        weights.append(end)
        biases.append(end + 4 * quads(outputs) * inputs)
        end = biases[-1] + 4 * quads(outputs)
    first = net.weights[0].shape[1] - sum(values.shape[-1] for values in _features(net))
    tables = []
    for values in _features(net):
        tables.append(Table(first, end, values))
        first += values.shape[-1]
        end += 4 * quads(values.nbytes // 4)
    dense, hashed = len(net.grids), len(net.grids) + len(net.hashes)
    parts = tuple(tables[:dense]), tuple(tables[dense:hashed]), tuple(tables[hashed:])
    return Layout(tuple(weights), tuple(biases), *parts, end)


def defines(net: NetSpec, radiance_bands: int | None = None) -> dict[str, str]:
    """The macros before the kernels, without their prefix PRT_."""
    waves = net.encoding != "identity"
    radiance = radiance_bands or net.bands
    if 4 * SHADE_THREADS * sh.count(radiance) > SHARED_BYTES:
        most = math.isqrt(SHARED_BYTES // (4 * SHADE_THREADS))
        raise PrtnetError(f"material.radiance_bands: found {radiance}, expected at most {most} on CUDA")
    bands = max(net.bands, radiance)
    numbers = {
        "TILE": tile(net),
        "THREADS": THREADS,
        "PACK_THREADS": PACK_THREADS,
        "SHADE_THREADS": SHADE_THREADS,
        "ROWS": _rows(net),
        "POSITION_FREQUENCIES": net.position_frequencies * waves,
        "NORMAL_FREQUENCIES": net.normal_frequencies * waves,
        "BANDS": net.bands,
        "COUNT": sh.count(net.bands),
        "GROUPS": net.groups,
        "RADIANCE_BANDS": radiance,
        "RADIANCE": sh.count(radiance),
        "TABLE_BANDS": bands,
    }
    made = {name: str(value) for name, value in numbers.items()} | _lists(net)
    made |= {net.activation.upper(): "1", "NEGATIVE_SLOPE": _literal(net.negative_slope)}
    made |= {"OUTPUT_SCALE": _literal(net.output_scale)}
    chosen = {"TRIANGLE": net.encoding == "triangle", "TANH": net.output == "tanh", "RESIDUAL": net.residual}
    made |= {name: "1" for name, on in chosen.items() if on}
    return made | _harmonics(bands) | {"COSINE": _braced(sh.cosine_zonal(net.bands))}


def _lists(net: NetSpec) -> dict[str, str]:
    """The layers, grids, tables and images, each as a macro that names another one's arguments."""
    layout, last = _layout(net), len(net.weights) - 1
    layers = [
        f"LAYER({weight.shape[1]}, {weight.shape[0]}, {_word(i == last)}, {layout.weights[i]}, {layout.biases[i]})"
        for i, weight in enumerate(net.weights)
    ]
    grids = []
    for table in layout.grids:
        z, y, x, channels = table.values.shape
        grids.append(f"GRID({table.first}, {x}, {y}, {z}, {channels}, {_half(table)}, {table.offset})")
    hashes = []
    for table, each in zip(layout.hashes, net.hashes, strict=True):
        entries, channels = each.table.shape
        hashes.append(f"HASH({table.first}, {each.cells}, {entries}, {channels}, {_half(table)}, {table.offset})")
    texels = []
    for table in layout.texels:
        y, x, channels = table.values.shape
        texels.append(f"TEXEL({table.first}, {x}, {y}, {channels}, {_half(table)}, {table.offset})")
    lists = {"LAYERS(LAYER)": layers, "GRIDS(GRID)": grids, "HASHES(HASH)": hashes, "TEXELS(TEXEL)": texels}
    return {name: " ".join(items) for name, items in lists.items()}


def _harmonics(bands: int) -> dict[str, str]:
    """Constants of the recurrences of `sh.evaluate`: (l, m) at l * bands + m."""
    diagonal, ahead, behind = np.zeros(bands), np.zeros((bands, bands)), np.zeros((bands, bands))
    factor = math.sqrt(1 / (4 * math.pi))
    for m in range(bands):
        factor *= math.sqrt((2 * m + 1) / (2 * m)) if m else 1
        diagonal[m] = factor * (math.sqrt(2) if m else 1)
        for l in range(m + 1, bands):
            ahead[l, m] = math.sqrt((4 * l * l - 1) / (l * l - m * m))
            behind[l, m] = ahead[l, m] * math.sqrt(((l - 1) ** 2 - m * m) / (4 * (l - 1) ** 2 - 1))
    tables = {"DIAGONAL": diagonal, "AHEAD": ahead, "BEHIND": behind}
    return {name: _braced(values) for name, values in tables.items()}


def _braced(values: Array) -> str:
    return "{" + ", ".join(_literal(value) for value in values.ravel()) + "}"


def _literal(value: float | np.floating) -> str:
    return f"({number(value)}f)"


def _word(flag: bool) -> str:
    return "true" if flag else "false"


def _half(table: Table) -> str:
    return _word(table.values.dtype == np.float16)
