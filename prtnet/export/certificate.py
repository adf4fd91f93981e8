"""certificate.json: what an export computes, how far it is from the net, where that was measured, and checksums.

| key | what |
|---|---|
| `format` | 1 |
| `net` | its `name`, `layers` (inputs first), `macs`, `padded_macs`, `bytes`, `sha256` of its arrays |
| `form` | storage, version, precision and digits |
| `executed` | whether the exported form was run; else `reason` says why not |
| `device`, `language` | where it was run, and as what |
| `validated` | whether glslangValidator took the whole shaders |
| `points` | how many of the cube [-1, 1]^3 and of the scene's surface |
| `errors` | `max`, `mean` and `bound` of each comparison, absolute |
| `timing` | CPU-seconds to the first pixels, milliseconds of a frame of `frame` pixels |
| `beyond_minimum` | what the least of drivers may refuse, where there is such a thing |
| `cuda` | of the CUDA kernels, where they were asked for: `validated` by nvcc, and as above, on the processor |
| `files` | SHA-256 of each file |

It is written last: where it is, the files it names are whole.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from prtnet import PrtnetError, netspec, store
from prtnet.export import form
from prtnet.netspec import NetSpec

NAME = "certificate.json"
FORMAT = 1


def of_net(net: NetSpec) -> dict[str, Any]:
    """The entry `net`."""
    sizes = form.sizes_of(net)
    return {
        "name": net.name,
        "layers": sizes,
        "macs": netspec.macs(net),
        "padded_macs": form.padded_macs_of(sizes, net.groups),
        "bytes": netspec.byte_count(net),
        "sha256": netspec.checksum(net),
    }


def refuse(errors: Mapping[str, Mapping[str, float]]) -> None:
    """Raises PrtnetError where an error is above its bound, or no number."""
    for what, each in errors.items():
        if "bound" in each and not each["max"] <= each["bound"]:
            raise PrtnetError(
                f"export: {what}: found an error of {each['max']:.2g}, expected at most {each['bound']:.2g}; nothing "
                "was exported. Try export.storage=texture and export.precision=float32, or another driver"
            )


def remove(folder: Path, names: Iterable[str]) -> None:
    """Delete an earlier export: its certificate first."""
    for name in (NAME, *names):
        (folder / name).unlink(missing_ok=True)


def write(folder: Path, facts: Mapping[str, Any], names: Iterable[str]) -> None:
    """Write the certificate of files that are there. Inverse: `read`."""
    found = {name: store.file_digest(folder / name) for name in sorted(names)}
    text = json.dumps({"format": FORMAT, **facts, "files": found}, indent=1, allow_nan=False)
    store.write_text(folder / NAME, text + "\n")


def read(folder: Path) -> dict[str, Any]:
    """The certificate of a folder. Raises PrtnetError where there is none, or none of this format."""
    path = folder / NAME
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise PrtnetError(f"{path}: not a readable certificate ({error}); export again") from None
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise PrtnetError(f"{path}: found no certificate of format {FORMAT}; export again")
    return found


def check(folder: Path) -> dict[str, Any]:
    """The certificate of a folder whose files are those it was written for, and whose net has the weights that were
    measured. Raises PrtnetError, naming the file, where one is missing or was edited since."""
    found = read(folder)
    for name, digest in found["files"].items():
        path = folder / name
        if not path.is_file():
            raise PrtnetError(f"{path}: no such file, expected the one that {NAME} names; export again")
        if store.file_digest(path) != digest:
            raise PrtnetError(
                f"{path}: found other bytes than {NAME} was written for, edited or cut short; export again"
            )
    return found
