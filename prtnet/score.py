"""Scores: the tone map shared by all methods, image metrics against a reference, cost counts, and score files.

Images are "h w 3" in linear RGB, row 0 at the top; `covered` says which pixels show the scene. Metrics compare
sRGB(clip(exposure * linear, 0, 1)), data range 1, with one exposure per scene, light and material for all methods.
"""

import json
import math
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from importlib import metadata
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from prtnet import PrtnetError, __version__, store

Array = np.ndarray

NOISE_FLOOR = "noise_floor"  # the method of the row that scores a reference drawn with another seed against itself
PSNR_CAP = 100.0  # dB of two images that are equal to an RMSE of 1e-5, so that every PSNR is finite and has a mean
SSIM_WINDOW = 11  # pixels: the truncated Gaussian of sigma 1.5


def exposure(references: Sequence[Float[Array, "h w 3"]], covered: Sequence[Bool[Array, "h w"]]) -> float:
    """0.9 / P99 of max(R, G, B) over the covered pixels of all `traced` views, linear.

    Raises PrtnetError when that percentile is not above 0: nothing could be seen, and nothing compared.
    """
    _check_views(references, references, covered)
    brightest = [np.max(image[mask], axis=-1) for image, mask in zip(references, covered, strict=True)]
    level = float(np.percentile(np.concatenate(brightest).astype(np.float64), 99))
    if level <= 0:
        raise PrtnetError(
            f"reference images: the 99th percentile of max(R, G, B) is {level:g}, expected above 0; the light or the "
            "albedo is black, or nothing in view can see the light"
        )
    return 0.9 / level


def srgb_encode(linear: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Linear values in [0, 1] to sRGB in [0, 1] (IEC 61966-2-1). Inverse of `srgb_decode`."""
    power = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, power).astype(linear.dtype)


def srgb_decode(encoded: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """sRGB values in [0, 1] to linear in [0, 1]. Inverse of `srgb_encode`."""
    power = ((np.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, power).astype(encoded.dtype)


def tone_map(linear: Float[Array, "*n"], exposure: float) -> Float[Array, "*n"]:
    """sRGB(clip(exposure * linear, 0, 1)): what is shown, and what is compared."""
    return srgb_encode(np.clip(linear * linear.dtype.type(exposure), 0, 1))


def psnr(
    image: Float[Array, "h w 3"], reference: Float[Array, "h w 3"], covered: Bool[Array, "h w"] | None = None
) -> float:
    """10 log10(1 / MSE) in dB over the covered pixels (None: all) of two tone-mapped images, at most PSNR_CAP."""
    difference = np.asarray(image, np.float64) - reference
    error = np.mean(np.square(difference if covered is None else difference[covered]))
    return -10 * math.log10(max(float(error), 10 ** (-PSNR_CAP / 10)))


def ssim_map(image: Float[Array, "h w 3"], reference: Float[Array, "h w 3"]) -> Float[Array, "h w"]:
    """Structural similarity at each pixel, mean of the channels, with the window and constants of Wang et al. 2004."""
    from skimage.metrics import structural_similarity

    if min(image.shape[:2]) < SSIM_WINDOW:
        raise PrtnetError(f"image: found {image.shape[1]} x {image.shape[0]}, expected at least {SSIM_WINDOW} squared")
    pair = [np.asarray(each, np.float64) for each in (reference, image)]
    window = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    similarity = structural_similarity(*pair, data_range=1.0, channel_axis=-1, full=True, **window)[1]
    return np.mean(similarity, axis=-1)


def flip_map(image: Float[Array, "h w 3"], reference: Float[Array, "h w 3"]) -> Float[Array, "h w"] | None:
    """FLIP error at each pixel at 67 pixels per degree (Andersson et al. 2020); None without flip-evaluator."""
    try:
        import flip_evaluator  # pyright: ignore[reportMissingImports]
    except ImportError:
        return None
    pair = [np.ascontiguousarray(each, np.float32) for each in (reference, image)]
    return np.asarray(flip_evaluator.evaluate(*pair, "LDR", applyMagma=False)[0])[..., 0]


def clipped_share(linear: Float[Array, "h w 3"], covered: Bool[Array, "h w"]) -> float:
    """Share of the covered pixels with a negative channel before the tone map clips it: SH ringing."""
    return float(np.mean(np.any(linear[covered] < 0, axis=-1)))


@dataclass(frozen=True)
class ViewScore:
    """One view's metrics, on covered pixels except for those named `_full`."""

    psnr: float
    psnr_full: float
    ssim: float
    ssim_full: float
    mae: float
    flip: float | None
    clipped: float


@dataclass(frozen=True)
class Metrics:
    """The metrics of one method over all views, in order."""

    per_view: tuple[ViewScore, ...]

    @property
    def worst(self) -> int:
        """Index of the view with the lowest PSNR on covered pixels."""
        return min(range(len(self.per_view)), key=lambda view: self.per_view[view].psnr)

    def summary(self) -> dict[str, Any]:
        """Means over the views and the worst view's PSNR, under the names they have in `Row`."""
        means: dict[str, Any] = {}
        for name in (field.name for field in fields(ViewScore)):
            values = [getattr(view, name) for view in self.per_view]
            means[name] = None if None in values else float(np.mean(values))
        return means | {"psnr_worst": self.per_view[self.worst].psnr, "views": len(self.per_view)}


def score_view(
    image: Float[Array, "h w 3"], reference: Float[Array, "h w 3"], covered: Bool[Array, "h w"], exposure: float
) -> ViewScore:
    """Metrics of one linear image against a linear reference. The clipped share is that of `image`."""
    shown, wanted = tone_map(image, exposure), tone_map(reference, exposure)
    similarity, flip = ssim_map(shown, wanted), flip_map(shown, wanted)
    return ViewScore(
        psnr=psnr(shown, wanted, covered),
        psnr_full=psnr(shown, wanted),
        ssim=float(similarity[covered].mean()),
        ssim_full=float(similarity.mean()),
        mae=float(np.abs(shown.astype(np.float64) - wanted)[covered].mean()),
        flip=None if flip is None else float(flip[covered].mean()),
        clipped=clipped_share(image, covered),
    )


def score_views(
    images: Sequence[Float[Array, "h w 3"]],
    references: Sequence[Float[Array, "h w 3"]],
    covered: Sequence[Bool[Array, "h w"]],
    exposure: float,
) -> Metrics:
    """Metrics of linear images against linear references, view by view.

    Raises PrtnetError, naming the view, on other counts or sizes, values that are not finite, or nothing covered.
    """
    _check_views(images, references, covered)
    views = zip(images, references, covered, strict=True)
    return Metrics(tuple(score_view(image, reference, mask, exposure) for image, reference, mask in views))


def _check_views(images: Sequence[Array], references: Sequence[Array], covered: Sequence[Array]) -> None:
    if not len(images) == len(references) == len(covered) > 0:
        counts = f"{len(images)} images, {len(references)} references and {len(covered)} masks"
        raise PrtnetError(f"views: found {counts}, expected as many of each and at least one")
    for view, (image, reference, mask) in enumerate(zip(images, references, covered, strict=True)):
        if image.shape != reference.shape or image.shape[:2] != mask.shape:
            shapes = f"{image.shape}, {reference.shape} and {mask.shape}"
            raise PrtnetError(f"view {view}: image, reference and mask have shapes {shapes}, expected one size")
        bad = int(np.sum(~np.isfinite(image)) + np.sum(~np.isfinite(reference)))
        if bad:
            raise PrtnetError(f"view {view}: {bad} values are NaN or infinite, expected finite radiance")
        if not mask.any():
            raise PrtnetError(f"view {view}: no pixel is covered, expected half of them; the camera misses the scene")


def fetch_macs(channels: int, filtering: Literal["nearest", "bilinear", "trilinear"] = "trilinear") -> int:
    """Multiply-adds of a texture fetch: each of the 1, 4 or 8 texels it blends counts once per channel."""
    return {"nearest": 1, "bilinear": 4, "trilinear": 8}[filtering] * channels


def diffuse_macs(coefficients: int) -> int:
    """Multiply-adds of the dot product of a transfer with the light, three colour channels."""
    return 3 * coefficients


def texture_bytes(size: int, coefficients: int, *, texel_bytes: int = 4, levels: int = 1) -> int:
    """Bytes of a square transfer texture in RGBA layers: the coefficients, of `texel_bytes` each, are padded to a
    multiple of four."""
    return sum((size >> level) ** 2 for level in range(levels)) * 4 * math.ceil(coefficients / 4) * texel_bytes


def vertex_macs(vertices: int, coefficients: int, pixels: float) -> int:
    """Multiply-adds of vertex PRT per covered pixel: the dot products of all vertices, seen or not, shared out among
    the pixels, and three colour channels interpolated between three vertices at each."""
    return round(vertices * diffuse_macs(coefficients) / max(pixels, 1)) + 9


def vertex_bytes(vertices: int, coefficients: int) -> int:
    """Bytes of the transfer of vertices in RGBA32F texels: the coefficients are padded to a multiple of four."""
    return vertices * 16 * math.ceil(coefficients / 4)


@dataclass(frozen=True)
class Row:
    """One line of a score file. None stands for what was not, or cannot be, measured."""

    scene: str
    method: str  # texture, net, ..., NOISE_FLOOR, or traced against exact
    material: str
    light: str
    reference: str  # traced, texture, or exact = without SH
    psnr: float | None  # dB, mean over the views of the covered pixels' PSNR
    psnr_worst: float | None  # dB, the worst view's
    psnr_full: float | None  # dB, on the full frame
    ssim: float | None
    ssim_full: float | None
    mae: float | None  # tone-mapped, in [0, 1]
    flip: float | None
    ms: float | None  # per frame, median
    ms_ratio: float | None  # ms over that of the texture method in the same run
    macs: int | None  # multiply-adds per pixel
    bytes: int | None
    bake_seconds: float | None
    train_seconds: float | None
    clipped: float | None  # share of the covered pixels with a negative channel
    views: int
    covered: float | None = None  # share of the frame, mean of the views
    vertices: int | None = None  # of the mesh that the method draws
    triangles: int | None = None  # of that mesh
    point: str | None = None  # of a sweep: what tells its rows from those of the others

    @property
    def is_noise_floor(self) -> bool:
        """Whether this row tells how well the reference agrees with itself."""
        return self.method == NOISE_FLOOR

    @property
    def is_method(self) -> bool:
        """Whether this row is of a method, and not of a reference held against itself or against another."""
        return self.method not in (NOISE_FLOOR, "traced")


KEYS = tuple(field.name for field in fields(Row))
OPTIONAL = frozenset({"covered", "vertices", "triangles", "point"})  # files from before these columns lack them
COSTS = ("ms", "ms_ratio", "macs", "bytes", "bake_seconds", "train_seconds")


def row(
    metrics: Metrics, *, scene: str, method: str, material: str, light: str, reference: str, **costs: float | int | None
) -> Row:
    """A row of metrics and of those COSTS that are known."""
    values: dict[str, Any] = dict.fromkeys(COSTS) | metrics.summary() | costs
    return Row(scene=scene, method=method, material=material, light=light, reference=reference, **values)


def versions() -> dict[str, str | None]:
    """What a score depends on besides its inputs. Nothing is imported for it; None for what is not installed."""
    found: dict[str, str | None] = {"prtnet": __version__, "python": platform.python_version()}
    for name in ("numpy", "torch"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = None
    return found | {"machine": platform.machine()}


def rows_to_json(rows: Iterable[Row], versions: Mapping[str, str | None], **more: Any) -> str:
    """Strict JSON, {"rows": [...], "versions": {...}} and more: a number that is not finite is written as null."""
    plain = [{name: _plain(value) for name, value in asdict(each).items()} for each in rows]
    return json.dumps({"rows": plain, "versions": dict(versions), **more}, indent=1, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write(path: Path, rows: Iterable[Row], versions: Mapping[str, str | None], **more: Any) -> None:
    """Write a score file, atomically. Inverse of `read`."""
    store.write_text(path, rows_to_json(rows, versions, **more))


def read(path: Path) -> tuple[list[Row], dict[str, str | None]]:
    """The rows and versions of a score file. Raises PrtnetError, naming the file and what is wrong with it."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
        rows, found = content["rows"], content["versions"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise PrtnetError(f"{path}: not a score file ({error!r}), expected JSON with rows and versions") from None
    for index, each in enumerate(rows):
        odd = sorted((set(each) ^ set(KEYS)) - (OPTIONAL - set(each)))
        if odd:
            raise PrtnetError(f"{path}: row {index} misses or has besides: {', '.join(odd)}; score the run again")
    return [Row(**each) for each in rows], found


def _refuse(constant: str) -> Any:
    raise ValueError(f"{constant} is not strict JSON")
