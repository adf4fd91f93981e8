"""What a user writes down is the surface that it says, and what is wrong is named with its place."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from prtnet import PrtnetError
from prtnet.data.implicit import file
from prtnet.data.implicit.arguments import JOINS, OPERATORS, SHAPES
from prtnet.data.implicit.check import check
from prtnet.data.implicit.operators import difference, moved, turned, union
from prtnet.data.implicit.shapes import box, capsule, chain, sphere
from tests.data.implicit.bounds import distances, points

ROOT = Path(__file__).resolve().parents[3]
PAGE, README = ((ROOT / name).read_text(encoding="utf-8") for name in ("docs/implicit.md", "README.md"))
YAML = """
name: bowl
bounds: [[-1.2, -0.6, -1.2], [1.2, 1, 1.2]]
smooth: 0.05
parts:
  bowl:
    albedo: [0.7, 0.2, 0.1]
    difference: {of: [{sphere: 0.5}, {box: {x: 0.6, y: 0.2, z: 0.6}, moved: [0, 0.3, 0]}], smooth: 0.03}
    turned: [x, 20]
  handle:
    union:
      - capsule: {start: [0, 0, 0], end: [0.9, 0.1, 0], radius: 0.1}
      - chain: [[[0, 0, 0], [0, 0.5, 0], [0.1, 0.9, 0]], [0.1, 0.2, 0.1]]
"""
PYTHON = """
import math

def bowl(size):
    return difference(sphere(size), moved(box(0.6, 0.2, 0.6), 0, 0.3, 0), smooth=0.03)

handle = union(
    capsule((0, 0, 0), (0.9, 0.1, 0), 0.1),
    chain([(0, 0, 0), (0, 0.5, 0), (0.1, 0.9, 0)], [0.1, 0.2, 0.1]),
)
parts = {"bowl": (turned(bowl(math.cos(math.pi / 3)), "x", 20), (0.7, 0.2, 0.1)), "handle": handle}
bounds = (-1.2, -0.6, -1.2), (1.2, 1, 1.2)
smooth = 0.05
name = "bowl"
"""
BOWL = turned(difference(sphere(0.5), moved(box(0.6, 0.2, 0.6), 0, 0.3, 0), smooth=0.03), "x", 20)
HANDLE = union(capsule((0, 0, 0), (0.9, 0.1, 0), 0.1), chain([(0, 0, 0), (0, 0.5, 0), (0.1, 0.9, 0)], [0.1, 0.2, 0.1]))


def written(folder, text, suffix):
    path = folder / f"mine{suffix}"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(("text", "suffix"), [(YAML, ".yaml"), (PYTHON, ".py")])
def test_both_kinds_say_the_same_surface(tmp_path, text, suffix):
    made = file.read(written(tmp_path, text, suffix))
    assert (made.name, made.low, made.high, made.camera) == ("bowl", (-1.2, -0.6, -1.2), (1.2, 1.0, 1.2), "orbit")
    expected = distances(union(BOWL, HANDLE, smooth=0.05), points())
    np.testing.assert_allclose(made.field.distance(points()), expected, atol=1e-12)
    assert [material.name for material in made.materials] == ["bowl", "handle"]
    np.testing.assert_allclose(made.materials[0].albedo, [0.7, 0.2, 0.1], rtol=1e-6)
    np.testing.assert_array_equal(made.materials[1].albedo, np.float32(0.8))


def test_a_distance_is_a_surface_of_its_own(tmp_path):
    made = file.read(written(tmp_path, "def distance(x, y, z):\n    return sqrt(x * x + y * y + z * z) - 0.5\n", ".py"))
    np.testing.assert_allclose(made.field.distance(points()), np.linalg.norm(points(), axis=1) - 0.5, atol=1e-12)
    assert (made.name, made.low, made.high) == ("mine", (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0))


def test_aliases_give_a_surface_beside_its_parts(tmp_path):
    parts = "parts:\n  a: &a {sphere: 0.5}\n  b: &b {sphere: 0.4, moved: [0.3, 0, 0]}\n"
    made = file.read(written(tmp_path, parts + "joined: {union: {of: [*a, *b], smooth: 0.2}}", ".yaml"))
    expected = union(sphere(0.5), moved(sphere(0.4), 0.3, 0, 0), smooth=0.2)
    np.testing.assert_allclose(made.field.distance(points()), distances(expected, points()), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("surface = sphere(0.5\n", "mine.py:1: "),
        ("a = 1\nsurface = sphere(a, b=2)\n", "mine.py:2: TypeError"),
        ("surface = spere(0.5)\n", "mine.py:1: NameError: name 'spere'"),
        ("surface = sphere(-1)\n", "mine.py:1: sphere: radius: found -1"),
        ("def distance(x, y, z):\n    return x / undefined\n", "mine.py:2: NameError"),
        ("import math\n\ndef distance(x, y, z):\n    return math.sqrt(x)\n", "mine.py:4: TypeError.*not math's"),
        ("def distance(x, y, z):\n    if x < 0:\n        return y\n    return z\n", "mine.py:2: TypeError.*select"),
        ("def distance(x, y, z):\n    return None\n", "surface: the distance is None"),
        ("shape = sphere(1)\n", "found no parts, expected parts = "),
        ("parts = {'a': 5}\n", "parts: a: found 5, expected a shape"),
        ("parts = {'a': (sphere(1), (1, 2, 3))}\n", "parts: a: albedo: found .1, 2, 3."),
        ("surface = sphere(1)\nbounds = (0, 0, 0), (1, -1, 1)\n", "bounds: found .*lower corner first"),
        ("surface = sphere(1)\nbounds = 3\n", "bounds: found 3"),
        ("surface = sphere(1)\nlipschitz = 0\n", "lipschitz: found 0"),
        ("surface = sphere(1)\nsmooth = 'much'\n", "smooth: found 'much'"),
        ("surface = sphere(1)\ncamera = 'above'\n", "camera: found 'above'"),
        ("surface = sphere(1)\njoined = 3\n", "joined: found 3"),
        ("raise SystemExit(3)\n", "mine.py:1: SystemExit"),
    ],
)
def test_errors_in_python_have_their_line(tmp_path, text, words):
    with pytest.raises(PrtnetError, match=words):
        file.read(written(tmp_path, text, ".py"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("parts: {a: {spere: 1}}", "parts.a: found 'spere', expected one of sphere, ellipsoid"),
        ("parts: {a: {sphere: -1}}", "parts.a.sphere: sphere: radius: found -1"),
        ("parts: {a: {sphere: big}}", "parts.a.sphere: radius: found 'big', expected sphere.radius."),
        ("parts: {a: {sphere: .nan}}", "parts.a.sphere: radius: found nan"),
        ("parts: {a: {box: [1, 1]}}", "parts.a.box: .*missing.*'z'; expected box.x, y, z, round = 0.0"),
        ("parts: {a: {box: {x: 1, y: 1, z: 1, w: 1}}}", "parts.a.box: .*'w'"),
        ("parts: {a: {torus: [1, 2, 3]}}", "parts.a.torus: .*too many"),
        ("parts: {a: {capsule: [[0, 0], [1, 0, 0], 1]}}", "start: found .0, 0., expected capsule.start: .x, y, z."),
        ("parts: {a: {sphere: 1, moved: [1, 2]}}", "parts.a.moved: .*missing.*'z'; expected moved.x, y, z"),
        ("parts: {a: {sphere: 1, lifted: 2}}", "parts.a: found 'lifted' after sphere, expected one of moved"),
        ("parts: {a: {sphere: 1, box: [1, 1, 1]}}", "parts.a: found 'box' after sphere.*union"),
        ("parts: {a: {moved: [0, 0, 0], sphere: 1}}", "parts.a: found 'moved'.*comes after the shape"),
        ("parts: {a: {union: [{sphere: 1}, {boxx: 1}]}}", r"parts.a.union\[1\]: found 'boxx'"),
        ("parts: {a: {union: {sphere: 1}}}", "parts.a.union: found .*, expected a list of shapes"),
        ("parts: {a: {union: {of: [{sphere: 1}], smoth: 1}}}", "parts.a.union: .*'smoth'"),
        ("parts: {a: {albedo: [1, 1, 1]}}", "parts.a: found {}, expected a shape"),
        ("parts: {a: {sphere: 1, albedo: red}}", "parts: a: albedo: found 'red'"),
        ("parts: {a: 3}", "parts.a: found 3"),
        ("parts: []", "parts: found ..,"),
        ("parts:\n  a: {sphere: 1, moved: [0, 0, 0], moved: [1, 0, 0]}", "line 2: found moved twice"),
        ("parts: {a: &a {union: [*a]}}", "contains itself"),
        ("part: {a: {sphere: 1}}", "found the key 'part', expected name, bounds"),
        ("[1, 2]", "found list, expected the keys"),
        ("a: [1\nb: 2", "mine.yaml:2: .*expected YAML"),
        ("", "found NoneType"),
    ],
)
def test_errors_in_yaml_have_their_place(tmp_path, text, words):
    with pytest.raises(PrtnetError, match=words):
        file.read(written(tmp_path, text, ".yaml"))


def test_files_that_are_none(tmp_path):
    with pytest.raises(PrtnetError, match="could not be read"):
        file.read(tmp_path / "absent.yaml")
    with pytest.raises(PrtnetError, match=r"suffix '\.toml'"):
        file.read(tmp_path / "surface.toml")
    (tmp_path / "bytes.py").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PrtnetError, match="could not be read"):
        file.read(tmp_path / "bytes.py")


@pytest.mark.parametrize(("language", "suffix"), [("yaml", ".yaml"), ("python", ".py")])
def test_examples_of_the_documentation_are_surfaces(tmp_path, language, suffix):
    pages = PAGE + README if language == "yaml" else PAGE
    for text in re.findall(rf"```{language}\n(.*?)```", pages, re.DOTALL):
        check(file.read(written(tmp_path, text, suffix)))


def test_the_documentation_names_every_shape_and_operator():
    for name, function in (SHAPES | JOINS | OPERATORS).items():
        usage = re.search(rf"^\| `{name}\((.*?)\)` \|", PAGE, re.MULTILINE)
        assert usage, name
        if name not in JOINS:
            assert re.findall(r"(\w+)(?:=[^,]*(?:, [\d, ]+\))?)?(?:, |$)", usage[1]) == list(
                inspect.signature(function).parameters
            ), name
