"""What light becomes at a point, as GLSL on top of `prt_transfer`, to paste below it.

    uniform vec3 prt_light[N];   // SH coefficients of the light, linear RGB
    vec3 prt_shade_diffuse(vec3 position, vec3 normal, vec3 albedo)
    vec3 prt_shade_glossy(vec3 position, vec3 normal, vec3 view, vec3 albedo, vec3 specular, float exponent)

`view` is the unit direction from the point to the eye. Both give linear radiance towards it; the glossy one is the
diffuse one and `specular` times a normalised Phong lobe on the full triple product (`prtnet.export.gloss`), for any
light and exponent. With four groups the diffuse part takes the light between surfaces, the lobe the direct transfer.
"""

import math

from prtnet import sh
from prtnet.export import gloss, glsl
from prtnet.export.spelling import component, number, quads
from prtnet.netspec import NetSpec

LIGHT = "prt_light"


def has_gloss(net: NetSpec) -> bool:
    """Whether the product of the net's bands is short enough for a shader."""
    return net.bands <= gloss.MAX_BANDS


def light_declaration(net: NetSpec) -> str:
    """The uniform, one coefficient each."""
    return f"uniform highp vec3 {LIGHT}[{sh.count(net.bands)}];"


def functions(net: NetSpec) -> str:
    """The light and both functions; the diffuse one alone above `gloss.MAX_BANDS`."""
    lines = [light_declaration(net), _received(net)]
    found, names = _transfer(net), _names(net)
    lines += [_function("prt_shade_diffuse", net, ["vec3 albedo"], [*found, f"return {_diffuse(names)};"])]
    if has_gloss(net):
        # one text for all exponents
        lines += [gloss.full(net.bands, coefficient=lambda j: f"{LIGHT}[{j}]")]
        direct = ", ".join(names[: quads(sh.count(net.bands))])
        taken = f"specular * prt_gloss(reflect(-view, normal), exponent, {direct})"
        surface = ["vec3 view", "vec3 albedo", "vec3 specular", "float exponent"]
        lines += [_function("prt_shade_glossy", net, surface, [*found, f"return {_diffuse(names)} + {taken};"])]
    return "\n".join(lines)


def around(net: NetSpec, source: str, *, glossy: bool = False) -> str:
    """Shader text about `source`, which has the function, without a version line: radiance at the point of a pixel.

    Reads textures `positions` and `normals`, and uniforms `albedo` and, with gloss, `eye`, `specular` and `exponent`.
    """
    uniforms, surface = ["vec3 albedo"], ["albedo"]
    if glossy:
        uniforms += ["vec3 eye", "vec3 specular", "float exponent"]
        surface = ["normalize(eye - position)", "albedo", "specular", "exponent"]
    name = "prt_shade_glossy" if glossy else "prt_shade_diffuse"
    lines = [*glsl.point(net), *(f"uniform {each};" for each in uniforms), "out vec4 colour;", source, "void main() {"]
    call = f"{name}({', '.join([*glsl.inputs(net), *surface])})"
    lines += [*glsl.at_pixel(net), f"  colour = vec4({call}, 1.0);"]
    return "\n".join(lines) + "\n}\n"


def diffuse_on_irradiance(net: NetSpec) -> str:
    """prt_shade_diffuse where there is prt_irradiance (`prtnet.export.fold`) and no prt_transfer."""
    body = [f"return {number(1 / math.pi)} * albedo * prt_irradiance({', '.join(glsl.inputs(net))});"]
    return _function("prt_shade_diffuse", net, ["vec3 albedo"], body)


def _names(net: NetSpec) -> list[str]:
    return [f"t{i}" for i in range(glsl.vectors(net))]


def _transfer(net: NetSpec) -> list[str]:
    names = _names(net)
    return [f"vec4 {', '.join(names)};", f"prt_transfer({', '.join([*glsl.inputs(net), *names])});"]


def _diffuse(names: list[str]) -> str:
    return f"{number(1 / math.pi)} * albedo * prt_received({', '.join(names)})"


def _received(net: NetSpec) -> str:
    """Irradiance: sum t_i L_i per colour."""
    each, layers = sh.count(net.bands), quads(sh.count(net.bands))
    lines = ["vec3 sum = vec3(0.0);"]
    for i in range(each):
        found = component("t", i)
        if net.groups > 1:
            found = f"vec3({', '.join(component('t', 4 * layers * group + i) for group in (1, 2, 3))})"
        lines.append(f"sum += {LIGHT}[{i}] * {found};")
    arguments = ", ".join(f"vec4 {name}" for name in _names(net))
    return "\n  ".join([f"vec3 prt_received({arguments}) {{", *lines, "return sum;"]) + "\n}\n"


def _function(name: str, net: NetSpec, surface: list[str], body: list[str]) -> str:
    head = f"vec3 {name}({glsl.parameters(net)}, {', '.join(surface)}) {{"
    return "\n  ".join([head, *body]) + "\n}\n"
