"""Pack, transfer, shade and unpack on the processor, against the NumPy twins of net and material."""

import numpy as np
import pytest

from prtnet import PrtnetError, netspec, sh
from prtnet.export import cuda, cuda_host
from prtnet.export.cuda_host import HostKernels
from prtnet.render import material as materials
from prtnet.render.material import Material, Reflectance
from tests.cuda.host import compiled, needs_compiler, survives
from tests.nets import random_net, random_points, random_texels, random_uv

PIXELS = 777  # no whole number of blocks
EYE = (0.3, 2.0, -1.5)
GLOSSY = Material(0.7, (0.5, 0.25, 1.0), 20.0, radiance_bands=4)


def image(values: np.ndarray, last: np.ndarray | float = 1.0) -> np.ndarray:
    """(pixels, 4) of three or four channels."""
    filled = np.empty((len(values), 4), np.float32)
    filled[:, 3] = last
    filled[:, : values.shape[1]] = values
    return filled


@pytest.fixture(scope="module")
def pictures():
    """Of random pixels: positions with v where one is covered, normals with exponents, albedo with u, and specular with
    diffuse weight."""
    rng = np.random.default_rng(5)
    positions, normals = random_points(PIXELS)
    covered = rng.uniform(size=PIXELS) < 0.4
    places = random_uv(PIXELS)
    return {
        "positions": image(positions, np.where(covered, np.maximum(places[:, 1], 1e-30), 0)),
        "normals": image(normals, rng.uniform(1, 60, PIXELS).astype(np.float32)),
        "albedo": image(rng.uniform(size=(PIXELS, 3)), places[:, 0]),
        "reflectance": image(rng.uniform(size=(PIXELS, 4))),
    }


def drawn(kernels, pictures, material: Material, light, *, own: bool) -> np.ndarray:
    """The picture, -1 where nothing was drawn."""
    net, count = kernels.net, len(pictures["positions"])
    outputs = len(net.biases[-1])
    points, pixel = np.zeros(1, np.int32), np.full(count, -1, np.int32)
    positions, normals, transfer, uv = (np.full((count, n), np.nan, np.float32) for n in (3, 3, outputs, 2))
    uv = uv if net.texels else None
    radiance, picture = np.full((count, 4), np.nan, np.float32), np.full((count, 4), -1, np.float32)
    packed = {"points": points, "pixel": pixel}
    reflectance = pictures["reflectance"] if own else None
    places, directions = pictures["positions"], pictures["normals"]
    kernels.launch(
        "prt_pack", count, pixels=count, positions=places, normals=directions, albedo=pictures["albedo"],
        packed_positions=positions, packed_normals=normals, packed_uv=uv, **packed,
    )  # fmt: skip
    parameters = cuda.parameters(net)
    kernels.launch(
        "prt_transfer", count, parameters=parameters, positions=positions, normals=normals, uv=uv, points=points,
        transfer=transfer,
    )  # fmt: skip
    kernels.launch(
        "prt_diffuse", count, transfer=transfer, albedo=pictures["albedo"], reflectance=reflectance,
        light=image(light), radiance=radiance, coefficients=len(light), weight=material.diffuse, **packed,
    )  # fmt: skip
    if material.glossy:
        _, bands_out = material.orders(net.bands)
        matrix = materials.fixed_light_matrix(light, net.bands, bands_out).transpose(1, 2, 0).reshape(-1, 3)
        kernels.launch(
            "prt_gloss", count, transfer=transfer, positions=places, normals=directions, reflectance=reflectance,
            matrix=image(matrix), radiance=radiance, eye=EYE, specular=material.specular, exponent=material.exponent,
            **packed,
        )  # fmt: skip
    kernels.launch("prt_unpack", count, radiance=radiance, picture=picture, **packed)
    return picture


def expected(net, pictures, material: Material, light, *, own: bool) -> np.ndarray:
    """The same by `render.material`."""
    covered = pictures["positions"][:, 3] > 0
    positions, normals = (pictures[name][covered, :3].astype(np.float64) for name in ("positions", "normals"))
    uv = np.stack([pictures["albedo"][covered, 3], pictures["positions"][covered, 3]], axis=1)
    weights = pictures["reflectance"][covered].astype(np.float64)
    exponents = pictures["normals"][covered, 3].astype(np.float64)
    seen = materials.radiance(
        material,
        pictures["albedo"][covered, :3].astype(np.float64),
        netspec.evaluate_unit(net, positions, normals, uv=uv),
        light,
        normals,
        np.array(EYE) - positions,
        Reflectance(weights[:, 3], weights[:, :3], exponents) if own else None,
        groups=net.groups,
    )
    picture = np.full((len(covered), 4), -1.0)
    picture[covered, :3], picture[covered, 3] = seen, 1
    return picture


def check(kernels, pictures) -> None:
    """Fails where a picture is not what the material says."""
    light = np.random.default_rng(6).normal(size=(9, 3))
    for material, own in ((Material(0.7), False), (GLOSSY, False), (GLOSSY, True)):
        found = drawn(kernels, pictures, material, light, own=own)
        wanted = expected(kernels.net, pictures, material, light, own=own)
        np.testing.assert_allclose(found, wanted, atol=2e-5 * np.abs(wanted).max(), err_msg=str(material))


@needs_compiler
@pytest.mark.parametrize("fields", [{"groups": 1}, {"groups": 4}, {"texels": (random_texels(9, 6),)}])
def test_pixels_become_the_materials_radiance(fields, pictures, tmp_path):
    net = random_net(bands=3, residual=True, output="linear", **fields)
    check(compiled(net, tmp_path, radiance_bands=4), pictures)


# text that is there once, and what stands there instead
MISTAKES = {
    "no barrier before the place of the block is read": ("found[0]);\n    __syncthreads();", "found[0]);"),
    "no barrier before the block's pixels are counted": ("(found, 1) : 0;\n    __syncthreads();", "(found, 1) : 0;"),
    "what is not covered is packed": ("a.positions[pixel].w > 0.0f", "a.positions[pixel].w >= 0.0f"),
    "coverage for u": ("a.albedo[pixel].w;", "float(covered);"),
    "u for v": ("2 * point + 1] = position.w", "2 * point + 1] = a.packed_uv[2 * point]"),
    "positions for normals": ("a.packed_normals[3 * point] = normal.x", "a.packed_normals[3 * point] = position.x"),
    "the direct group for all colours": ("PRT_GROUPS == 4 ? PRT_COUNT : 0", "0"),
    "no 1 / pi": ("0.318309886f * (a.reflectance", "1.0f * (a.reflectance"),
    "the material's weight for the point's own": ("a.reflectance ? a.reflectance[pixel].w : a.weight", "a.weight"),
    "the material's exponent for the point's own": ("a.reflectance ? normal.w : a.exponent", "a.exponent"),
    "mirrored at the surface": ("size * (x - twice * normal.x)", "size * x"),
    "a step of the lobe's recurrence": ("(exponent - l + 1.0f)", "(exponent - l)"),
    "the matrix of the light transposed": ("a.matrix[i * PRT_RADIANCE + k]", "a.matrix[k * PRT_COUNT + i]"),
    "gloss in the place of the diffuse part": ("radiance.x += own.x * red", "radiance.x = own.x * red"),
    "points put where they were packed": ("a.picture[a.pixel[point]]", "a.picture[point]"),
}


@needs_compiler
def test_planted_mistakes_are_found(pictures, tmp_path):
    texels = (random_texels(5, 6),)
    net = random_net(bands=3, groups=4, width=4, depth=1, residual=True, output="linear", texels=texels)
    source, missed = cuda.source(net, 4), []
    for number, (name, (found, instead)) in enumerate({"none": ("", ""), **MISTAKES}.items()):
        assert name == "none" or source.count(found) == 1, name
        changed = source.replace(found, instead) if found else source
        kernels = HostKernels(net, cuda_host.build(changed, tmp_path / f"{number}.so", "-O0"))
        if survives(lambda kernels=kernels: check(kernels, pictures) is None):
            missed.append(name)
    assert missed == ["none"]


@needs_compiler
def test_a_frame_that_shows_nothing_stays_as_it_was(pictures, tmp_path):
    kernels = compiled(random_net(bands=2, width=4), tmp_path)
    nothing = pictures | {"positions": np.zeros((PIXELS, 4), np.float32)}
    assert (drawn(kernels, nothing, Material(), np.ones((4, 3)), own=False) == -1).all()


@needs_compiler
def test_a_light_of_fewer_coefficients_is_summed_as_far_as_it_goes(pictures, tmp_path):
    net = random_net(bands=3, width=4)
    light = np.random.default_rng(7).normal(size=(sh.count(2), 3))
    found = drawn(compiled(net, tmp_path), pictures, Material(), light, own=False)
    np.testing.assert_allclose(found, expected(net, pictures, Material(), light, own=False), atol=1e-5)


def test_more_bands_of_radiance_than_shared_memory_holds_are_refused():
    with pytest.raises(PrtnetError, match=r"radiance_bands: found 14, expected at most 13"):
        cuda.source(random_net(), 14)
