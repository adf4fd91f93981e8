"""The README's commands are run, at a size that takes seconds."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.small import SETTINGS

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
COMMANDS = [
    line.split("#")[0].strip()
    for block in re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    for line in block.splitlines()
    if line.strip()
]
SMALLER = {key: value for key, value in SETTINGS.items() if key != "scene.name"} | {
    "render.size": 48,
    "atlas.size": 256,
}


def stand_ins(folder: Path) -> None:
    """The files that the README's examples name."""
    import numpy as np
    import OpenImageIO as oiio
    import trimesh

    box = trimesh.creation.box((1, 2, 1))
    varnished = box.copy()
    varnished.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(roughnessFactor=0.4))
    varnished.export(folder / "model.glb")
    (folder / "folder_of_parts").mkdir()
    box.export(folder / "folder_of_parts" / "box.obj")
    image = oiio.ImageBuf(np.ones((8, 16, 3), np.float32))
    assert image.write(str(folder / "studio.hdr")), image.geterror()
    (surface,) = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
    (folder / "bowl.yaml").write_text(surface, encoding="utf-8")
    (folder / "six_faces").mkdir()
    for name in ("px", "nx", "py", "ny", "pz", "nz"):
        image = oiio.ImageBuf(np.ones((8, 8, 3), np.float32))
        assert image.write(str(folder / "six_faces" / f"{name}.hdr")), image.geterror()


def small(command: str) -> list[str]:
    """The command with fewer of everything; what the README varies stays."""
    given = shlex.split(command)[1:]
    named = {argument.split("=")[0] for argument in given}
    sizes = [f"{key}={value}" for key, value in SMALLER.items() if key not in named]
    sizes += ["samples.count=2000"] if "samples.count" in named else []
    # what a net of a few steps can reach
    sizes += ["size.target_psnr=10"] if "size.target_psnr" in named else []
    sizes += ["size.widths=[8]"] if any(name.startswith("size.") for name in named) else []
    sizes += ["export.web_texture=null"] if "export=web" in given else []
    if any(name in command for name in ("sdf_", "neural_sdf", ".yaml")):
        sizes += ["sdf.resolution=48", "sdf.width=32", "sdf.steps=400", "sdf.largest_error=1"]
    if "method=data_driven" in given:
        few = {"configurations": 24, "unseen": 4, "points": 32, "size": 64, "directions": 16, "samples": 4}
        sizes += [f"data_driven.{key}={value}" for key, value in few.items()] + ["data_driven.tested_lights=1"]
    # whose charts fit into no fewer texels, and whose cells have more points than networks have weights
    if "scene=colonnade" in given:
        sizes = [word for word in sizes if not word.startswith("atlas.")] + ["atlas.size=512", "samples.count=40000"]
    return given + sizes + ["scene.tessellation=0.2"]


def left(command: str) -> set[str]:
    """Files that each of its runs leaves."""
    given = shlex.split(command)[1:]
    stages = next((argument for argument in given if argument.startswith("stages=")), "stages=[score]")
    names = {"report.html": "score" in stages, "page.html": "export=web" in given}
    names |= {"data_driven.html": "method=data_driven" in given}
    return {name for name, there in names.items() if there}


def test_the_readme_names_the_two_commands():
    script = (ROOT / "run").read_text(encoding="utf-8")
    for name in ("demo", "test", "check", "cluster-test", "gpu-check", "prtnet"):
        assert re.search(rf"^{name}\)$", script, re.MULTILINE)
    assert COMMANDS[:2] == ["./run demo", "./run test"]


@pytest.mark.parametrize("command", [line for line in COMMANDS if line.startswith("prtnet")])
def test_commands_do_what_they_say(command, tmp_path):
    if "cluster=slurm" in command:
        pytest.skip("needs a SLURM: ./run cluster-test starts one for such commands")
    stand_ins(tmp_path)
    arguments = [sys.executable, "-m", "prtnet", *small(command)]
    done = subprocess.run(arguments, cwd=tmp_path, capture_output=True, text=True, timeout=400, check=False)
    assert done.returncode == 0, done.stderr
    points = 1
    for argument in shlex.split(command):
        points *= len(argument.split(",")) if "-m" in command and "=" in argument and "[" not in argument else 1
    assert left(command)
    for name in left(command):
        assert len(list((tmp_path / "runs").rglob(name))) == points, name


def headings(text: str) -> set[str]:
    """What links call the headings of a page."""
    found = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", each.lower()).strip().replace(" ", "-") for each in found}


@pytest.mark.parametrize("page", ["README.md", *sorted(f"docs/{file.name}" for file in (ROOT / "docs").glob("*.md"))])
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)]+)\)", (ROOT / page).read_text(encoding="utf-8")):
        if re.match(r"https?://", link):
            continue
        name, _, heading = link.partition("#")
        file = (ROOT / page).parent / name if name else ROOT / page
        assert file.exists(), link
        assert not heading or heading in headings(file.read_text(encoding="utf-8")), link


def test_the_keys_of_the_table_exist_with_their_defaults():
    from omegaconf import OmegaConf

    from prtnet.config import Config

    config = OmegaConf.structured(Config)
    for keys, values in re.findall(r"^\| (`[a-z_.`, ]+`) \| ([\d, ]+) \|", README, re.MULTILINE):
        found = [OmegaConf.select(config, key.strip(" `")) for key in keys.split(",")]
        expected = [int(value.replace(" ", "")) for value in values.split(",")]
        assert found == expected, keys
