"""All shader files of a net in one form.

transfer.glsl         prt_transfer, to paste
transfer.frag         the same as a whole fragment shader
shading.glsl          prt_shade_diffuse and prt_shade_glossy, to paste below transfer.glsl
shading.frag          both as a whole fragment shader
irradiance.glsl       prt_irradiance and prt_shade_diffuse on it, in place of the others; where light can be folded
irradiance.frag       the same as a whole fragment shader
transfer_weights.bin  the weights of a texture or of uniform blocks: little-endian floats of 32 or 16 bits, row by
                      row from the texel (0, 0) on, or block by block
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prtnet.export import fold, form, glsl, limits, shading, uniform_block, weight_texture
from prtnet.export.form import Form
from prtnet.export.limits import Limits
from prtnet.netspec import NetSpec

Array = np.ndarray

WEIGHTS = "transfer_weights.bin"
NAMES = (
    "transfer.glsl", "transfer.frag", "shading.glsl", "shading.frag", "irradiance.glsl", "irradiance.frag", WEIGHTS,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Bundle:
    form: Form
    # with its weights as the form has them: what the shaders compute
    net: NetSpec
    transfer: str
    shading: str
    # where the output is linear
    irradiance: str | None
    # of storage texture: the image
    weights: Float[Array, "h w 4"] | None
    files: dict[str, bytes]


def bundle(net: NetSpec, wanted: Form, target: Limits | None = None) -> Bundle:
    """Raises PrtnetError where `target`, the least that the version promises unless given, cannot hold a shader."""
    target = target or limits.MINIMUM[wanted.version]
    chosen = wanted.of(net)
    transfer, functions = glsl.transfer(net, chosen, target), shading.functions(net)
    irradiance = None
    if fold.can_fold(net):
        irradiance = fold.irradiance(net, chosen, target) + shading.diffuse_on_irradiance(net)
    texts = {
        "transfer.glsl": transfer,
        "transfer.frag": glsl.whole(chosen.version, glsl.around(net, transfer)),
        "shading.glsl": functions,
        "shading.frag": glsl.whole(chosen.version, shaded(net, transfer + functions)),
    }
    if irradiance:
        texts["irradiance.glsl"] = irradiance
        texts["irradiance.frag"] = glsl.whole(chosen.version, shading.around(net, irradiance))
    files = {name: text.encode() for name, text in texts.items()}
    rounded = form.rounded(net, chosen)
    image = weight_texture.texels(rounded, chosen.precision) if chosen.storage == "texture" else None
    if image is not None:
        files[WEIGHTS] = image.tobytes()
    elif chosen.storage == "ubo":
        files[WEIGHTS] = b"".join(each.tobytes() for each in uniform_block.blocks(net, target.block_bytes))
    return Bundle(chosen, rounded, transfer, functions, irradiance, image, files)


def shaded(net: NetSpec, source: str) -> str:
    """The fragment shader about both shading functions, without a version line."""
    return shading.around(net, source, glossy=shading.has_gloss(net))


def validate(made: Bundle) -> bool:
    """Whether glslangValidator is there and takes the whole fragment shaders. Raises PrtnetError where it does not."""
    fragments = [text.decode() for name, text in made.files.items() if name.endswith(".frag")]
    return all([glsl.validate(each) is not None for each in fragments])
