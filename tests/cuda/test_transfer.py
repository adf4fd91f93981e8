"""The transfer kernel, compiled for the processor, against the NumPy evaluator; and mistakes put into it on purpose."""

import numpy as np
import pytest

from prtnet import PrtnetError, netspec
from prtnet.export import cuda, cuda_host
from tests.cuda.host import TOLERANCE, compiled, needs_compiler, survives, worst
from tests.nets import random_grid, random_hash, random_net, random_points, random_texels, random_uv

DEFAULT = {
    "activation": "hard_gelu",
    "output": "linear",
    "position_frequencies": 6,
    "grids": (random_grid(16, 8, 16),),
    "hashes": tuple(random_hash(cells, 1024) for cells in (32, 64, 128)),
}
NETS = {
    "recipe default, 32": {"width": 32, "depth": 2, **DEFAULT},
    "recipe default, 64": {"width": 64, "depth": 4, **DEFAULT},
    "recipe published, 128": {"width": 128, "depth": 2, "position_frequencies": 10, "normal_frequencies": 4},
    "512": {"width": 512, "depth": 2, "activation": "relu", "output": "linear"},
    "odd widths, gelu": {"width": 13, "depth": 3, "activation": "gelu", "residual": True, "output": "linear"},
    "silu, one band": {"width": 5, "activation": "silu", "bands": 1, "residual": True, "output_scale": 1.0},
    "sine, triangle waves": {"width": 30, "activation": "sine", "encoding": "triangle", "bands": 7},
    "no encoding, groups": {"encoding": "identity", "groups": 4, "bands": 3, "residual": True, "negative_slope": 0.2},
    "one layer": {"depth": 0, "output": "linear", "residual": True, "bands": 4},
    "grids of all sorts": {
        "width": 16,
        "grids": (random_grid(7, 4, 3, 12, "float32"), random_grid(1, 1, 1, 4), random_grid(2, 5, 8)),
        "hashes": (random_hash(7, 256, 8, "float32"), random_hash(1024, 512)),
    },
    "texels of all sorts": {
        "width": 16,
        "hashes": (random_hash(7),),
        "texels": (random_texels(30, 20, 8), random_texels(7, 5, 4, "float32"), random_texels(1, 2)),
    },
}


@needs_compiler
@pytest.mark.parametrize("name", NETS)
def test_the_kernel_computes_what_numpy_computes(name, tmp_path):
    net = random_net(**NETS[name])
    kernels, tile = compiled(net, tmp_path), cuda.tile(net)
    for count in (0, 1, tile - 1, tile, tile + 1, 5 * tile + 3):
        assert worst(kernels, count) <= TOLERANCE, count
    # blocks beyond the last point have nothing to do
    assert worst(kernels, tile + 1, launched=5 * tile) <= TOLERANCE


@needs_compiler
def test_sine_of_large_arguments_keeps_its_digits(tmp_path):
    """Arguments of hundreds of turns, as SIREN's first layer has; beside NumPy in float32, not in float64."""
    net = random_net(width=8, depth=1, activation="sine", encoding="identity", output="linear")
    weights = (300 * net.weights[0], net.weights[1])
    net = type(net)(**{**vars(net), "weights": weights})
    assert worst(compiled(net, tmp_path), 500) <= 5e-4


@needs_compiler
def test_small_and_negative_float16_are_read_as_they_are(tmp_path):
    """Denormals, the largest number and negative zero, through a net that hands a grid's channels on."""
    values = np.array([6e-8, -5.96e-8, 65504.0, -0.0], np.float16)
    bare = random_net(
        depth=0, encoding="identity", output="linear", output_scale=1.0, bands=2, grids=(values.reshape(1, 1, 1, 4),)
    )
    weight = np.zeros_like(bare.weights[0])
    weight[:, -4:] = np.eye(4)
    net = type(bare)(**{**vars(bare), "weights": (weight,), "biases": (np.zeros(4, np.float32),)})
    found = compiled(net, tmp_path).transfer(*random_points(3))
    np.testing.assert_array_equal(found, np.tile(values.astype(np.float32), (3, 1)))


# text that is there once, and what a tired programmer might have written
MISTAKES = {
    "no barrier before the layer is written": ("    __syncthreads();  // all have read before any writes\n", ""),
    "no barrier after the layer is written": ("o][q]);\n        }\n    __syncthreads();", "o][q]);\n        }"),
    "no barrier after the encoding": ("tile + q);\n    }\n    __syncthreads();", "tile + q);\n    }"),
    "a barrier that half of the threads reach": (
        "    PRT_TEXELS(PRT_TEXEL)\n    __syncthreads();",
        "    PRT_TEXELS(PRT_TEXEL)\n    if (threadIdx.x < 64) __syncthreads();",
    ),
    "too small a tile": ("PRT_ROWS * PRT_PITCH);", "PRT_ROWS * PRT_PITCH - PRT_PITCH);"),
    "one point too many is written": ("if (first + q < points) a.transfer", "if (first + q <= points) a.transfer"),
    "the last point is left out": ("if (first >= points) return;", "if (first >= points - 1) return;"),
    "sine for cosine": ("(row + 3) * PRT_PITCH] = cosine", "(row + 3) * PRT_PITCH] = sine"),
    "octaves start too low": ("octave = 0.5f", "octave = 0.25f"),
    "normals for positions": ("is_normal ? a.normals : a.positions", "is_normal ? a.positions : a.normals"),
    "grids a cell aside": ("(SIZE % 2) / 2.0f - 0.5f", "(SIZE % 2) / 2.0f"),
    "grids not clamped": ("fminf(fmaxf(at, -float(middle)), float(SIZE - 1 - middle))", "at"),
    "x and y of a grid exchanged": ("(unsigned(z[k]) * Y + y[j]) * X + x[i]", "(unsigned(z[k]) * X + x[i]) * Y + y[j]"),
    "texels a texel aside": ("coordinate, -whole) - 0.5f", "coordinate, -whole)"),
    "texels not clamped": ("coordinate = fminf(fmaxf(coordinate, 0.0f), 1.0f);\n", ""),
    "texels upside down": ("unsigned(Y - 1 - y[j])", "unsigned(y[j])"),
    "v for u": ("place_texel<X>(uv[2 * point]", "place_texel<X>(uv[2 * point + 1]"),
    "places in the atlas of the first tile alone": ("? first + q : first;", "? q : first;"),
    "texels in the rows of other inputs": ("store(tile + q, ROW + 4 * quad, sum)", "store(tile + q, 4 * quad, sum)"),
    "another prime": ("2654435761u", "2654435763u"),
    "corners of cells towards zero": ("floorf(at_x)", "truncf(at_x)"),
    "denormal float16 scaled wrongly": ("5.192296858534828e33f", "2.596148429267414e33f"),
    "the activation left out": ("x * fminf(fmaxf(0.5f + 0.5f * x, 0.0f), 1.0f)", "x"),
    "output not scaled": ("return PRT_OUTPUT_SCALE * x;", "return x;"),
    "the lobe of the first group alone": ("group < PRT_GROUPS; ++group)\n", "group < 1; ++group)\n"),
    "a sign of the recurrence": ("- prt_behind[at] * before", "+ prt_behind[at] * before"),
}  # fmt: skip


@needs_compiler
def test_planted_mistakes_are_found(tmp_path):
    features = {**DEFAULT, "grids": (random_grid(5, 4, 3),), "texels": (random_texels(5, 4, 8),)}
    net = random_net(width=16, depth=2, groups=4, bands=3, residual=True, **features)
    source, missed = cuda.source(net), []
    for number, (name, (found, instead)) in enumerate({"none": ("", ""), **MISTAKES}.items()):
        assert name == "none" or source.count(found) == 1, name
        library = cuda_host.build(source.replace(found, instead) if found else source, tmp_path / f"{number}.so", "-O0")
        if _passes(cuda_host.HostKernels(net, library), cuda.tile(net)):
            missed.append(name)
    assert missed == ["none"]


def _passes(kernels: cuda_host.HostKernels, tile: int) -> bool:
    """Whether the kernel is right at a few points, leaves what stands behind its output, and keeps CUDA's rules."""
    count, net = 2 * tile + 1, kernels.net
    positions, normals = random_points(count)
    # beyond the atlas, too, as pixels at the edge of a triangle may be
    uv = 2 * random_uv(count) - np.float32(0.5)
    expected = netspec.evaluate_unit(net, positions, normals, uv=uv)
    out = np.full((count + 1, len(net.biases[-1])), 7, np.float32)
    given = {"parameters": cuda.parameters(net), "positions": positions, "normals": normals, "uv": uv, "transfer": out}
    given["points"] = np.array([count], np.int32)

    def right() -> bool:
        kernels.launch("prt_transfer", count, **given)
        return bool(np.abs(out[:-1] - expected).max() <= TOLERANCE and (out[-1] == 7).all())

    return survives(right)


def test_a_net_too_wide_is_refused():
    with pytest.raises(PrtnetError, match=r"layers of up to 516 outputs.*at most 512 outputs.*model\.width"):
        cuda.source(random_net(width=513, depth=1))


@needs_compiler
def test_texels_of_a_large_image_are_as_exact(tmp_path):
    net = random_net(width=16, texels=(random_texels(300, 1000),))
    assert worst(compiled(net, tmp_path), 2000) <= TOLERANCE


@needs_compiler
def test_texels_without_their_places_are_refused(tmp_path):
    net = random_net(width=4, texels=(random_texels(3, 3),))
    with pytest.raises(PrtnetError, match="found no uv"):
        compiled(net, tmp_path).transfer(*random_points(3))


def test_a_net_with_inputs_that_the_kernels_do_not_know_is_refused():
    net = random_net(width=4, position_frequencies=3)
    object.__setattr__(net, "position_frequencies", 2)
    with pytest.raises(PrtnetError, match="found 36 inputs, expected 30: encoded position and normal, grids"):
        cuda.source(net)


def test_without_a_compiler_the_error_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(PrtnetError, match=r"no g\+\+ or clang\+\+.*apt-get install"):
        cuda_host.build("", tmp_path / "kernels.so")


@needs_compiler
def test_text_that_does_not_compile_is_refused_with_the_compilers_words(tmp_path):
    source = cuda.source(random_net(width=4)).replace("sincospif(", "sinecosine(")
    with pytest.raises(PrtnetError, match="sinecosine"):
        cuda_host.build(source, tmp_path / "kernels.so")
