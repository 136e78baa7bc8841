"""The command `apf`."""

from __future__ import annotations

import argparse

from apf.cli import demo, evaluate, live, render, smooth, synth, track, view
from psfs.cli.commandline import run_command


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="apf", description="A skeleton per frame from synchronised calibrated views."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in (synth, track, live, smooth, evaluate, render, view, demo):
        command.register(commands)
    return run_command(parser, argv)
