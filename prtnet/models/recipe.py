"""What a network is and how it is trained, as plain values: no torch here, so that the command line stays quick."""

from dataclasses import dataclass


@dataclass
class ModelOptions:
    width: int = 64  # neurons of a hidden layer
    depth: int = 4  # hidden layers; the output layer comes on top


@dataclass
class TrainOptions:
    """The published recipe: Sirikonda et al. 2022, *Learnt Transfer*. `configs/train/` holds this and the default one."""

    recipe: str = "published"  # name in tables
    activation: str = "leaky_relu"  # leaky_relu, gelu, silu
    output: str = "tanh"  # tanh, linear
    residual: bool = False  # learn the difference to the unoccluded cosine lobe
    position_frequencies: int = 10
    normal_frequencies: int = 4
    loss: str = "l1"  # l1, l2, huber
    huber_delta: float = 0.02  # in units of transfer / pi
    optimiser: str = "adam"
    learning_rate: float = 1e-3
    schedule: str = "constant"  # constant, cosine, one_cycle
    batch: int = 8192
    steps: int | None = None  # fixed number of steps; when left out, cpu_seconds says
    cpu_seconds: float = 90.0  # turned into steps by a calibration that is kept with the run
    precision: str = "auto"  # float32, bfloat16, or auto = the quicker one on this machine
    checkpoint_seconds: float = 20.0
    seed: int = 0
