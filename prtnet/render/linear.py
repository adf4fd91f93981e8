"""Methods whose transfer is a weighted sum of a few vectors (`prtnet.models.pca`): weights at texels or at vertices.

A diffuse material needs of each vector what it is under the light, which is found once per light: n multiply-adds per
colour and pixel. Gloss takes the transfer itself, which is put together in the shader. With clusters (Sloan, Hall, Hart
and Snyder 2003) the four texels of a bilinear look-up are each decoded by their own: weights of different clusters have
no mean. The corners of a triangle may be in different clusters as well, since it is colours that are interpolated.
"""

from collections.abc import Sequence
from dataclasses import replace

import moderngl
import numpy as np
from jaxtyping import Float, Float32, Int

from prtnet import PrtnetError, gl
from prtnet.data.atlas import Atlas
from prtnet.data.scene import Scene
from prtnet.data.texture import Page
from prtnet.export import linear as texts
from prtnet.models import pca
from prtnet.models.pca import Linear
from prtnet.render.camera import Camera
from prtnet.render.material import DIFFUSE, Material
from prtnet.render.method import Shaded
from prtnet.render.raster import Group, Raster
from prtnet.render.transfer_map import TransferMap, padded_groups
from prtnet.render.vertex import VertexMethod, pack

Array = np.ndarray

# texture units: 0 to 2 and that of roughness are the raster's and the weights'
TABLE_UNIT, CLUSTER_UNIT = 7, 8


class Table:
    """Means and vectors on the graphics card: under the light for a diffuse material, as they are for gloss.

    Of `groups`, 1 is transfer for all colours, 3 are for red, green and blue, and 4 have the direct one before these.
    """

    def __init__(self, linear: Linear, groups: int, *, glossy: bool):
        self.linear, self.groups, self.glossy = linear, groups, glossy
        self.coefficients = linear.means.shape[1] // groups
        rows = np.concatenate([linear.means[:, None], linear.bases], axis=1)
        # "c e v 4"
        self.values = padded_groups(rows, groups) if glossy else np.zeros((*rows.shape[:2], 4), np.float32)
        self.values = self.values.reshape(*rows.shape[:2], -1, 4)
        self.vectors = self.values.shape[2]
        self._texture = None if texts.in_uniforms(self.values) else gl.upload_table(texts.image(self.values))

    @property
    def text(self) -> str:
        """GLSL: `prtnet.export.linear.decoding`."""
        return texts.decoding(self.values)

    def light(self, light: Float[Array, "k 3"]) -> None:
        """Find what the table is under a light, where it depends on that."""
        if self.glossy:
            return
        self.values[:, :, 0, :3] = pca.lit(self.linear, light, self.coefficients, self.groups)
        if self._texture:
            self._texture.write(texts.image(self.values).tobytes())

    def bind(self, program: moderngl.Program) -> None:
        """Have a program read it."""
        if self._texture:
            self._texture.use(TABLE_UNIT)
            gl.put(program, **{texts.NAME: TABLE_UNIT})
        else:
            gl.put(program, **{texts.NAME: self.values})


class _Looked(Shaded):
    """What both methods do with a light: their table is lit by it, or the shader has it, for gloss."""

    table: Table

    def _light_count(self) -> int:
        return self.material.light_bands**2 if self.material.light_bands else self.table.coefficients

    def set_light(self, light: Float[Array, "k 3"]) -> None:
        """Make a light that of the table, or upload it. Raises PrtnetError where its bands are not as expected."""
        if self.table.glossy:
            super().set_light(light)
            return
        if len(light) != self._light_count():
            raise PrtnetError(f"light: found {len(light)} SH coefficients, expected {self._light_count()}")
        self.table.light(light)


class LinearTextureMethod(_Looked):
    """Weights in textures over the atlas. One cluster is filtered by the hardware, mip levels too."""

    raster: Raster

    def __init__(
        self,
        raster: Raster,
        linear: Linear,
        pages: Sequence[Page],
        *,
        groups: int = 1,
        texels: str = "float32",
        level_of_detail: str = "derivative",
        material: Material = DIFFUSE,
    ):
        # pages: of transfer, with the channels of `linear`; groups: as of `Table`
        self.table = Table(linear, groups, glossy=material.glossy)
        found = [encoded_page(linear, page) for page in pages]
        first = self.table.vectors
        self.map = TransferMap(raster.atlas, [page for page, _ in found], texels, level_of_detail, first=first)
        index = texts.index_bytes(linear.clusters)
        self._clusters = [gl.upload_indices(cluster, index) for _, cluster in found] if index else []
        # bytes on the graphics card: weights, padding included, clusters, means and vectors
        self.bytes = self.map.bytes + linear.bytes + index * sum(cluster.size for _, cluster in found)
        vectors = [f"t{vector}" for vector in range(first)]
        source, statements = self.map.declarations + self.table.text, self.map.statements
        if linear.clusters > 1:
            weight = self.map.fetched("{layer}", "{texel}")
            source += texts.looking_up(linear.elements, first, weight)
            statements = f"linear_look_up(atlas_uv, {', '.join(vectors)})"
        else:
            weights = [f"t{first + layer}" for layer in range(self.map.layers)]
            statements += f"; linear_decode(0, {', '.join([*weights, *vectors])})"
        count = self.table.coefficients
        # Shaded knows one group, or four
        shown = groups if material.glossy else 1
        super().__init__(raster, range(count, count + 1), source, statements, material, shown)

    def _vectors(self) -> list[str]:
        return [f"t{vector}" for vector in range(self.table.vectors + self.map.layers)]

    def _received(self, names: list[str]) -> str:
        return super()._received(names[: self.table.vectors]) if self.table.glossy else "t0.rgb"

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""

        def before(group: Group) -> None:
            self.map.bind(self.program, group.page, camera, self.raster.size)
            if self.table.linear.clusters > 1:
                self._clusters[group.page].use(CLUSTER_UNIT)
                gl.put(self.program, **{texts.CLUSTERS: CLUSTER_UNIT})

        self.table.bind(self.program)
        self.raster.render(self.program, self.draws, camera, prepass=prepass, before=before)


class LinearVertexMethod(_Looked, VertexMethod):
    """Weights at the vertices of a drawn mesh, in a texture as `VertexMethod` keeps transfer."""

    def __init__(
        self,
        drawn: Scene,
        linear: Linear,
        transfer: Float[Array, "v d"],
        size: int,
        *,
        groups: int = 1,
        material: Material = DIFFUSE,
    ):
        self.table = Table(linear, groups, glossy=material.glossy)
        found, count = pca.encode(linear, transfer), self.table.coefficients
        self.layers, self.material, self.groups = gl.layer_count(count), material, groups
        self.raster = Raster(Atlas(drawn, np.zeros((len(transfer), 2), np.float32), "none", float("nan")), size)
        self.coefficients = range(count, count + 1)
        image = pack(found.weights, gl.context().info["GL_MAX_TEXTURE_SIZE"])
        self._weight_layers = gl.layer_count(linear.elements)
        self.texture, self._per_row = gl.upload(image), image.shape[1] // self._weight_layers
        self._cluster = {"in_cluster": found.cluster.astype(np.float32)[:, None]}
        # bytes on the graphics card: weights, padding included, clusters, means and vectors
        self.bytes = (
            16 * self._weight_layers * len(transfer) + linear.bytes + texts.index_bytes(linear.clusters) * len(transfer)
        )
        self._attributes = self._reflected()
        self._prepare()

    def _compile(self, gloss_function: str) -> None:
        super()._compile(gloss_function)
        self.draws = self.raster.draws(self.program, self._attributes | self._cluster)

    def _fetching(self) -> str:
        weights = [f"weight_of_vertex({layer})" for layer in range(self._weight_layers)]
        call = f"linear_decode(int(in_cluster), {', '.join(weights)}"
        text = f"#define WEIGHT_LAYERS {self._weight_layers}\n" + gl.shader("linear_vertex.glsl") + self.table.text
        if not self.table.glossy:
            return text + f"vec3 light_of_vertex() {{ vec4 sum; {call}, sum); return sum.rgb; }}\n"
        outputs = ", ".join(f"linear_found[{vector}]" for vector in range(self.table.vectors))
        found = f"vec4 linear_found[{self.table.vectors}];\nbool linear_ready = false;\n"
        fill = f"if (!linear_ready) {{ {call}, {outputs}); linear_ready = true; }}"
        of_vertex = f"vec4 transfer_of_vertex(int layer) {{ {fill} return linear_found[layer]; }}\n"
        return "#define OWN_TRANSFER\n" + text + found + of_vertex + super()._fetching()

    def render(self, camera: Camera, *, prepass: bool = True) -> None:
        """Draw into the raster's frame without reading it back."""
        self.table.bind(self.program)
        super().render(camera, prepass=prepass)


def encoded_page(linear: Linear, page: Page) -> tuple[Page, Int[Array, "s s"]]:
    """A page of transfer as weights, and the cluster of each texel. Only one cluster has mip levels: a mean of weights
    is the weights of a mean."""
    levels = page.levels if linear.clusters == 1 else page.levels[:1]
    found = [pca.encode(linear, level.reshape(-1, level.shape[2])) for level in levels]
    weights = tuple(each.weights.reshape(*level.shape[:2], -1) for each, level in zip(found, levels, strict=True))
    return replace(page, levels=weights), found[0].cluster.reshape(page.used.shape)


def decoded_page(linear: Linear, page: Page) -> Float32[Array, "s s d"]:
    """The transfer that texels of the first level are decoded to, which a bilinear look-up blends: the plain twin."""
    image = page.levels[0]
    flat = image.reshape(-1, image.shape[2])
    return pca.decode(linear, pca.encode(linear, flat)).reshape(image.shape)
