"""Imports run one way: apf -> psfs -> cl; pyopencl is imported by its full name."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from helpers.source_tree import imports

ROOT = Path(__file__).parents[1]
#: What each package must not import.
FORBIDDEN = {"cl": {"psfs", "apf"}, "psfs": {"apf"}, "apf": set()}
FILES = [path for package in FORBIDDEN for path in sorted((ROOT / package).rglob("*.py"))]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_direction_of_imports(path: Path) -> None:
    package = path.relative_to(ROOT).parts[0]
    for module, alias in imports(ast.parse(path.read_text())):
        top = module.split(".")[0]
        assert top not in FORBIDDEN[package], f"{package} must not import {module}"
        assert top != "pyopencl" or alias is None, "import pyopencl by its full name"


def test_every_package_is_held() -> None:
    assert {path.relative_to(ROOT).parts[0] for path in FILES} == set(FORBIDDEN)
