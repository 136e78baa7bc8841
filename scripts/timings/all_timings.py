"""`compare_timings.py all`: every comparison, one after the other, into one folder."""

from __future__ import annotations

import argparse
import time

from psfs.cli.commandline import add_command, stderr
from timings.results import add_timing_flags

#: Shares of a limited time; 1 for sections that are not named.
_SHARES = {"whole": 4.0, "psfs": 1.5, "apf": 1.5, "methods": 2.5, "batch": 0.5}


def register(commands: argparse._SubParsersAction) -> None:
    """Register `all`, which runs the subcommands registered before it; call it last."""
    others = dict(commands.choices)
    parser = add_command(commands, "all", lambda args: _run(args, others), help="all of them")
    add_timing_flags(parser)


def _run(args: argparse.Namespace, others: dict[str, argparse.ArgumentParser]) -> None:
    began = time.monotonic()
    left = dict(others)
    for name, parser in others.items():
        shares = sum(_SHARES.get(other, 1.0) for other in left)
        argv = ["--out", str(args.out)]
        argv += [f"--{flag}" for flag in ("quick", "resume", "verbose") if getattr(args, flag)]
        argv += ["--commit", args.commit] if args.commit else []
        if args.seconds is not None:
            seconds = max(0.0, args.seconds - (time.monotonic() - began))
            argv += ["--seconds", f"{seconds * _SHARES.get(name, 1.0) / shares:.0f}"]
        stderr.print(f"{name} {' '.join(argv)}", style="bold", soft_wrap=True)
        parsed = parser.parse_args(argv)
        parsed.run(parsed)
        del left[name]
