"""Run-time shape checks for every public function: beartype reads the jaxtyping annotations."""

from pathlib import Path

import pytest
from jaxtyping import install_import_hook

import tests.shapes  # noqa: F401  (the hook looks it up by name)

PACKAGE = Path(__file__).resolve().parents[1] / "prtnet"
# numba compiles the kernels from their plain source, so they stay undecorated
UNCHECKED = {"prtnet.data.kernels", "prtnet.models.kernels", "prtnet.__main__"}


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


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--gpu"):
        return
    skip = pytest.mark.skip(reason="needs a GPU: ./run gpu-check on a machine that has one")
    for item in items:
        if "gpu" in item.keywords:
            item.add_marker(skip)
