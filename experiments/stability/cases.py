"""The cases as data: a name, a reason, what varies, and the scene of each value."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from experiments.stability import meshes
from experiments.stability.meshes import Parts

PLANTS = {"scene.name": "plants", "vertex.subdivide": ["ground"], "vertex.level": 6}
TEA_SET = {"scene.name": "tea_set", "vertex.subdivide": ["table", "tray"], "vertex.level": 3}


@dataclass(frozen=True)
class Value:
    """One point of a case: keys of the configuration, a scene of its own or none, how the net's weights are kept."""

    label: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    parts: Parts | None = None
    weights: str = "float32"  # float16, int8


@dataclass(frozen=True)
class Case:
    name: str
    reason: str  # why methods might fail here
    axis: str  # what varies
    values: tuple[Value, ...]
    shown: str | None = None  # the value that stands on the sheet


def _own(label: str, parts: Parts, cut: Sequence[str] = ("floor",), level: int = 5) -> Value:
    """A scene of its own, one-sided, with its planes cut fine enough for vertices to have a chance."""
    settings = {
        "scene.two_sided": "none",
        "scene.camera": "orbit",
        "vertex.subdivide": list(cut),
        "vertex.level": level,
    }
    return Value(label, settings, parts)


def _of_tea_set(label: str, weights: str = "float32", **changes: Any) -> Value:
    return Value(label, TEA_SET | {name.replace("__", "."): value for name, value in changes.items()}, None, weights)


CASES = (
    Case(
        "two_sided",
        "Both sides of a thin leaf lie at the same place and see opposite halves of the light.",
        "charts of a leaf (plants)",
        (
            Value("one for each side", PLANTS),
            Value("one for both sides", PLANTS | {"atlas.single_chart": True}),
        ),
        "one for both sides",
    ),
    Case(
        "hair",
        "Thousands of strips, each a few texels wide, and visibility that changes from strand to strand.",
        "texels along the side of the atlas (hair)",
        # below 487 the charts do not fit, and that is said
        tuple(Value(f"{size}", {"scene.name": "hair", "atlas.size": size}) for size in (512, 1024)),
        "512",
    ),
    Case(
        "contact",
        "Under a box that comes down on a floor the shadow gets as dark and as narrow as the gap.",
        "gap, in widths of the box",
        tuple(_own(f"{gap:g}", meshes.contact(gap)) for gap in (0.3, 0.1, 0.03, 0.01, 0.0)),
        "0",
    ),
    Case(
        "holes",
        "Light that comes through holes in a plate falls as patches of their size.",
        "width of the holes, in widths of the plate",
        tuple(_own(f"{width / 2:g}", meshes.holes(width)) for width in (0.4, 0.2, 0.1, 0.04)),
        "0.05",
    ),
    Case(
        "coplanar",
        "Two faces in one plane: which is seen, which hides which, and from where do rays start?",
        "rug above the floor, in widths of the floor",
        (
            _own("the same face", meshes.coplanar(None)),
            *(
                _own(f"{gap:g}", meshes.coplanar(gap * meshes.EXTENT), ["floor", "rug"])
                for gap in (0.0, 1e-6, 1e-5, 1e-4, 1e-3)
            ),
        ),
        "0.0001",
    ),
    Case(
        "ground",
        "Samples and texels go by area, so a plane takes those of what stands on it.",
        "width of the plane, in widths of the ball",
        tuple(_own(f"{size:g}", meshes.plane(size), level=6) for size in (3, 10, 100, 1000)),
        "100",
    ),
    Case(
        "far",
        "Positions far from the origin have few digits left for the scene itself.",
        "distance from the origin, in sizes of the scene",
        (
            *(_own(f"{sizes:g}", meshes.far(meshes.contact(0.03), sizes)) for sizes in (0, 1e4, 1e6)),
            _own("10000, float32", meshes.far(meshes.contact(0.03), 1e4, rounded=True)),
        ),
    ),
    Case(
        "detail",
        "Grooves of one shape get finer, and nothing else changes: spectral bias.",
        "grooves across the scene",
        # no powers of two: those are the encoding's own periods
        tuple(_own(f"{count}", meshes.grating(2 / count), ["grating"], 3) for count in (5, 9, 19, 37, 67)),
        "67",
    ),
    Case(
        "coefficients",
        "More SH bands are sharper transfer, and more to keep; each is compared with pixels traced in as many bands.",
        "SH coefficients (tea_set)",
        tuple(_of_tea_set(f"{bands**2}", transfer__bands=bands) for bands in (4, 5, 7)),
    ),
    Case(
        "rays",
        "Few rays per point are noise, which texels and vertices show and a net averages.",
        "rays per point (tea_set)",
        tuple(_of_tea_set(f"{rays}", transfer__directions=rays, atlas__size=256) for rays in (8, 32, 256, 1024, 4096)),
        "8",
    ),
    Case(
        "seeds",
        "Points, rays and weights start from a seed; what it changes is the error bar of all the rest.",
        "seed (tea_set)",
        tuple(_of_tea_set(f"{seed}", seed=seed, train__seed=seed) for seed in (0, 1, 2)),
    ),
    Case(
        "quantised",
        "Smaller numbers for the same net and texture: weights in 8 bits have a scale for each row of a matrix.",
        "weights of the net, values of the texture (tea_set)",
        (
            _of_tea_set("float32"),
            _of_tea_set("float16", "float16", atlas__format="float16"),
            _of_tea_set("8 bits", "int8", atlas__format="uint8"),
        ),
    ),
)
