"""Transfer at vertices as a file for others: safetensors with the mesh it belongs to (docs/vertex-transfer.md)."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32
from safetensors import SafetensorError, safe_open

from prtnet import PrtnetError, sh, store
from prtnet.data.scene import Frame, Scene

Array = np.ndarray

FORMAT = 1
METADATA_KEY = "prtnet_vertices"
TENSORS = ("positions", "normals", "faces", "part", "transfer")


@dataclass(frozen=True, eq=False)
class VertexFile:
    """One-sided triangles and the transfer of their vertices."""

    # file coordinates less `centre`, in the file's units
    positions: Float32[Array, "v 3"]
    # unit shading normals
    normals: Float32[Array, "v 3"]
    # counter-clockwise from the front; back sides are faces and vertices of their own
    faces: Int32[Array, "f 3"]
    # index into `parts`
    part: Int32[Array, " f"]
    # groups of SH coefficients
    transfer: Float32[Array, "v c"]
    centre: Float64[Array, " 3"]
    parts: tuple[str, ...]
    # unshadowed, shadowed or interreflected
    kind: str
    name: str

    @property
    def bands(self) -> int:
        return sh.bands_of(self.transfer.shape[1] // self.groups)

    @property
    def groups(self) -> int:
        """4 with bounces: direct, and direct with bounces in red, green, blue; else 1."""
        return 4 if self.kind == "interreflected" else 1


def of_mesh(unit_mesh: Scene, frame: Frame, transfer: Float[Array, "v c"], kind: str) -> VertexFile:
    """The file of a mesh in unit coordinates; `frame` leads back to those of its scene's file."""
    return VertexFile(
        # float32 keeps the distance to the centre, however far from the origin that is
        positions=(unit_mesh.vertices / frame.scale).astype(np.float32),
        normals=unit_mesh.normals,
        faces=unit_mesh.faces,
        part=unit_mesh.part,
        transfer=transfer.astype(np.float32),
        centre=frame.centre,
        parts=tuple(material.name for material in unit_mesh.materials),
        kind=kind,
        name=unit_mesh.name,
    )


def write(path: Path, file: VertexFile) -> None:
    """Write transfer_vertices.safetensors, atomically. Inverse: `read`."""
    about = {"format": FORMAT, "bands": file.bands, "centre": file.centre.tolist(), "parts": file.parts}
    about |= {"kind": file.kind, "name": file.name}
    arrays = {name: getattr(file, name) for name in TENSORS}
    store.save_arrays(path, arrays, {METADATA_KEY: json.dumps(about)})


def read(path: Path) -> VertexFile:
    """Inverse of `write`. Raises PrtnetError, naming the file and what it lacks."""
    try:
        with safe_open(path, "np") as file:
            about = json.loads((file.metadata() or {}).get(METADATA_KEY, "null"))
            arrays = {name: file.get_tensor(name) for name in TENSORS if name in file.keys()}  # noqa: SIM118
    except FileNotFoundError:
        raise PrtnetError(f"{path}: no such file") from None
    except (SafetensorError, OSError, ValueError) as error:
        raise PrtnetError(f"{path}: not a whole safetensors file ({error}); export it again") from None
    if not isinstance(about, dict) or about.get("format") != FORMAT:
        found = about.get("format") if isinstance(about, dict) else None
        raise PrtnetError(f"{path}: found {METADATA_KEY} of format {found}, expected {FORMAT}; export it again")
    absent = [name for name in TENSORS if name not in arrays]
    absent += [key for key in ("centre", "parts", "kind", "name") if key not in about]
    if absent:
        raise PrtnetError(f"{path}: found no {', '.join(absent)}, expected them in a vertex transfer; export it again")
    return VertexFile(
        **arrays,
        centre=np.array(about["centre"], np.float64),
        parts=tuple(about["parts"]),
        kind=about["kind"],
        name=about["name"],
    )
