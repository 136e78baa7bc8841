"""Commands answer without what only their work needs, in modules rather than in seconds."""

from pathlib import Path
from typing import Any

import pytest
from helpers.commands import run_python

import apf.cli.commands
import psfs.cli.commands

ROOT = Path(__file__).parents[1]
#: Libraries that take a while to load, and that only work needs.
HEAVY = ("open3d", "cv2", "scipy", "matplotlib", "plotly", "trimesh", "skimage", "pyopencl", "rich",
         "numpy", "av", "PIL", "ezc3d", "distributed", "shtab")  # fmt: skip
#: Words that are refused before any work, with exit code 2.
REFUSED = {
    "psfs": ["info NOWHERE", "reconstruct NOWHERE -o OUT", "info FOLDER --wrong"],
    "apf": ["nonsense"],
}


@pytest.mark.parametrize(
    ("program", "commands"),
    [("psfs", psfs.cli.commands.COMMANDS), ("apf", apf.cli.commands.COMMANDS)],
)
def test_what_needs_no_work_loads_no_heavy_library(program: str, commands: Any) -> None:
    """One after the other in a process: the first that has a library loaded it."""
    codes = {"--help": 0} | {f"{command.name} --help": 0 for command in commands}
    codes |= dict.fromkeys(REFUSED[program], 2)
    code = f"""
import sys
from {program}.cli import main
for words in {list(codes)}:
    code = main(words.split())
    print("LOADED", code, *sys.modules, file=sys.__stdout__, flush=True)
"""
    run = run_python("-c", code)
    found = [line.split()[1:] for line in run.out.splitlines() if line.startswith("LOADED ")]
    assert len(found) == len(codes), run.err
    for (words, expected), (status, *modules) in zip(codes.items(), found, strict=True):
        assert int(status) == expected, words
        assert not {*HEAVY}.intersection(modules), words
        if words == "--help":  # nor any command's own module
            assert not {f"{program}.request", "pydantic"}.intersection(modules)
