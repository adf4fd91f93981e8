"""Training recipes: everything of a net and its training but the net's size."""

from dataclasses import dataclass, field
from math import inf

from prtnet import PrtnetError
from prtnet.encoding import encoded_size


@dataclass
class ModelOptions:
    """The size of the network. It stands here, without torch, so that the command line stays quick."""

    width: int = 64  # neurons of each hidden layer
    depth: int = 4  # hidden layers; the output layer comes on top, and is all there is where this is 0

    def words(self) -> str:
        """For titles."""
        return f"{self.depth} layers of {self.width}" if self.depth else "no hidden layer"


@dataclass
class TrainOptions:
    """One recipe. The defaults are the default recipe; configs/train/ holds the same figures with their reasons."""

    recipe: str = "default"  # its name, for tables
    # the net around its layers
    activation: str = "hard_gelu"  # leaky_relu | gelu | silu | hard_gelu | relu | sine
    negative_slope: float = 0.01  # of leaky_relu
    # of sine: hidden layers are sin(sine_omega (W h + b)); SIREN has 30, and wants rates as many times lower
    sine_omega: float = 1.0
    output: str = "linear"  # tanh | linear
    residual: bool = False  # the layers learn what occlusion changes of the transfer of an unoccluded point
    encoding: str = "frequency"  # of position and normal: frequency | triangle (waves for sines) | identity (none)
    position_frequencies: int = 6  # of the encoding: octaves, the lowest of period 4 (the scene spans 2)
    normal_frequencies: int = 2
    # dense grids of features over [-1, 1]^3 beside the encoding, one for each [x, y, z] number of cells
    grid_cells: list[list[int]] = field(default_factory=lambda: [[16, 8, 16]])
    grid_channels: int = 8  # of each grid, a multiple of 4
    grid_format: str = "float16"  # of the values of grids, dense or hashed, and texels in the net: float16 | float32
    # finer grids of so many cells along each axis, whose corners share the entries of a table by a hash
    hash_cells: list[int] = field(default_factory=lambda: [32, 64, 128])
    hash_entries: int = 16384  # of each table, a power of two
    hash_channels: int = 4  # of each table, a multiple of 4
    # an image of features over the coordinates of the transfer texture, which the net then takes as well
    texel_size: int = 0  # texels along one side; 0: none
    texel_channels: int = 8  # a multiple of 4
    # what is minimised
    loss: str = "huber"  # of coefficients: l1 | l2 | huber; or projection (on the sphere) | radiance (under lights)
    huber_delta: float = 0.02  # of huber, in units of t / pi; of radiance, where an open surface shows about 1
    loss_norm: str = "huber"  # of projection and radiance: l1 | l2 | huber
    loss_samples: int = 64  # of projection and radiance: directions or lights, drawn for each step
    loss_gloss: float = 0.0  # of radiance: the Phong exponent of half the functionals; 0: all are diffuse
    band_falloff: float = 0.0  # band l weighs (1 + l)^-band_falloff
    dark_weight: float = 0.0  # a point weighs (its open share)^-dark_weight, about as the display curve shows errors
    # how
    optimiser: str = "soap"  # adam | soap (matrices; adam for biases) | muon (hidden matrices; adam for the rest)
    learning_rate: float = 0.02  # the highest, of adam
    matrix_rate: float = 0.025  # the highest, of soap or muon
    schedule: str = "cosine"  # constant | cosine | one_cycle
    warmup: float = 0.02  # share of the steps in which the rate climbs from 0; of cosine and one_cycle
    beta2: float = 0.999  # of adam
    batch: int = 2048
    resample: float = 0.0  # share of each batch drawn in proportion to the points' last errors
    resample_correction: float = 1.0  # 1: they weigh as much less as they come more often; 0: they weigh the same
    average: float = 0.0  # decay of the running mean of the weights that is exported; 0: the last weights
    precision: str = "auto"  # float32 | bfloat16 | auto: bfloat16 where the processor multiplies in it, but for sine
    device: str = "auto"  # cpu | cuda | auto: cuda where torch sees one
    seed: int = 0
    # how long
    steps: int | None = None  # null: as many as fit into cpu_seconds, by one calibration
    cpu_seconds: float = 60.0
    # looks, at every 20th of the steps, without an improvement of points kept back, until a run ends; 0: it never does
    patience: int = 0
    checkpoint_seconds: float = 20.0  # CPU-seconds between checkpoints


def published() -> TrainOptions:
    """Learnt Transfer (Sirikonda, Aakash KT and Narayanan 2022): L1, Adam at a constant rate, leaky-ReLU, tanh.

    The paper gives no rate; ours won a search over constant rates.
    """
    return TrainOptions(
        recipe="published",
        activation="leaky_relu",
        negative_slope=0.01,
        output="tanh",
        residual=False,
        position_frequencies=10,
        normal_frequencies=4,
        grid_cells=[],
        hash_cells=[],
        loss="l1",
        band_falloff=0.0,
        dark_weight=0.0,
        optimiser="adam",
        learning_rate=0.01,
        schedule="constant",
        warmup=0.0,
        beta2=0.999,
        batch=8192,
        average=0.0,
    )


MAX_GRIDS, MAX_SLICES = 4, 256  # of a net; of a 3D texture, in which four channels take as many as there are cells

HASH_ENTRIES = (256, 1 << 18)  # of a table, least and most: a row of its texture, and a texture of any driver
MAX_TEXELS = 4096  # along one side of a texture, in which four channels are one texel, side by side
MAX_HASH_CELLS = 1024  # along an axis: float32 still says where in a cell of these a point is


def layer_sizes(model: ModelOptions, options: TrainOptions, outputs: int) -> list[int]:
    """Numbers that enter the first layer, of each hidden layer, and of the outputs."""
    inputs = encoded_size(options.position_frequencies, options.normal_frequencies, options.encoding)
    inputs += options.grid_channels * len(options.grid_cells) + options.hash_channels * len(options.hash_cells)
    inputs += options.texel_channels * bool(options.texel_size)
    return [inputs, *[model.width] * model.depth, outputs]


def feature_count(options: TrainOptions) -> int:
    """Values of all grids, tables and texels."""
    grids = sum(x * y * z * options.grid_channels for x, y, z in options.grid_cells)
    tables = len(options.hash_cells) * options.hash_entries * options.hash_channels
    return grids + tables + options.texel_size**2 * options.texel_channels


def check(options: TrainOptions) -> None:
    """Raises PrtnetError where a field holds a word or number that means nothing."""
    words = {
        "activation": ("leaky_relu", "gelu", "silu", "hard_gelu", "relu", "sine"),
        "encoding": ("frequency", "triangle", "identity"),
        "output": ("tanh", "linear"),
        "grid_format": ("float16", "float32"),
        "loss": ("l1", "l2", "huber", "projection", "radiance"),
        "loss_norm": ("l1", "l2", "huber"),
        "optimiser": ("adam", "muon", "soap"),
        "schedule": ("constant", "cosine", "one_cycle"),
        "precision": ("auto", "float32", "bfloat16"),
        "device": ("auto", "cpu", "cuda"),
    }
    for name, allowed in words.items():
        found = getattr(options, name)
        if found not in allowed:
            raise PrtnetError(f"train.{name}: found {found!r}, expected one of {', '.join(allowed)}")
    _check_grids(options)
    _check_hashes(options)
    _check_texels(options)
    for name in ("learning_rate", "matrix_rate", "huber_delta", "batch", "cpu_seconds", "sine_omega", "loss_samples"):
        if not getattr(options, name) > 0:
            raise PrtnetError(f"train.{name}: found {getattr(options, name)}, expected more than 0")
    for name in ("warmup", "average", "beta2", "resample"):
        if not 0 <= getattr(options, name) < 1:
            raise PrtnetError(f"train.{name}: found {getattr(options, name)}, expected 0 or more, and less than 1")
    for name in ("patience", "loss_gloss", "resample_correction"):
        if not 0 <= getattr(options, name) < inf:
            raise PrtnetError(f"train.{name}: found {getattr(options, name)}, expected 0 or more")
    if options.loss_gloss and options.loss != "radiance":
        raise PrtnetError(
            f"train.loss_gloss: found {options.loss_gloss:g} with train.loss={options.loss}, expected "
            "train.loss=radiance, or 0"
        )
    if options.steps is not None and options.steps < 1:
        raise PrtnetError(f"train.steps: found {options.steps}, expected 1 or more, or null")


def _check_hashes(options: TrainOptions) -> None:
    entries, channels, found = options.hash_entries, options.hash_channels, options.hash_cells
    least, most = HASH_ENTRIES
    if not least <= entries <= most or entries & (entries - 1):
        raise PrtnetError(f"train.hash_entries: found {entries}, expected a power of two from {least} to {most}")
    if channels < 4 or channels % 4:
        raise PrtnetError(f"train.hash_channels: found {channels}, expected a multiple of 4: a texel has four")
    if len(found) > MAX_GRIDS or any(not 1 <= cells <= MAX_HASH_CELLS for cells in found):
        expected = f"at most {MAX_GRIDS} numbers of cells from 1 to {MAX_HASH_CELLS}"
        raise PrtnetError(f"train.hash_cells: found {list(found)}, expected {expected}")


def _check_texels(options: TrainOptions) -> None:
    channels, size = options.texel_channels, options.texel_size
    if channels < 4 or channels % 4:
        raise PrtnetError(f"train.texel_channels: found {channels}, expected a multiple of 4: a texel has four")
    most = MAX_TEXELS * 4 // channels
    if not 0 <= size <= most:
        raise PrtnetError(
            f"train.texel_size: found {size}, expected 0 for none, or at most {most}: no more fits into a texture at"
            f" {channels} channels"
        )


def _check_grids(options: TrainOptions) -> None:
    channels, found = options.grid_channels, options.grid_cells
    if channels < 4 or channels % 4:
        raise PrtnetError(f"train.grid_channels: found {channels}, expected a multiple of 4: a texel has four")
    if len(found) > MAX_GRIDS:
        raise PrtnetError(f"train.grid_cells: found {len(found)} grids, expected at most {MAX_GRIDS}")
    deepest = MAX_SLICES * 4 // channels
    for cells in found:
        if len(cells) != 3 or min(cells) < 1 or max(cells[:2]) > MAX_SLICES or cells[2] > deepest:
            raise PrtnetError(
                f"train.grid_cells: found {list(cells)}, expected [x, y, z], each at least 1, x and y at most"
                f" {MAX_SLICES} and z at most {deepest}: no more fits into a 3D texture at {channels} channels"
            )
