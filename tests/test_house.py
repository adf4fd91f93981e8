"""The house: data flows one way, and the command line stays light."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "prtnet"

# a module may import what stands in its own row or above
ROWS = [
    {"__init__", "sh", "encoding", "netspec", "clusters", "data_driven", "store", "gl", "console"},
    {"data"},
    {"models", "export"},
    {"render"},
    {"score", "seam"},
    {"size"},
    {"view"},
    {"chart"},
    {"config"},
    {"pipeline"},
    {"cli", "__main__"},
]
RANK = {name: rank for rank, row in enumerate(ROWS) for name in row}


def imports(file: Path) -> set[str]:
    """Modules that a file imports, anywhere in it, as dotted names."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def room(file: Path) -> str:
    return file.relative_to(PACKAGE).with_suffix("").parts[0]


FILES = sorted(PACKAGE.rglob("*.py"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_imports_flow_one_way(file):
    inner = {name.split(".")[1] for name in imports(file) if name.startswith("prtnet.")}
    too_far = {name for name in inner & RANK.keys() if RANK[name] > RANK[room(file)]}
    assert not too_far, f"{file.name} imports {too_far}, which stand to its right"


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(PACKAGE)))
def test_torch_stays_in_models(file):
    if room(file) not in {"models", "pipeline"}:
        assert not {name for name in imports(file) if name.split(".")[0] == "torch"}
    if room(file) == "export":
        assert not {name for name in imports(file) if name.startswith("prtnet.models")}


def test_every_room_has_a_row():
    assert {room(file) for file in FILES} <= RANK.keys()


def test_files_and_functions_stay_small():
    for file in FILES:
        text = file.read_text(encoding="utf-8")
        assert text.count("\n") <= 300, f"{file}: is it still one room?"
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                assert (node.end_lineno or 0) - node.lineno <= 60, f"{file}: {node.name} is too long"


def test_help_imports_nothing_heavy():
    code = (
        "import sys; sys.argv = ['prtnet', '--help']\n"
        "from prtnet.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'torch', 'trimesh', 'numba', 'skimage', 'matplotlib', 'moderngl'} & sys.modules.keys()\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "scene.path=" in done.stdout
