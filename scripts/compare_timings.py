#!/usr/bin/env python3
"""Timings of this project against what else a user could pick, all in one run.

    scripts/compare_timings.py all [--quick] [-o OUT]      # every comparison
    scripts/compare_timings.py psfs [--quick] [-o OUT]     # one of them

writes OUT/psfs.json ... and prints tables; `report_timings.py` makes pages and plots of such files.
Each subcommand is a module of `timings` with a function `register(commands)`; see
`timings.results` for what they share.
"""

from __future__ import annotations

import argparse
import sys

from timings import (
    all_timings,
    apf_timings,
    batch_timings,
    methods_timings,
    objective_timings,
    people_timings,
    psfs_timings,
    whole_timings,
)

from psfs.cli.commandline import add_message_flags
from psfs.cli.program import run_command

#: One module per subcommand; `all`, which runs the others in this order, comes last.
SUBCOMMANDS = (
    whole_timings,
    psfs_timings,
    apf_timings,
    methods_timings,
    objective_timings,
    batch_timings,
    people_timings,
    all_timings,
)


def main() -> int:
    parser = argparse.ArgumentParser(prog="compare_timings.py", description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True, metavar="WHAT")
    for module in SUBCOMMANDS:
        module.register(commands)
    for command in commands.choices.values():
        add_message_flags(command)
    return run_command(parser)


if __name__ == "__main__":
    sys.exit(main())
