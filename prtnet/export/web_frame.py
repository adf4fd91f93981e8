"""What all web pages of prtnet have in common: one HTML file, its policy, its modules as one script, its blocks.

A page asks for nothing over the network and says so to the browser (a content security policy). All arrays are base64
of gzip (`prtnet.export.packing`), everything else is JSON or HTML in which nothing of a scene's own words can be code.
"""

import base64
import hashlib
import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from prtnet import PrtnetError
from prtnet.export.packing import Block

FOLDER = Path(__file__).parent / "web"
# of every page, before its own; each after those it imports from
SHARED = (
    "unpack", "scene", "sh", "ball", "camera", "pointer", "device", "shaders", "notice", "graphics", "mesh", "frames",
    "panel",
)  # fmt: skip


@dataclass(frozen=True)
class Look:
    """What the page shows first. The camera is in unit coordinates, its field of view in degrees."""

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float = 40.0
    diffuse: float = 1.0
    specular: float = 0.0
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)  # of what is specular
    exponent: float = 20.0


@dataclass(frozen=True)
class Certificate:
    """What a browser measured of the page's net, or why none did."""

    measured: Mapping[str, Any] | None = None
    reason: str = "no browser was there"
    notes: Sequence[str] = field(default_factory=tuple)


@dataclass(frozen=True)
class Words:
    """What a page says of itself, as plain text."""

    title: str
    lead: str
    # the two that the bar parts
    left: str
    right: str
    notes: Sequence[str]


def document(
    kind: str, modules: Sequence[str], words: Words, about: Mapping[str, Any], blocks: Mapping[str, Block]
) -> str:
    """The HTML. `kind` names the form and the keys of the page, `modules` its script."""
    about = {**about, "blocks": {name: block.about() for name, block in blocks.items()}}
    return _assembled(
        form=_filled(_text(f"{kind}_form.html"), other=words.right, Other=words.right.capitalize()),
        keys=_filled(_text(f"{kind}_keys.html"), other=words.right),
        title=html.escape(words.title),
        left=html.escape(words.left),
        right=html.escape(words.right),
        lead=html.escape(words.lead),
        notes="".join(f"<li>{html.escape(note)}</li>" for note in words.notes),
        about=as_json(about),
        blocks="\n".join(_element(name, block) for name, block in blocks.items()),
        style=_text("page.css"),
        script=script(modules),
    )


def as_json(values: Any) -> str:
    """JSON that may stand in a script element: no `<` can end it, whatever the words are."""
    text = json.dumps(values, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _element(name: str, block: Block) -> str:
    return f'<script type="application/octet-stream;base64" id="data-{name}">{block.text()}</script>'


def _text(name: str) -> str:
    return (FOLDER / name).read_text(encoding="utf-8")


def script(modules: Sequence[str]) -> str:
    """The modules as one: without their imports and exports, each after those it needs."""
    texts = [_text(f"{name}.js") for name in modules]
    whole = "\n".join(re.sub(r"^import [^;]*;\n", "", text, flags=re.MULTILINE) for text in texts)
    return re.sub(r"^export ", "", whole, flags=re.MULTILINE)


def _filled(text: str, **parts: str) -> str:
    """A piece of HTML with words of prtnet's own."""
    return re.sub(r"\{\{(\w+)\}\}", lambda match: html.escape(parts[match[1]]), text)


def _assembled(**parts: str) -> str:
    """The page with its parts in place; what stands in a part is never looked at again."""
    for name in ("script", "style"):
        parts[f"{name}_hash"] = _policy_hash(parts[name])
    text = _text("page.html")
    unknown = set(re.findall(r"\{\{(\w+)\}\}", text)) ^ parts.keys()
    if unknown:
        raise PrtnetError(
            f"page.html: found {', '.join(sorted(unknown))} on one side only, expected all parts in place"
        )
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], text)


def _policy_hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
