"""Run-time shape checks for every public function: beartype reads the jaxtyping annotations."""

from pathlib import Path

import pytest
from jaxtyping import install_import_hook

import tests.shapes  # noqa: F401  (the hook looks it up by name)

PACKAGE = Path(__file__).resolve().parents[1] / "prtnet"
# numba compiles the kernels from their plain source, so they stay undecorated
UNCHECKED = {
    f"prtnet.{name}"
    for name in (
        "data.kernels",
        "data.nearest",
        "data.implicit.kernels",
        "data.lighting.kernels",
        "models.kernels",
        "__main__",
    )
}


def _modules() -> list[str]:
    names = [
        ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts)
        for file in PACKAGE.rglob("*.py")
        if file.name != "__init__.py"
    ]
    return sorted(set(names) - UNCHECKED)


install_import_hook(_modules(), "tests.shapes.check")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--gpu", action="store_true", help="run the tests that need a GPU")
    parser.addoption("--cuda", action="store_true", help="run the tests that need the CUDA toolkit")
    parser.addoption("--slurm", action="store_true", help="run the tests that start a SLURM of two nodes")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    reasons = {
        "gpu": "needs a GPU: ./run gpu-check on a machine that has one",
        "cuda": "needs the CUDA toolkit, and minutes: ./run cuda-test",
        "slurm": "needs root, slurm-wlm and munge, and minutes: ./run cluster-test",
    }
    for word, reason in reasons.items():
        if config.getoption(f"--{word}"):
            continue
        for item in items:
            if item.get_closest_marker(word):
                item.add_marker(pytest.mark.skip(reason=reason))
