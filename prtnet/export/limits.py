"""What a target can hold of an exported shader, and what a shader needs.

The figures are the least that each specification lets a driver have: OpenGL 3.3 core (tables 6.40 to 6.46), OpenGL 4.3
core (tables 23.53 to 23.64) and OpenGL ES 3.0 (tables 6.28 to 6.34), which WebGL 2 takes over. `of_driver` reads those
of the driver at hand. No specification bounds the length of a shader; ours keeps texts out that nobody would wait for.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from prtnet import PrtnetError

SOURCE_BYTES = 4 << 20


@dataclass(frozen=True)
class Limits:
    """Of a fragment shader and what is bound to it."""

    name: str
    block_bytes: int  # of a uniform block
    blocks: int
    components: int  # floats of uniforms outside of blocks
    texture_side: int  # texels, 2D
    volume_side: int  # texels, 3D
    samplers: int
    source_bytes: int = SOURCE_BYTES


@dataclass(frozen=True)
class Needs:
    """Of an exported shader, in the same units."""

    source_bytes: int
    block_bytes: int = 0  # the largest
    blocks: int = 0
    components: int = 0
    weight_side: int = 0  # of the weight texture, the longer one
    texture_side: int = 0  # of other textures
    volume_side: int = 0
    samplers: int = 0


MINIMUM = {
    "330": Limits("OpenGL 3.3", 16_384, 12, 1024, 1024, 256, 16),
    "430": Limits("OpenGL 4.3", 16_384, 14, 1024, 16_384, 2048, 16),
    "300 es": Limits("WebGL 2", 16_384, 12, 896, 2048, 256, 16),
}


def of_driver(info: Mapping[str, object]) -> Limits:
    """From a driver's answers under their OpenGL names, as moderngl's `Context.info` has them."""

    def found(name: str) -> int:
        value = info[name]
        assert isinstance(value, int), name
        return value

    return Limits(
        str(info["GL_RENDERER"]),
        found("GL_MAX_UNIFORM_BLOCK_SIZE"),
        found("GL_MAX_FRAGMENT_UNIFORM_BLOCKS"),
        found("GL_MAX_FRAGMENT_UNIFORM_COMPONENTS"),
        found("GL_MAX_TEXTURE_SIZE"),
        found("GL_MAX_3D_TEXTURE_SIZE"),
        found("GL_MAX_TEXTURE_IMAGE_UNITS"),
    )


def check(needs: Needs, limits: Limits) -> None:
    """Raises PrtnetError for the first thing of which the shader needs more than the target has to have."""
    smaller, features = "a smaller model.width", "smaller train.hash_entries or train.texel_size"
    rows = (
        ("bytes of source", needs.source_bytes, limits.source_bytes, "export.storage=texture"),
        ("bytes in a uniform block", needs.block_bytes, limits.block_bytes, f"export.storage=texture, or {smaller}"),
        ("uniform blocks", needs.blocks, limits.blocks, f"export.storage=texture, or {smaller}"),
        ("uniform components", needs.components, limits.components, f"fewer transfer.bands, or {smaller}"),
        ("texels along a side of the weight texture", needs.weight_side, limits.texture_side, smaller),
        ("texels along a side of a texture", needs.texture_side, limits.texture_side, features),
        ("texels along a side of a 3D texture", needs.volume_side, limits.volume_side, "smaller train.grid_cells"),
        ("samplers", needs.samplers, limits.samplers, "fewer of train.grid_cells and train.hash_cells"),
    )
    for what, found, most, instead in rows:
        if found > most:
            raise PrtnetError(
                f"GLSL export: found {found} {what}, expected at most {most}, the limit of {limits.name};"
                f" choose {instead}"
            )
