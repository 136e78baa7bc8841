"""What `lint-imports` cannot hold: imports are absolute, pyopencl has its full name, since `cl` is
a package of ours, and tests keep to public names."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from helpers.source_tree import imports

ROOT = Path(__file__).parents[1]
TESTS = sorted((ROOT / "tests").rglob("*.py"))
FILES = [path for name in ("cl", "psfs", "apf") for path in sorted((ROOT / name).rglob("*.py"))]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_are_absolute_and_pyopencl_has_its_name(path: Path) -> None:
    for module, alias in imports(ast.parse(path.read_text())):  # asserts that they are absolute
        assert module.split(".")[0] != "pyopencl" or alias is None, "import pyopencl by its name"


def test_every_package_is_held() -> None:
    assert {path.relative_to(ROOT).parts[0] for path in FILES} == {"cl", "psfs", "apf"}


@pytest.mark.parametrize("path", TESTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_tests_touch_no_private_names(path: Path) -> None:
    """But those of their own classes."""
    touched = [
        f"{node.lineno}: {ast.unparse(node)}"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute)
        and node.attr.startswith("_")
        and not node.attr.startswith("__")
        and ast.unparse(node.value) != "self"
    ]
    assert not touched
