"""The scene of a job: triangles, and the surface that they follow where it is an implicit one."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from prtnet import PrtnetError
from prtnet.config import METHODS, Config, SceneOptions
from prtnet.data import builtin, normal_map, scene
from prtnet.data.implicit import builtin as shapes
from prtnet.data.implicit import check, file, mesh
from prtnet.data.implicit.march import MarchTracer
from prtnet.data.implicit.surface import Described, Implicit
from prtnet.data.scene import Frame, Scene
from prtnet.store import Store

MESH_METHODS, IMPLICIT_METHODS = ("texture", "vertex", "net"), ("unshadowed", "net")
# of them, what milliseconds are told relative to
MESH_BASELINE, IMPLICIT_BASELINE = "texture", "unshadowed"
# the method that may stand by itself, since it has a reference of its own
DATA_DRIVEN = "data_driven"
# of scene.name: the mesh scene.path as a network's distance
NEURAL = "neural_sdf"
# what implicit surfaces can have of the keys that may want an atlas
ATLAS_FREE = {
    "transfer.transport": ("shadowed", "unshadowed"),
    "material.roughness": ("config",),
    "train.texel_size": (0,),
    "render.exact_samples": (0,),
    "export.lightmap": (False,),
}


@dataclass(frozen=True, eq=False)
class Loaded:
    """`scene` has unit coordinates; `frame` leads from the file's to them."""

    scene: Scene
    frame: Frame
    implicit: Implicit | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)  # for the report


def is_implicit(options: SceneOptions) -> bool:
    """Whether the scene has no triangles of its own."""
    if options.name == NEURAL:
        return True
    if options.path:
        return Path(options.path).suffix in file.SUFFIXES
    return options.name in shapes.NAMES


def baseline(options: SceneOptions) -> str:
    """The method that others are timed against."""
    return IMPLICIT_BASELINE if is_implicit(options) else MESH_BASELINE


def with_methods(config: Config) -> Config:
    """The configuration with its methods named. Raises PrtnetError for one that the scene cannot have."""
    implicit = is_implicit(config.scene)
    if not config.methods:
        return replace(config, methods=list(IMPLICIT_METHODS if implicit else MESH_METHODS))
    if list(config.methods) == [DATA_DRIVEN]:
        return config
    first = baseline(config.scene)
    allowed: Sequence[str] = IMPLICIT_METHODS if implicit else METHODS
    if first not in config.methods or not set(config.methods) <= set(allowed):
        others = ", ".join(name for name in allowed if name != first)
        raise PrtnetError(f"methods: found {list(config.methods)}, expected {first} and some of {others}")
    return config


def load(config: Config, store_of: Callable[[str], Store]) -> Loaded:
    """The scene of a checked configuration. Raises PrtnetError.

    `store_of`: where the artifacts of a scene of that name are.
    """
    if not is_implicit(config.scene):
        if config.transfer.tracer == MarchTracer.kind:
            raise PrtnetError("transfer.tracer: found marched on triangles, expected auto, fused or embreex")
        found = _triangles(config)
        return Loaded(found.centred(), found.frame)
    _check_implicit(config)
    facts: Mapping[str, Any] = {}
    if config.scene.name == NEURAL:
        implicit, facts = _neural(config, store_of)
    else:
        described = _described(config.scene)
        check.check(described)
        implicit = mesh.implicit_of(described)
    return Loaded(mesh.scene_of(implicit, config.sdf.resolution).centred(), implicit.frame, implicit, facts)


def _neural(config: Config, store_of: Callable[[str], Store]) -> tuple[Implicit, Mapping[str, Any]]:
    if not config.scene.path:
        raise PrtnetError("scene.path: found none with scene=neural_sdf, expected the mesh that it is fitted to")
    # here and not above: torch, which other scenes need not wait for
    from prtnet.pipeline.neural_sdf import implicit_of_mesh

    triangles = _triangles(config)
    fitted = implicit_of_mesh(triangles, config.sdf, store_of(triangles.name))
    shares = {key: f"{100 * fitted.facts[key]:.3g} % of its longest side" for key in ("chamfer", "worst")}
    words = {"surface to mesh, mean of both ways": shares["chamfer"], "surface to mesh, worst": shares["worst"]}
    return fitted.implicit, words | {"greatest slope of the distance": f"{fitted.facts['lipschitz']:.3g}"}


def _described(options: SceneOptions) -> Described:
    return file.read(Path(options.path)) if options.path else shapes.make(options.name)


def _check_implicit(config: Config) -> None:
    """What needs triangles or an atlas."""
    values = asdict(config)
    for key, expected in ATLAS_FREE.items():
        group, name = key.split(".")
        found = values[group][name]
        if found not in expected:
            words = " or ".join(str(each) for each in expected)
            raise PrtnetError(f"{key}: found {found} on an implicit surface, which has no atlas, expected {words}")


def _triangles(config: Config) -> Scene:
    options, maps = config.scene, _normal_maps(config)
    if options.path:
        images = {part: normal_map.read(Path(file)) for part, file in maps.items()}
        path = Path(options.path)
        return scene.load(path, two_sided=options.two_sided, without=options.without, normal_maps=images)
    for part, image in maps.items():
        raise PrtnetError(
            f"scene.normal_maps: {image} for part {part}: found the built-in scene {options.name}, whose parts have no "
            "texture coordinates; expected a file as scene.path"
        )
    return builtin.make(options.name, tessellation=options.tessellation, seed=options.seed)


def _normal_maps(config: Config) -> dict[str, str]:
    found = config.scene.normal_maps or {}
    if not (isinstance(found, dict) and all(isinstance(image, str) for image in found.values())):
        raise PrtnetError(f"scene.normal_maps: found {found!r}, expected {{part: image, ...}}")
    return {str(part): image for part, image in found.items()}
