"""Transfer at vertices as GLB: the mesh with its materials, and the coefficients as vertex attributes of their own.

glTF 2.0 (Khronos 2021): attributes that an application defines begin with an underscore, and none is wider than a
vec4, so k coefficients stand in ceil(k / 4) of them, `_PRT_0`, `_PRT_1`, ..., the last one padded with 0; with bounces
transfer per colour follows in `_PRT_R_0`, ..., `_PRT_G_0`, ..., `_PRT_B_0`, ... (docs/gltf-transfer.md).
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32

from prtnet import PrtnetError, sh
from prtnet.data.scene import Scene
from prtnet.export import glb
from prtnet.export.glb import EXTRAS_KEY, INDICES, VERTICES, Binary, Json
from prtnet.export.vertices import VertexFile

Array = np.ndarray

FORMAT = 1
CONVENTION = (
    "t_i = integral of V(p, w) max(0, n.w) Y_i(w) dw over steradians, no albedo, no 1/pi; real orthonormal spherical "
    "harmonics on world x, y, z without Condon-Shortley phase, i = l*l + l + m, Y_1 = sqrt(3/4pi) (y, z, x)"
)
GROUPS = {1: ("",), 4: ("", "R_", "G_", "B_")}


def attributes(transfer: Float[Array, "v c"], groups: int = 1) -> dict[str, Float32[Array, "v 4"]]:
    """Vertex attributes by name, of one group of coefficients or of four. Inverse: `transfer_of`."""
    grouped = transfer.reshape(len(transfer), groups, -1)
    count = -(-grouped.shape[2] // 4)
    padded = np.zeros((len(transfer), groups, 4 * count), np.float32)
    padded[:, :, : grouped.shape[2]] = grouped
    return {
        f"_PRT_{letter}{index}": np.ascontiguousarray(padded[:, group, 4 * index : 4 * index + 4])
        for group, letter in enumerate(GROUPS[groups])
        for index in range(count)
    }


def transfer_of(found: Mapping[str, Array], bands: int, groups: int = 1) -> Float32[Array, "v c"]:
    """Inverse of `attributes`. Raises KeyError with the name of an attribute that is not there."""
    count = sh.count(bands)
    parts = [
        np.concatenate([found[f"_PRT_{letter}{index}"] for index in range(-(-count // 4))], axis=1)[:, :count]
        for letter in GROUPS[groups]
    ]
    return np.concatenate(parts, axis=1)


def write(path: Path, file: VertexFile, mesh: Scene) -> None:
    """Write transfer_vertices.glb, atomically; `mesh` has the materials and texture coordinates of the same vertices.

    Faces come grouped by part, a primitive each; all share the vertices. Inverse: `read`.
    """
    binary = Binary()
    content = {"POSITION": file.positions, "NORMAL": file.normals} | attributes(file.transfer, file.groups)
    textured = mesh.uv is not None and any(material.texture is not None for material in mesh.materials)
    if textured and mesh.uv is not None:
        content["TEXCOORD_0"] = glb.coordinates(mesh.uv)
    shared = {name: binary.accessor(values, VERTICES, bounds=name == "POSITION") for name, values in content.items()}
    primitives = [
        {
            "attributes": shared,
            "indices": binary.accessor(file.faces[file.part == part].astype(np.uint32).ravel(), INDICES),
            "material": part,
        }
        for part in range(len(file.parts))
        if (file.part == part).any()
    ]
    about = {"format": FORMAT, "bands": file.bands, "groups": file.groups, "kind": file.kind, "convention": CONVENTION}
    header: Json = {
        "asset": {"version": "2.0", "generator": "prtnet"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        # in JSON the centre keeps its digits, as float32 positions could not
        "nodes": [{"mesh": 0, "name": file.name, "translation": file.centre.tolist()}],
        "meshes": [{"name": file.name, "primitives": primitives, "extras": {EXTRAS_KEY: about}}],
        "materials": [],
    }
    for material in mesh.materials:
        texture = material.texture if textured else None
        image = None if texture is None else binary.image(header, glb.srgb_png(texture))
        header["materials"].append(glb.material(material.name, material.albedo, image))
    glb.write(path, header, binary)


def read(path: Path) -> VertexFile:
    """Inverse of `write`, less texture coordinates and materials: faces come by part.

    Raises PrtnetError, naming the file and what it lacks, for what `write` did not write.
    """
    header, binary = glb.opened(path)
    try:
        mesh, node = header["meshes"][0], header["nodes"][0]
        about = mesh.get("extras", {}).get(EXTRAS_KEY, {})
        if about.get("format") != FORMAT:
            found = f"found {EXTRAS_KEY} of format {about.get('format')}, expected {FORMAT}"
            raise PrtnetError(f"{path}: {found}; export it again")
        first = mesh["primitives"][0]["attributes"]
        content = {name: glb.values(header, binary, index) for name, index in first.items()}
        faces = [glb.values(header, binary, each["indices"]).reshape(-1, 3) for each in mesh["primitives"]]
        parts = [each["material"] for each in mesh["primitives"]]
        return VertexFile(
            positions=content["POSITION"],
            normals=content["NORMAL"],
            faces=np.concatenate(faces).astype(np.int32),
            part=np.repeat(np.array(parts, np.int32), [len(each) for each in faces]),
            transfer=transfer_of(content, about["bands"], about["groups"]),
            centre=np.array(node["translation"], np.float64),
            parts=tuple(material["name"] for material in header["materials"]),
            kind=about["kind"],
            name=node["name"],
        )
    except (KeyError, IndexError) as error:
        raise PrtnetError(f"{path}: found no {error}, expected it in a vertex transfer; export it again") from None
