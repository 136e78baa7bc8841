"""What `lint-imports` cannot hold: imports are absolute, and pyopencl has its full name, since
`cl` is a package of ours."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from helpers.source_tree import imports

ROOT = Path(__file__).parents[1]
FILES = [path for name in ("cl", "psfs", "apf") for path in sorted((ROOT / name).rglob("*.py"))]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_are_absolute_and_pyopencl_has_its_name(path: Path) -> None:
    for module, alias in imports(ast.parse(path.read_text())):  # asserts that they are absolute
        assert module.split(".")[0] != "pyopencl" or alias is None, "import pyopencl by its name"


def test_every_package_is_held() -> None:
    assert {path.relative_to(ROOT).parts[0] for path in FILES} == {"cl", "psfs", "apf"}
