"""Commands answer without what only their work needs, in modules rather than in seconds."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import apf.cli.commands
import psfs.cli.commands

ROOT = Path(__file__).parents[1]
#: Libraries that take a while to load, and that only work needs.
HEAVY = ("open3d", "cv2", "scipy", "matplotlib", "plotly", "trimesh", "skimage", "pyopencl", "rich",
         "numpy", "av", "PIL", "ezc3d", "distributed", "shtab")  # fmt: skip
PROGRAMS = [("psfs", psfs.cli.commands.COMMANDS), ("apf", apf.cli.commands.COMMANDS)]


def loaded_by(program: str, *words: str) -> tuple[int, set[str]]:
    """The exit code of a command in a process of its own, and the modules that it loaded."""
    code = (
        f"import sys; from {program}.cli import main; code = main({list(words)!r});"
        "sys.stdout = sys.__stdout__; print('LOADED', code, *sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    last = run.stdout.splitlines()[-1].split()
    assert last[0] == "LOADED", run.stderr
    return int(last[1]), set(last[2:])


@pytest.mark.parametrize(
    ("program", "words", "expected"),
    [
        ("apf", ("--help",), 0),
        ("psfs", ("--help",), 0),
        ("psfs", ("info", "NOWHERE"), 2),
        ("psfs", ("reconstruct", "NOWHERE", "-o", "OUT"), 2),
        ("psfs", ("info", "FOLDER", "--wrong"), 2),
        ("apf", ("nonsense",), 2),
    ],
)
def test_what_needs_no_work_loads_no_heavy_library(
    program: str, words: tuple[str, ...], expected: int
) -> None:
    code, modules = loaded_by(program, *words)
    assert code == expected
    assert not modules.intersection(HEAVY)
    if words == ("--help",):  # nor any command's own module
        assert f"{program}.request" not in modules
        assert "pydantic" not in modules


@pytest.mark.parametrize(("program", "commands"), PROGRAMS)
def test_the_help_of_a_command_loads_no_heavy_library(program: str, commands: Any) -> None:
    """One after the other in a process: the first that has a library loaded it."""
    names = [command.name for command in commands]
    code = f"""
import sys
from {program}.cli import main
for name in {names}:
    code = main([name, "--help"])
    print("LOADED", name, code, *sys.modules, file=sys.__stdout__, flush=True)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    found = [line.split() for line in run.stdout.splitlines() if line.startswith("LOADED ")]
    assert [line[1] for line in found] == names, run.stderr
    for _, name, status, *modules in found:
        assert status == "0", name
        assert not {*HEAVY}.intersection(modules), name
        assert f"{program}.cli" in modules
