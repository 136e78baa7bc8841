"""A stage is a kernel file, a launcher, a NumPy twin, and a test that compares the two."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from helpers.source_tree import imports

ROOT = Path(__file__).parents[1]
KERNELS = {path.stem: path.read_text() for path in (ROOT / "cl" / "kernels").rglob("*.cl")}
SOURCES = {
    path.relative_to(ROOT): path.read_text()
    for package in ("psfs", "apf")
    for path in sorted((ROOT / package).rglob("*.py"))
}
#: Host mathematics that production needs too, and that a kernel is compared with.
HOST = {Path("apf/body/kinematics.py")}
TWINS = {p: text for p, text in SOURCES.items() if "reference" in p.parts or p in HOST}
LAUNCHERS = {path: text for path, text in SOURCES.items() if path not in TWINS}


def imported_by_tests() -> set[str]:
    paths = (ROOT / "tests").rglob("*.py")
    return {module for path in paths for module, _ in imports(ast.parse(path.read_text()))}


@pytest.mark.parametrize("stage", sorted(KERNELS))
def test_every_stage_is_launched_and_compared_with_its_twin(stage: str) -> None:
    assert [
        p
        for p, text in LAUNCHERS.items()
        if f"/{stage}" in text or (f'"{stage}"' in text and "kernel(" in text)
    ]
    twins = [p for p, text in TWINS.items() if p.stem == stage or f"{stage}.cl" in text]
    assert twins, f"no NumPy twin names {stage}.cl"
    assert "twin" in KERNELS[stage].split("#include")[0].lower(), f"{stage}.cl names no twin"
    modules = {".".join(path.with_suffix("").parts) for path in twins}
    assert modules & imported_by_tests(), f"no test imports {', '.join(sorted(modules))}"
