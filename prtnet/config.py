"""Every key of a job, its type, its default and its meaning. `configs/` holds the named choices.

The command line and the pipeline see these classes; everything below them takes arrays and plain keywords.
"""

from dataclasses import dataclass, field
from typing import Any

from hydra.core.config_store import ConfigStore

from prtnet.data.analytic_light import AnalyticOptions
from prtnet.models.recipe import ModelOptions, TrainOptions

STAGES = ("bake", "size", "train", "export", "score", "view")
METHODS = ("texture", "vertex", "net", "clusters", "lit_texture", "unshadowed", "pca", "cpca", "data_driven")


@dataclass
class SceneOptions:
    name: str = "plants"  # a built-in scene; the name in tables when `path` is given is that of the file
    path: str | None = None  # a mesh file, or a folder of parts: OBJ, PLY, STL, OFF, glTF, GLB
    tessellation: float = 1.0  # built-in scenes: subdivision along each axis, relative
    seed: int = 0  # built-in scenes: placement of leaves, strips, books
    two_sided: str = "auto"  # files: auto = the file's word, else parts that are not closed; all; none
    without: list[str] = field(default_factory=list)  # files: names of parts to leave out, a sea around an island, say
    normal_maps: Any = None  # files: {part: image} of tangent-space normals, where the file has none or others
    camera: str = "auto"  # orbit, inside, or auto = the scene's own word, else by rays from its middle


@dataclass
class SdfOptions:
    """Of implicit surfaces, which have no triangles: the scenes sdf_..., and .py or .yaml files as scene.path."""

    resolution: int = 256  # cells along the longest side of the mesh that points are drawn from and rays are traced by
    # scene=neural_sdf: the network that is fitted to the signed distance of the mesh scene.path
    width: int = 64  # neurons of each hidden layer
    depth: int = 2  # hidden layers
    steps: int = 6000
    seed: int = 0  # of its weights and points
    largest_error: float = 0.05  # of its surface, as a share of the mesh's longest side; a fit above it is refused


@dataclass
class LightOptions(AnalyticOptions):
    name: str = "sky"  # by formula: sky, constant, gradient, sun, directional, green, each with its own keys
    path: str | None = None  # or a probe, EXR or HDR, linear radiance; or a folder of cube faces px nx py ny pz nz
    mapping: str = (
        "auto"  # of the probe: lat_long, angular, cross, faces; auto = by shape: 2:1, 1:1, 4:3 or 3:4, folder
    )
    rotation: float = 0.0  # degrees about y, from +z towards +x: counter-clockwise seen from above
    window: str = "none"  # against ringing: hann, lanczos
    window_size: float | None = None  # bands from which on the window is 0; as many as the light has when left out


@dataclass
class MaterialOptions:
    diffuse: float = 1.0  # weight of the diffuse part
    specular: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])  # linear RGB weight of the Phong lobe
    exponent: float = 20.0  # of the Phong lobe, above 0
    product: str = "fixed_light"  # triple product with the light's matrix in the shader, or full: any light
    # parts of the scene that reflect otherwise: name -> any of diffuse, specular, exponent; +material.parts.NAME.KEY=
    parts: dict[str, dict[str, Any]] = field(default_factory=dict)
    roughness: str = "config"  # exponents as above; file: by the file's roughness where it has one, 2 / r^4 - 2
    light_bands: int | None = None  # SH bands of the light; transfer.bands when left out
    radiance_bands: int | None = None  # of what is reflected, at most transfer.bands + light_bands - 1; transfer.bands


@dataclass
class TransferOptions:
    bands: int = 5  # SH bands; 5 -> 25 coefficients, 4 -> 16
    directions: int = 512  # rays per point
    kind: str = "cosine_fibonacci"  # or uniform, stratified, random
    transport: str = "shadowed"  # unshadowed = the cosine lobe of the normal; interreflected = and bounces
    bounces: int = 1  # diffuse ones, where transport=interreflected
    # fused, embreex, or auto = fused where it can be had, said in the log. What is learned from on implicit surfaces is
    # traced through the surface itself, as references always are, with marched or auto; fused and embreex, and auto for
    # neural_sdf, trace a fine mesh of it: quicker, with an error that the report tells
    tracer: str = "auto"


@dataclass
class ClusterOptions:
    """Of the engine that runs independent parts of a run: shards of a bake, networks of a split scene, sweep points.

    It changes no result.
    """

    # process = one part after the other, here; cores = over those of this machine; slurm = as jobs, by submitit
    engine: str = "process"
    workers: int = -1  # parts at a time; -1 = as many as this machine has cores
    least_shards: int = 2  # of a bake, for each worker: a shard is a second or two of rays
    retries: int = 2  # of a part that was killed or preempted, or ran out of time
    folder: str = "runs/jobs"  # of logs; on SLURM the nodes have to share it, as they do out= and cache=
    # of each SLURM job
    partition: str | None = None  # SLURM's own default when left out
    minutes: int = 120
    memory: int | None = None  # GB; SLURM's own default when left out
    cpus: int = 2


@dataclass
class SamplesOptions:
    count: int = 1_600_000  # area-uniform training points
    directions: int | None = 128  # rays per training point; transfer.directions, as texels have, when left out
    sequence: str = "r2"  # low-discrepancy, or random
    test_count: int = 20_000  # independent points that are never trained on


@dataclass
class AtlasOptions:
    size: int = 1024  # texels along one side
    single_chart: bool = False  # one chart for both sides of a two-sided face: wrong on leaves, on purpose
    dilation: int = 3  # texels that each chart grows by
    format: str = "float32"  # of a coefficient: float32, float16, or uint8 from its own least to its own greatest value
    mipmaps: bool = False  # levels of half the side, as many as the padding keeps charts apart on
    level_of_detail: str = "derivative"  # of mipmaps: of the texture coordinate by pixels, or distance to the eye
    padding: int | None = None  # texels around each chart; 2^n for n mip levels; 1, or 4 with mipmaps, when left out
    sets: str = "one"  # texture for the whole scene, or parts: one for each, with size^2 texels together
    unwrap: str = "auto"  # by xatlas where the file's coordinates are absent or overlap, or never: they are refused
    memory_limit: float = 8.0  # GiB of the textures without mip levels


@dataclass
class VertexOptions:
    subdivide: list[str] = field(default_factory=list)  # names of parts whose triangles are cut, the ground, say
    level: int = 4  # of these cuts: each makes 4 triangles of one


@dataclass
class RenderOptions:
    size: int = 256  # pixels along one side
    views: int = 8  # uniform on the scene's camera path
    traced_directions: int = 4096  # rays per pixel of the reference
    exact_samples: int = 0  # directions per pixel of a second reference without SH; 0 = none
    exact_views: int = 2  # that have one
    net: str = "auto"  # what draws it: its shader, deferred (the CPU), or auto = the CPU above 60 000 multiply-adds
    # of the pictures that are shown, never of what is scored
    tone: str = "linear"  # or the curves reinhard, exposure
    bloom: float = 0.0  # share of the light above white that spreads, 0 to 1
    highlights: float = 0.0  # weight of the light mirrored in every surface
    pictures: bool = False  # write the first view of each method to pictures/; the three above do it as well


@dataclass
class ExportOptions:
    """Of the network's shaders, and what is written beside them."""

    # weights as literal, texture or ubo (uniform blocks, validated and not run); auto = literal up to 20 000 padded
    # multiply-adds, above that texture
    storage: str = "auto"
    version: str = "330"  # of GLSL: 330, 430, "300 es"
    precision: str = "float32"  # of weights and biases, or float16
    digits: int = 9  # of literals, 4 to 9; 9 say every float32
    cuda: bool = False  # transfer.cu, the network as CUDA kernels, and transfer_cuda.bin, the numbers they read
    lightmap: bool = False  # lightmap.glb for engines, with the run's light baked in, its images beside it
    web: bool = False  # the run as one HTML file as well, page.html
    web_texture: int | None = 512  # texels along one side of its texture; atlas.size when left out


@dataclass
class SizeOptions:
    """Of the stage size: the cheapest network that meets the target within the budgets, or the best within them."""

    target_psnr: float | None = None  # dB against traced, with the material and light of the job
    view: str = "mean"  # of the views that has to meet it, or worst
    max_macs: int | None = None  # multiply-adds per pixel, shading included, as in the table of scores
    max_bytes: int | None = None  # of the net
    cost: str = "macs"  # what makes one cheaper than another, or bytes; the other where they are equal
    # the space: all of these, with the recipe of the job; depth 0 has no width
    widths: list[int] = field(default_factory=lambda: [8, 16, 24, 32, 48, 64])
    depths: list[int] = field(default_factory=lambda: [0, 1, 2, 4])
    grids: list[str] = field(default_factory=lambda: ["none", "recipe"])  # of the recipe, all; or dense: without hashed


@dataclass
class SplitOptions:
    """Of the method clusters: the scene in clusters with a network each, all of the size and recipe of the job's."""

    by: str = "none"  # grid: equal cells of the scene's box; parts: the file's own; count: so many of the same area
    cells: list[int] = field(default_factory=lambda: [2, 1, 2])  # of grid: along x, y, z
    count: int = 4  # of count
    # half the width of the blend at a border, in unit lengths (the scene is 2 long); points within it train both sides
    delta: float = 0.04
    # neighbours whose transfer is alike are merged until so many networks are left, or until the next merge would raise
    # the variance of the transfer within clusters by more than this share of the total; neither: nothing is merged
    networks: int | None = None
    quality: float | None = None
    # features of a network's grids, as a share of those of the recipe: 0.25 in 4 clusters makes as many as one net has
    grid_scale: float = 1.0
    size: bool = False  # each the smallest that meets size.target_psnr in its own pixels; so does the stage size
    border: str = "clip"  # triangles across a border are cut there, or assign: drawn by the cluster of their middle
    select: str = "draw"  # a shader for each cluster, or fragment: one whose weights are looked up in a texture


@dataclass
class DataDrivenOptions:
    """Of the method data_driven: light between surfaces by an operator that is learned from random lights."""

    # kinds of lights that a configuration is drawn from in turns: point, spot, directional, environment
    scenario: list[str] = field(default_factory=lambda: ["spot"])
    # lamps of one's own, unseen ones, that pictures are drawn under: [{kind: point, position: [x, y, z], colour: [r, g,
    # b]}, {kind: spot, aim: [x, y, z], inner: DEGREES, outer: DEGREES, ...}, ...], in unit coordinates (2 long)
    lights: list[dict[str, Any]] = field(default_factory=list)
    colours: str = "white"  # of lights, or random
    configurations: int = 128  # to learn from, for each keyframe
    unseen: int = 16  # others of the same scenario, or of `lit_by`, that errors are measured under
    lit_by: list[str] = field(default_factory=list)  # the scenario of those; the same where none is named
    points: int = 256  # where direct light is measured
    supersampling: int = 8  # surface points that each of them is the mean of
    place: str = "surface"  # of the points, or hull: a smooth one around the scene, for hair and foliage
    elements: int = 16  # of the basis
    ridge: float = 0.01  # lambda, with direct vectors of unit length
    channels: str = "shared"  # one basis for all colours, or separate
    gamma: float = 1.0  # of the space it is learned in: 1 is linear, 2.2 that of displays
    renderer: str = "bounces"  # between diffuse surfaces; or subsurface, by Mitsuba (the extra paths)
    size: int = 256  # texels along one side of the lightmaps
    directions: int = 512  # rays per texel and bounce; of Mitsuba, samples per texel
    bounces: int = 4
    density: float = 20.0  # subsurface: extinction per unit length of the medium inside; the scene is 2 long
    # poses of an animated part: [{part: NAME, move: [x, y, z], turn: DEGREES about y through its middle}, ...]
    keyframes: list[dict[str, Any]] = field(default_factory=list)
    matrices: str = "each"  # keyframe has a matrix of its own, or one for all
    tested_views: int = 2  # that are drawn
    tested_lights: int = 4  # of the unseen configurations that views are drawn under
    samples: int = 512  # paths per pixel of their reference


@dataclass
class LinearOptions:
    """Of the methods pca and cpca: SH transfer as a weighted sum of a few vectors."""

    store: str = "texel"  # where weights are kept, or vertex
    elements: int = 8  # vectors, of each cluster with cpca
    clusters: int = 32  # of cpca
    size: int | None = None  # texels along one side of the weights; atlas.size when left out
    bytes: str = "free"  # or net or texture: size and elements are the best that take no more than these do


@dataclass
class Config:
    scene: SceneOptions = field(default_factory=SceneOptions)
    sdf: SdfOptions = field(default_factory=SdfOptions)
    light: LightOptions = field(default_factory=LightOptions)
    material: MaterialOptions = field(default_factory=MaterialOptions)
    transfer: TransferOptions = field(default_factory=TransferOptions)
    samples: SamplesOptions = field(default_factory=SamplesOptions)
    atlas: AtlasOptions = field(default_factory=AtlasOptions)
    vertex: VertexOptions = field(default_factory=VertexOptions)
    model: ModelOptions = field(default_factory=ModelOptions)
    train: TrainOptions = field(default_factory=TrainOptions)
    render: RenderOptions = field(default_factory=RenderOptions)
    export: ExportOptions = field(default_factory=ExportOptions)
    size: SizeOptions = field(default_factory=SizeOptions)
    split: SplitOptions = field(default_factory=SplitOptions)
    data_driven: DataDrivenOptions = field(default_factory=DataDrivenOptions)
    linear: LinearOptions = field(default_factory=LinearOptions)
    # bake, size, train, export, score: up to the last one named is made where missing; size only where it is named;
    # view, a window, needs what export does
    stages: list[str] = field(default_factory=lambda: [stage for stage in STAGES if stage not in ("size", "view")])
    # texture, vertex, net, clusters (of a split scene), unshadowed (the lobe of the normal alone), lit_texture (with
    # bounces), pca and cpca (of the transfer of texels or vertices), data_driven (also by itself); none named: the
    # first three, and on implicit surfaces, which have no atlas and no vertices, unshadowed and net
    methods: list[str] = field(default_factory=list)
    out: str | None = None  # the run folder; runs/<scene> when left out
    cache: str | None = None  # artifacts, shared by the runs that name it; <out>/cache when left out
    device: str = "auto"  # of training: cpu, cuda, or auto = cuda where torch sees one
    threads: int | None = None  # of ray tracing; all cores when left out
    cluster: ClusterOptions = field(default_factory=ClusterOptions)
    seed: int = 0  # of points and rays; scene.seed and train.seed are their own


def register() -> None:
    """Make the schema known to Hydra under the name that configs/config.yaml refers to."""
    schema: Any = Config
    ConfigStore.instance().store(name="schema", node=schema)
