"""Probes from files: every mapping of one light gives the same SH, and what cannot be a light is refused by name."""

import logging

import numpy as np
import pytest

from prtnet import PrtnetError, sh
from prtnet.data import mapping, probe
from tests.data.test_light import write

SHAPES = {"lat_long": (128, 256), "angular": (192, 192), "cube": (64, 64)}
# lobes of their own strength and colour, so that a mirrored or turned mapping cannot hide
AXES = sh.quadrature(4)[0][::3]
COLOURS = np.random.default_rng(0).random((len(AXES), 3))


def radiance(towards):
    return np.exp(4 * (towards @ AXES.T - 1)) @ COLOURS


def expected(bands):
    towards, weights = sh.quadrature(60)
    return sh.project(radiance(towards), towards, weights, bands)


def unfold(faces, *, vertical):
    """A cross, drawn face by face from the picture in the module's text; empty cells are NaN."""
    px, nx, py, ny, pz, nz = faces
    none = np.full_like(px, np.nan)
    if vertical:
        cells = [[none, py, none], [nx, pz, px], [none, ny, none], [none, np.rot90(nz, 2), none]]
    else:
        cells = [[none, py, none, none], [nx, pz, px, nz], [none, ny, none, none]]
    return np.concatenate([np.concatenate(row, axis=1) for row in cells])


def draw(kind):
    return radiance(mapping.directions(kind, *SHAPES[kind]))


def files(folder):
    """The same light in every form that can be read; path by light.mapping."""
    faces = draw("cube")
    six = folder / "six"
    six.mkdir()
    for names, pixels in zip(probe.FACE_NAMES, faces, strict=True):
        write(six / f"{names[0]}.exr", pixels)
    return [
        ("lat_long", write(folder / "round.exr", draw("lat_long")[0])),
        ("angular", write(folder / "ball.exr", draw("angular")[0])),
        ("cross", write(folder / "lying.exr", unfold(faces, vertical=False))),
        ("cross", write(folder / "standing.exr", unfold(faces, vertical=True))),
        ("faces", six),
    ]


def test_each_mapping_of_one_light_gives_the_same_coefficients(tmp_path):
    for kind, path in files(tmp_path):
        for asked in (kind, "auto"):
            found = probe.project(probe.load(path, asked), 5)
            np.testing.assert_allclose(found, expected(5), atol=1.5e-3, err_msg=str(path))
    assert np.abs(expected(5)[1:]).max() > 0.5


def test_the_lat_long_image_of_each_mapping_has_the_same_coefficients(tmp_path):
    for _, path in files(tmp_path):
        image = probe.to_lat_long(probe.load(path))
        found = probe.project(probe.Probe("lat_long", image[None]), 5)
        np.testing.assert_allclose(found, expected(5), atol=6e-3, err_msg=str(path))


def test_a_cross_is_continuous_where_its_cells_touch():
    """Neighbours on paper are neighbours on the sphere, so nothing jumps at the folds."""
    faces = draw("cube")
    for vertical in (False, True):
        image = unfold(faces, vertical=vertical)
        inner = np.nanmax(np.abs(np.diff(faces, axis=1)))
        assert np.nanmax(np.abs(np.diff(image, axis=0))) < 2 * inner
        assert np.nanmax(np.abs(np.diff(image, axis=1))) < 2 * inner
        np.testing.assert_array_equal(probe.cut_cross(image), faces)


@pytest.mark.parametrize("names", [0, 1, 2])
def test_faces_have_several_names(tmp_path, names):
    for kinds, pixels in zip(probe.FACE_NAMES, draw("cube"), strict=True):
        write(tmp_path / f"{kinds[names].upper()}.hdr", pixels)
    (tmp_path / "licence.txt").write_text("free")
    np.testing.assert_allclose(probe.project(probe.load(tmp_path), 4), expected(4), atol=0.02)


def test_bad_radiance_counts_only_where_the_light_is(tmp_path, caplog):
    ball, cross = draw("angular")[0], unfold(draw("cube"), vertical=True)
    ball[0, 0], cross[0, 0] = np.nan, -5
    with caplog.at_level(logging.WARNING):
        probe.load(write(tmp_path / "ball.exr", ball))
        probe.load(write(tmp_path / "cross.exr", cross))
    assert caplog.text == ""
    ball[96, 96], cross[70, 100] = [-2, np.inf, 1], [np.nan, -7, -1]
    with caplog.at_level(logging.WARNING):
        found = probe.load(write(tmp_path / "ball.exr", ball)).radiance
        probe.load(write(tmp_path / "cross.exr", cross))
    assert "ball.exr: set to 0: 1 negative values (lowest -2) and 1 NaN or infinite" in caplog.text
    assert "cross.exr: set to 0: 2 negative values (lowest -7) and 1 NaN or infinite" in caplog.text
    np.testing.assert_array_equal(found[0, 96, 96], [0, 0, 1])
    assert found[0, 0, 0].sum() == 0


@pytest.mark.parametrize("shape", [(8, 16), (8, 8), (6, 8), (8, 6)])
@pytest.mark.parametrize("value", [np.nan, np.inf, -1, 0])
def test_images_without_any_light_are_refused(tmp_path, shape, value):
    path = write(tmp_path / "dark.exr", np.full((*shape, 3), value))
    with pytest.raises(PrtnetError, match=r"dark\.exr holds no light at all"):
        probe.load(path)


@pytest.mark.parametrize(
    ("asked", "shape", "words"),
    [
        ("auto", (5, 8), ["8 x 5 pixels", "no known mapping", "2:1", "1:1", "4:3"]),
        ("auto", (4, 4000), ["4000 x 4 pixels", "no known mapping"]),
        ("lat_long", (8, 8), ["8 x 8 pixels", "2:1", "light.mapping=lat_long"]),
        ("angular", (8, 16), ["16 x 8 pixels", "1:1", "light.mapping=angular"]),
        ("cross", (8, 8), ["8 x 8 pixels", "4:3 or 3:4", "light.mapping=cross"]),
        ("faces", (8, 8), ["is a file", "folder", "light.mapping=faces"]),
        ("mirror_ball", (8, 8), ["light.mapping", "mirror_ball", "angular"]),
    ],
)
def test_shapes_of_no_mapping_are_refused(tmp_path, asked, shape, words):
    path = write(tmp_path / "some.exr", np.ones((*shape, 3)))
    with pytest.raises(PrtnetError) as raised:
        probe.load(path, asked)
    assert all(word in str(raised.value) for word in [*words, "expected"])


@pytest.mark.parametrize("share", [0, 0.01, 0.5, 0.9])
@pytest.mark.parametrize("shape", [(64, 128), (64, 64)])
def test_truncated_and_empty_files_are_refused(tmp_path, share, shape):
    whole = write(tmp_path / "whole.exr", np.random.default_rng(0).random((*shape, 3)))
    torn = tmp_path / "torn.exr"
    torn.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * share)])
    with pytest.raises(PrtnetError, match=r"torn\.exr cannot be read"):
        probe.load(torn)


def test_folders_that_are_no_cube_are_refused(tmp_path):
    with pytest.raises(PrtnetError, match="has no file named px or posx or right; expected one, and six"):
        probe.load(tmp_path)
    for names in probe.FACE_NAMES:
        write(tmp_path / f"{names[0]}.exr", np.ones((4, 4, 3)))
    with pytest.raises(PrtnetError, match=r"is a folder; expected an image, square \(1:1\)"):
        probe.load(tmp_path, "angular")
    write(tmp_path / "top.exr", np.ones((4, 4, 3)))
    with pytest.raises(PrtnetError, match=r"has 2 files \(py\.exr, top\.exr\) named py or posy or top"):
        probe.load(tmp_path)
    (tmp_path / "top.exr").unlink()
    write(tmp_path / "nz.exr", np.ones((8, 8, 3)))
    with pytest.raises(PrtnetError, match=r"nz\.exr is 8 x 8 pixels; expected six square faces of one size, 4 x 4"):
        probe.load(tmp_path)
    write(tmp_path / "nz.exr", np.ones((4, 8, 3)))
    with pytest.raises(PrtnetError, match=r"nz\.exr is 8 x 4 pixels"):
        probe.load(tmp_path)
