"""The hand-over format of several nets that share one scene, and the plain evaluator of their blend.

    t(p, n) = sum_c w_c(p) net_c((p - centre_c) scale_c, n)        w_c >= 0, sum_c w_c = 1

A `Split` cuts the scene into leaves; a cluster is one leaf or several that were merged, and has one net, in a cube of
its own. Across a plane the weights change by the smooth step x^2 (3 - 2 x) within `delta` on either side; that of a
leaf is the product along its way down the tree, that of a cluster the sum over its leaves.

The file, clusters.json, stands in a folder beside the nets it names (docs/net-format.md).
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Float64, Int

from prtnet import PrtnetError, netspec, sh, store
from prtnet.netspec import NetSpec

Array = np.ndarray

FORMAT = 1
FILE = "clusters.json"
# what a triangle that reaches into two clusters is, and what chooses a net: see `render.clusters`
BORDERS, SELECTS = ("clip", "assign"), ("draw", "fragment")


class Plane(NamedTuple):
    """Where `axis` (0 to 2) has the coordinate `at`, in unit coordinates, a leaf or a plane further down is on either
    side: the index of that plane, which is greater than this one's, or -1 - the index of that leaf."""

    axis: int
    at: float
    below: int
    above: int


@dataclass(frozen=True)
class Split:
    """A binary tree of planes, the first of them its root, or as many leaves as the scene has parts.

    Neither planes nor parts: one leaf. With `parts`, leaf i is part i of the scene.
    """

    planes: tuple[Plane, ...] = ()
    parts: int = 0

    @property
    def leaves(self) -> int:
        return self.parts or len(self.planes) + 1

    def __post_init__(self) -> None:
        if self.parts < 0 or (self.parts and self.planes):
            raise PrtnetError(f"split: found {self.parts} parts and {len(self.planes)} planes, expected one or none")
        children = [child for plane in self.planes for child in (plane.below, plane.above)]
        if self.planes and sorted(children) != [*range(-self.leaves, 0), *range(1, len(self.planes))]:
            raise PrtnetError(f"split: found planes that lead to {children}, expected each other and each leaf once")
        for index, plane in enumerate(self.planes):
            if plane.axis not in (0, 1, 2) or not np.isfinite(plane.at):
                raise PrtnetError(f"split: found {plane}, expected an axis of 0, 1 or 2 and a finite coordinate")
            if any(0 <= child <= index for child in (plane.below, plane.above)):
                raise PrtnetError(f"split: found {plane} at {index}, expected planes after the one that leads to them")


@dataclass(frozen=True)
class ClusterSpec:
    """`cluster`: of each leaf, the index of its net. `centre` and `scale` take file coordinates to unit coordinates;
    each net's own centre and scale take them to its own cube."""

    split: Split
    cluster: tuple[int, ...]
    delta: float  # half the width of the blend at a plane, in unit lengths: the scene is 2 long; 0: hard borders
    nets: tuple[NetSpec, ...]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)  # float64
    scale: float = 1.0
    merges: tuple[str, ...] = ()  # why leaves were merged, a sentence each

    def __post_init__(self) -> None:
        if len(self.cluster) != self.split.leaves or set(self.cluster) != set(range(len(self.nets))):
            found = f"leaves in clusters {list(self.cluster)} with {len(self.nets)} nets"
            raise PrtnetError(f"clusters: found {found}, expected {self.split.leaves} leaves, and each net in use")
        if not 0 <= self.delta < np.inf:
            raise PrtnetError(f"clusters: found delta {self.delta}, expected 0 or more")
        if not (self.scale > 0 and np.isfinite([self.scale, *self.centre]).all()):
            raise PrtnetError(f"clusters: found centre {self.centre} and scale {self.scale}, expected finite, above 0")
        kinds = {(net.bands, net.groups) for net in self.nets}
        if len(kinds) != 1 or any(net.texels for net in self.nets):
            raise PrtnetError(f"clusters: found bands, groups {sorted(kinds)}, expected alike, and nets without texels")


def own_frame(spec: ClusterSpec, index: int) -> tuple[Float64[Array, " 3"], float]:
    """Centre and scale of a cluster's own cube: own = (unit - centre) * scale."""
    net = spec.nets[index]
    return (np.asarray(net.centre) - np.asarray(spec.centre)) * spec.scale, net.scale / spec.scale


def weights(
    spec: ClusterSpec, positions: Float[Array, "n 3"], part: Int[Array, " n"] | None = None
) -> Float64[Array, "n c"]:
    """Of each cluster at unit positions; they sum to 1. A split by parts needs the part of each point."""
    return blend(spec.split, spec.cluster, spec.delta, positions, part)


def blend(
    split: Split,
    cluster: tuple[int, ...],
    delta: float,
    positions: Float[Array, "n 3"],
    part: Int[Array, " n"] | None = None,
) -> Float64[Array, "n c"]:
    """`weights`, of clusters that have no nets yet."""
    leaves = leaf_weights(split, delta, positions, part)
    out = np.zeros((len(positions), max(cluster) + 1))
    for leaf, index in enumerate(cluster):
        out[:, index] += leaves[:, leaf]
    return out


def leaf_weights(
    split: Split, delta: float, positions: Float[Array, "n 3"], part: Int[Array, " n"] | None = None
) -> Float64[Array, "n leaves"]:
    """Of each leaf at unit positions; they sum to 1."""
    if split.parts:
        if part is None:
            raise PrtnetError("clusters: found no parts of the points, expected some: the scene is split by its parts")
        return np.eye(split.parts)[part]
    out = np.ones((len(positions), split.leaves))
    arriving = {0: np.ones(len(positions))}
    for index, plane in enumerate(split.planes):
        above = smooth_step(np.asarray(positions, np.float64)[:, plane.axis] - plane.at, delta)
        whole = arriving.pop(index)
        for child, share in ((plane.below, 1 - above), (plane.above, above)):
            if child >= 0:
                arriving[child] = whole * share
            else:
                out[:, -1 - child] = whole * share
    return out


def smooth_step(distance: Float64[Array, " n"], delta: float) -> Float64[Array, " n"]:
    """0 up to -delta, 1 from delta on, x^2 (3 - 2 x) between; a step at 0 where delta is 0."""
    if delta == 0:
        return (distance >= 0).astype(np.float64)
    x = (np.clip(distance, -delta, delta) + delta) / (2 * delta)
    return x * x * (3 - 2 * x)


def evaluate_unit(
    spec: ClusterSpec,
    positions: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    part: Int[Array, " n"] | None = None,
    sums: type = np.float64,
) -> Float[Array, "n k"]:
    """Transfer at unit positions with unit normals: the blend of the nets whose weight is above 0. `sums` as in
    `netspec.evaluate_unit`."""

    def one(index: int, own: Array, turned: Array) -> Array:
        return netspec.evaluate_unit(spec.nets[index], own, turned, sums)

    share = weights(spec, positions, part)
    return blended(spec, share, positions, normals, one).astype(np.result_type(positions, np.float32), copy=False)


def blended(
    spec: ClusterSpec,
    share: Float[Array, "n c"],
    positions: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    evaluate: Callable[[int, Array, Array], Array],
) -> Float64[Array, "n k"]:
    """`evaluate_unit` by weights that are known, each net by a function of its index, positions in its own cube, and
    normals."""
    out = np.zeros((len(positions), spec.nets[0].groups * sh.count(spec.nets[0].bands)))
    for index in range(len(spec.nets)):
        seen = share[:, index] > 0
        if seen.any():
            centre, scale = own_frame(spec, index)
            own = (np.asarray(positions[seen], np.float64) - centre) * scale
            out[seen] += share[seen, index, None] * evaluate(index, own, normals[seen])
    return out


def macs(spec: ClusterSpec, share: Float[Array, "n c"]) -> Int[Array, " n"]:
    """Multiply-adds of the nets at points with such weights: of all whose weight is above 0."""
    return (share > 0) @ np.array([netspec.macs(net) for net in spec.nets])


def byte_count(spec: ClusterSpec) -> int:
    """Bytes of all nets, as `netspec.byte_count` has them."""
    return sum(netspec.byte_count(net) for net in spec.nets)


def save(spec: ClusterSpec, folder: Path | str) -> Path:
    """Writes clusters.json and the nets beside it, and removes nets of an earlier set; the same set gives the same
    bytes. Inverse of `load`. The table is written last: without it, or with another, there is no set."""
    folder = Path(folder)
    files = [folder / f"net_{index:02d}.safetensors" for index in range(len(spec.nets))]
    for net, file in zip(spec.nets, files, strict=True):
        netspec.save(net, file)
    descriptor = {
        "format": FORMAT,
        "centre": list(spec.centre),
        "scale": spec.scale,
        "delta": spec.delta,
        "planes": [list(plane) for plane in spec.split.planes],
        "parts": spec.split.parts,
        "cluster": list(spec.cluster),
        "nets": [{"file": file.name, "sha256": store.file_digest(file)} for file in files],
        "merges": list(spec.merges),
    }
    store.write_text(folder / FILE, json.dumps(descriptor, indent=1) + "\n")
    for stale in set(folder.glob("net_*.safetensors")) - set(files):
        stale.unlink()
    return folder / FILE


def load(path: Path | str) -> ClusterSpec:
    """Reads a set from its folder or its clusters.json. Inverse of `save`. Raises PrtnetError, naming the file, where
    anything of it is missing or is not what was written."""
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    try:
        descriptor = json.loads(path.read_text(encoding="utf-8"))
        if (found := descriptor["format"]) != FORMAT:
            raise PrtnetError(f"found format {found}")
        planes = tuple(Plane(int(axis), float(at), int(low), int(high)) for axis, at, low, high in descriptor["planes"])
        x, y, z = descriptor["centre"]
        nets = tuple(_net(path.parent, entry) for entry in descriptor["nets"])
        return ClusterSpec(
            Split(planes, int(descriptor["parts"])),
            tuple(map(int, descriptor["cluster"])),
            float(descriptor["delta"]),
            nets,
            (float(x), float(y), float(z)),
            float(descriptor["scale"]),
            tuple(descriptor["merges"]),
        )
    except FileNotFoundError:
        raise PrtnetError(f"{path}: no such file, expected trained clusters; train and export some first") from None
    except (OSError, ValueError, TypeError, KeyError, AttributeError, PrtnetError) as error:
        words = f"no {error}" if isinstance(error, KeyError) else error
        raise PrtnetError(f"{path}: {words}. Expected a whole set (format {FORMAT}); export it again") from error


def _net(folder: Path, entry: Any) -> NetSpec:
    file = folder / entry["file"]
    if file.parent != folder:
        raise PrtnetError(f"found the net {entry['file']}, expected one in the same folder")
    if not file.is_file():
        raise PrtnetError(f"found no file {file.name}, which it names as a net")
    if store.file_digest(file) != entry["sha256"]:
        raise PrtnetError(f"found another {file.name} than was written: its checksum differs")
    return netspec.load(file)
