"""What `lint-imports` cannot hold: imports are absolute, pyopencl has its full name, since `cl` is
a package of ours, and tests keep to public names."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


def renames_or_is_relative(node: ast.AST) -> bool:
    """Return whether a node is a relative import, or one of pyopencl by another name."""
    if isinstance(node, ast.ImportFrom):
        return node.level > 0
    return isinstance(node, ast.Import) and any(
        alias.name.split(".")[0] == "pyopencl" and alias.asname for alias in node.names
    )


def touches_private_name(node: ast.AST) -> bool:
    """Return whether a node is a private attribute of something other than `self`."""
    if not isinstance(node, ast.Attribute) or not node.attr.startswith("_"):
        return False
    return not node.attr.startswith("__") and ast.unparse(node.value) != "self"


def found(folder: str, is_fault: Callable[[ast.AST], bool]) -> Iterator[str]:
    """Yield the nodes that are at fault in the files of a folder, which has some."""
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    for path in files:
        for node in ast.walk(ast.parse(path.read_text())):
            if is_fault(node):
                yield f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}"  # type: ignore[attr-defined]


@pytest.mark.parametrize("package", ["cl", "psfs", "apf"])
def test_imports_are_absolute_and_pyopencl_has_its_name(package: str) -> None:
    assert not list(found(package, renames_or_is_relative))


def test_tests_touch_no_private_names() -> None:
    """But those of their own classes."""
    assert not list(found("tests", touches_private_name))
