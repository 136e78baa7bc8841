"""Every command on the site is one that the programs understand, and stands in the list of those
that were run."""

from __future__ import annotations

import re
import shlex
import sys

import pytest
from helpers.shared import ROOT

sys.path.insert(0, str(ROOT / "scripts"))
from check_site_commands import find_commands, list_commands

import apf.cli.commands
import psfs.cli.commands
from psfs.cli.program import program_parser

PROGRAMS = {"apf": apf.cli.commands.COMMANDS, "psfs": psfs.cli.commands.COMMANDS}
OURS = sorted(
    {
        part.strip()
        for _, command in find_commands()
        for part in re.split(r";|&&", command)
        if part.split()[0] in PROGRAMS
    }
)


@pytest.mark.parametrize("command", OURS)
def test_the_program_has_these_flags(command: str) -> None:
    program, *words = shlex.split(command)
    parser = program_parser(program, "", PROGRAMS[program])
    assert parser.parse_args(words).run is not None
    with pytest.raises(SystemExit):
        parser.parse_args([*words, "--no-such-flag"])


def test_all_are_listed_and_tests_exist() -> None:
    listed = list_commands()  # raises if one is missing, or no longer shown
    assert len(listed) > 80
    named = {one.what for one in listed if one.how == "test"}
    assert named and [path for path in named if not (ROOT / path).is_file()] == []
