"""Reading mesh files through trimesh: OBJ, PLY, STL, OFF, glTF and GLB, one part for each material.

trimesh is kept from changing the triangles (process=False), and is told what it gets wrong: relative OBJ indices in
files that interleave vertices with faces, and glTF colours, which it rounds to 8 bits.
"""

import io
import logging
import re
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float, Int
from trimesh.resolvers import FilePathResolver

from prtnet import PrtnetError
from prtnet.data.materials import Finish, gltf_finish, gltf_header, obj_finishes
from prtnet.data.part import Part

log = logging.getLogger(__name__)
Array = np.ndarray

SUFFIXES = (".glb", ".gltf", ".obj", ".off", ".ply", ".stl")
RELATIVE_INDEX = re.compile(r"^f\s.*(?:\s|/)-\d", re.MULTILINE)


def read(path: Path) -> list[Part]:
    """The parts of a mesh file, or of all mesh files below a folder, sorted by name, in scene coordinates.

    Raises PrtnetError when there is nothing, nothing readable, or an index without its vertex.
    """
    if not path.exists():
        raise PrtnetError(f"{path}: no such file or folder, expected a mesh; check scene.path")
    if not path.is_dir():
        return _read_file(path)
    files = sorted(file for file in path.rglob("*") if file.suffix.lower() in SUFFIXES and file.is_file())
    if not files:
        raise PrtnetError(f"{path}: no mesh in this folder, expected files that end in {' '.join(SUFFIXES)}")
    return [part for file in files for part in _read_file(file)]


def _read_file(path: Path) -> list[Part]:
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise PrtnetError(f"{path}: files that end in {suffix or 'nothing'} are not read; use {' '.join(SUFFIXES)}")
    try:
        text = path.read_text(errors="replace") if suffix == ".obj" else ""
        header = gltf_header(path) if suffix in (".gltf", ".glb") else {}
        loaded = _parse(path, text)
    except PrtnetError:
        raise
    # parsers of foreign bytes fail in any way they like, and every one of them is the user's to know
    except Exception as error:
        raise PrtnetError(
            f"{path}: cannot be read as {suffix[1:].upper()} ({type(error).__name__}: {error}); export the file again"
        ) from error
    finishes = obj_finishes(text, path) if text else {}
    nodes = _nodes(loaded)
    _check([loaded.geometry[loaded.graph[node][1]] for node in nodes], header, path)
    return _by_material([_instance(loaded, node, header, finishes, path) for node in nodes])


def _parse(path: Path, text: str) -> trimesh.Scene:
    if RELATIVE_INDEX.search(text):
        resolver = FilePathResolver(str(path))
        content = io.BytesIO(absolute_indices(text).encode())
        return trimesh.load_scene(content, file_type="obj", resolver=resolver, process=False)
    return trimesh.load_scene(path, process=False)


def absolute_indices(text: str) -> str:
    """OBJ text with every negative index (counted back from the vertices so far) made absolute."""
    counts = {"v": 0, "vt": 0, "vn": 0}
    lines = []
    for line in text.splitlines():
        words = line.split()
        if words and words[0] in counts:
            counts[words[0]] += 1
        elif words and words[0] == "f":
            line = " ".join(["f", *(_absolute(word, counts) for word in words[1:])])
        lines.append(line)
    return "\n".join(lines) + "\n"


def _absolute(corner: str, counts: dict[str, int]) -> str:
    pairs = zip(corner.split("/"), counts.values(), strict=False)
    return "/".join(str(int(index) + total + 1) if index.startswith("-") else index for index, total in pairs)


def _nodes(loaded: trimesh.Scene) -> list[str]:
    """Nodes that hold triangles, in the file's order of meshes (trimesh draws some node names at random)."""
    order = {name: place for place, name in enumerate(loaded.geometry)}
    placed = [
        (order[loaded.graph[node][1]], loaded.graph[node][0].tolist(), node) for node in loaded.graph.nodes_geometry
    ]
    return [
        node for place, _, node in sorted(placed) if isinstance(loaded.geometry[loaded.graph[node][1]], trimesh.Trimesh)
    ]


def _instance(
    loaded: trimesh.Scene, node: str, header: dict[str, Any], finishes: dict[str, Finish], path: Path
) -> Part:
    """One mesh under its node's transform."""
    matrix, geometry = loaded.graph[node]
    mesh = loaded.geometry[geometry]
    material = getattr(mesh.visual, "material", None)
    label = getattr(material, "name", None)
    if mesh.visual.kind in ("vertex", "face"):
        log.info("%s: colours by %s are not used", path, mesh.visual.kind)
    if header and str(label) not in finishes:
        finishes[str(label)] = gltf_finish(material, header, path)
    finish = finishes.get(str(label), Finish())
    known = header or label in finishes
    vertices, faces, normals = _placed(mesh, np.asarray(matrix, np.float64))
    uv = getattr(mesh.visual, "uv", None)
    uv = np.asarray(uv, np.float64) if uv is not None and np.shape(uv) == (len(vertices), 2) else None
    name = str(label) if known and label else path.stem
    return Part(
        name,
        vertices,
        faces,
        normals,
        uv,
        finish.albedo,
        finish.texture,
        normal_map=finish.normal_map,
        two_sided=finish.two_sided,
    )


def _placed(
    mesh: trimesh.Trimesh, matrix: Float[Array, "4 4"]
) -> tuple[Float[Array, "v 3"], Int[Array, "f 3"], Float[Array, "v 3"] | None]:
    """Vertices, faces and the file's normals under a transform; mirrors turn the winding."""
    faces = np.asarray(mesh.faces, np.int64)
    vertices = np.asarray(mesh.vertices, np.float64)
    linear = matrix[:3, :3]
    # only what the file gave: trimesh computes normals of its own on demand
    normals = np.asarray(mesh.vertex_normals, np.float64) if "vertex_normals" in mesh._cache else None
    if np.linalg.det(linear) < 0:
        faces = faces[:, ::-1]
    if normals is not None and not np.array_equal(linear, np.eye(3)):
        # the transposed inverse up to a positive factor, which also stands for singular matrices
        cofactors = np.cross(np.roll(linear, -1, axis=0), np.roll(linear, -2, axis=0))
        normals = normals @ (cofactors * (-1 if np.linalg.det(linear) < 0 else 1)).T
    return vertices @ linear.T + matrix[:3, 3], faces, normals


def _by_material(instances: list[Part]) -> list[Part]:
    """Instances of one material as one part, in the order in which the materials come."""
    groups: dict[object, list[Part]] = {}
    for part in instances:
        key = (part.name, part.two_sided, tuple(part.albedo), part.uv is None, part.normals is None)
        groups.setdefault(key, []).append(part)
    return [_joined(group) for group in groups.values()]


def _joined(group: list[Part]) -> Part:
    starts = np.cumsum([0] + [len(part.vertices) for part in group[:-1]])
    faces = np.concatenate([part.faces + start for part, start in zip(group, starts, strict=True)])
    normals = [part.normals for part in group if part.normals is not None]
    uv = [part.uv for part in group if part.uv is not None]
    return Part(
        name=group[0].name,
        vertices=np.concatenate([part.vertices for part in group]),
        faces=faces,
        normals=np.concatenate(normals) if normals else None,
        uv=np.concatenate(uv) if uv else None,
        albedo=group[0].albedo,
        texture=group[0].texture,
        normal_map=group[0].normal_map,
        two_sided=group[0].two_sided,
    )


def _check(meshes: list[trimesh.Trimesh], header: dict[str, Any], path: Path) -> None:
    """Raises PrtnetError when a file holds nothing that can be drawn, or a vertex or an index that cannot be."""
    meshes = [mesh for mesh in meshes if len(mesh.faces)]
    if not meshes:
        raise PrtnetError(f"{path}: no triangles found, expected at least one (points and curves are not drawn)")
    for mesh in meshes:
        count, low, high = len(mesh.vertices), mesh.faces.min(), mesh.faces.max()
        if low < 0 or high >= count:
            found = low if low < 0 else high
            raise PrtnetError(f"{path}: a face uses vertex {found}, expected 0 to {count - 1}; export the file again")
        bad = np.count_nonzero(~np.isfinite(mesh.vertices).all(axis=1))
        if bad:
            raise PrtnetError(f"{path}: {bad} of {count} vertices are not finite; export the file again")
    empty = sum(not mesh.vertices.any() for mesh in meshes)
    packed = ", ".join(name for name in header.get("extensionsUsed", []) if "compression" in name)
    if empty and packed:
        raise PrtnetError(
            f"{path}: all vertices of {empty} meshes are zero: {packed} is not decoded; export without compression"
        )
    if empty == len(meshes):
        raise PrtnetError(f"{path}: all vertices are zero, expected a mesh with an extent; export the file again")
