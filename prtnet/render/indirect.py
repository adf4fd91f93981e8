"""The operator of data-driven transfer on the graphics card: u = M x in a pass of n pixels, and the basis textures that
it weighs (`export.data_driven`, the twin is `prtnet.data_driven`).
"""

import moderngl
import numpy as np
from jaxtyping import Float, Float32

from prtnet import gl
from prtnet.data import quantise
from prtnet.data_driven import DataDriven
from prtnet.export import data_driven as spelt

Array = np.ndarray

# of the texture units: beyond those of albedo, transfer, normal maps, roughness, and the grids of a net
BASIS_UNIT, COEFFICIENT_UNIT = 14, 15
BLOCK_BINDING = 1


class Indirect:
    """Basis textures and matrices of all keyframes, uploaded; the target that u is reduced into, and how a fragment
    shader reads both.

    `held`: where that shader finds u. "uniform" reads the target back, which waits for the driver; "block" copies it
    into a buffer there; "texture" reads it at each pixel.
    """

    def __init__(self, spec: DataDriven, *, texels: str = "float16", held: str = "block"):
        page = spelt.basis_page(spec)
        stored = quantise.encode(page.levels, page.used, texels)
        self.spec, self.held, self.text = spec, held, spelt.indirect(spec, held=held, stored=stored)
        # as a shader reads it, for the twin
        self.basis = quantise.decode(stored)[0]
        self._basis = gl.upload_layers(stored.levels)
        self._matrices = [
            gl.upload_table(spelt.matrix_texels(spec, keyframe)) for keyframe in range(len(spec.measurements))
        ]
        self._scale = spelt.scale_of(spec)
        self._reduce = gl.program(gl.shader("fullscreen.vert.glsl"), spelt.reduce(spec))
        self._target = gl.target(spelt.width(spec), 1)
        self._block = gl.context().buffer(reserve=16 * spelt.width(spec))
        # bytes on the graphics card
        self.bytes = stored.levels[0].nbytes + sum(16 * each.width * each.height for each in self._matrices)

    def reduce(self, direct: moderngl.Texture, keyframe: int = 0) -> None:
        """u of the direct light in a texture, texel j of which, row by row from (0, 0) on, is that of point j."""
        direct.use(0)
        self._matrices[keyframe].use(1)
        gl.put(self._reduce, prt_direct=0, prt_matrix=1)
        gl.fullscreen(self._reduce, self._target)
        if self.held == "block":
            self._target.framebuffer.read_into(self._block, components=4, dtype="f4")

    def set(self, u: Float[Array, "n 3"]) -> None:
        """u that was found elsewhere."""
        row = np.zeros((1, spelt.width(self.spec), 4), np.float32)
        row[0, : len(u), :3] = u / self._scale
        self._target.write(row)
        self._block.write(row.tobytes())

    def coefficients(self) -> Float32[Array, "n 3"]:
        """u, read back."""
        return self._scaled()[: self.spec.elements] * np.float32(self._scale)

    def _scaled(self) -> Float32[Array, "w 3"]:
        return self._target.read()[0, :, :3]

    def bind(self, program: moderngl.Program) -> None:
        """Make both those that `prt_indirect` in a program reads."""
        self._basis.use(BASIS_UNIT)
        gl.put(program, prt_basis=BASIS_UNIT)
        if self.held == "uniform":
            gl.put(program, prt_coefficients=self._scaled())
        elif self.held == "texture":
            texture = self._target.framebuffer.color_attachments[0]
            assert isinstance(texture, moderngl.Texture)
            texture.use(COEFFICIENT_UNIT)
            gl.put(program, prt_coefficients=COEFFICIENT_UNIT)
        else:
            block = program.get(spelt.BLOCK, None)
            assert isinstance(block, moderngl.UniformBlock)
            block.binding = BLOCK_BINDING
            self._block.bind_to_uniform_block(BLOCK_BINDING)
