"""A program with subcommands: its parser, and how it is run."""

from __future__ import annotations

import argparse
import os
import platform
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import shtab

from psfs.cli.commandline import (
    CommandParser,
    add_message_flags,
    log_line,
    messages,
    path_or_name,
)
from psfs.cli.program.outcome import exit_code
from psfs.cli.settings import add_config_flag, with_settings
from psfs.output.reconstruction_folder import versions


def run_program(
    prog: str, description: str, commands: Sequence[ModuleType], argv: Sequence[str] | None = None
) -> int:
    """Run the one of these subcommands, modules with `register`, that `argv` names; return the exit
    code. argv: the process's own by default."""
    parser = program_parser(prog, description, commands)
    return run_command(parser, argv)


def program_parser(
    prog: str,
    description: str,
    commands: Sequence[ModuleType],
    kind: type[CommandParser] = CommandParser,
) -> CommandParser:
    """Return the parser of a program with these subcommands, modules with `register`."""
    parser = kind(prog=prog, description=description, allow_abbrev=False)
    parser.add_argument("--version", action=_Version, help="print the versions, and exit")
    shtab.add_argument_to(
        parser,
        "--completion",
        help="print what completes this program's commands and flags in that shell, and exit",
    )
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in commands:
        command.register(subparsers)
    for subparser in subparsers.choices.values():
        add_config_flag(subparser)
        add_message_flags(subparser)
        subparser.usage = _usage(subparser)
        for action in subparser._actions:
            if action.type in (Path, path_or_name) or action.dest in ("folder", "folders"):
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    return parser


def run_command(parser: argparse.ArgumentParser, argv: Sequence[str] | None = None) -> int:
    """Parse, run the chosen subcommand's `run(args)` and return the exit code of
    `psfs.cli.program.outcome`."""
    words = sys.argv[1:] if argv is None else list(argv)
    if argv is None:  # a process of its own
        os.environ.pop("MPLBACKEND", None)  # plots go into files: no display of Matplotlib's counts

    def run() -> None:
        if any("\0" in word for word in words):
            parser.error("an argument holds the character NUL; expected text")
        args = with_settings(parser, parser.parse_args(words), words)
        with messages(args):
            _logged(parser.prog, args, words)

    return exit_code(parser.prog, run)


def _logged(prog: str, args: argparse.Namespace, words: Sequence[str]) -> None:
    """Run the subcommand, its beginning and end in the log file."""
    log_line(f"{prog} {' '.join(words)} ({version_line()})")
    try:
        args.run(args)
    except BaseException as error:
        log_line(f"{prog}: {type(error).__name__}\n{traceback.format_exc()}")
        raise
    log_line(f"{prog}: done")


class _Version(argparse.Action):
    """Prints the versions and exits; they are looked up only then."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str | None = None) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"{parser.prog}: {version_line()}")
        parser.exit()


def version_line() -> str:
    """Return this program's version, and those of what it runs on."""
    found = versions()
    own = f"psfs-apf {found.pop('psfs-apf')}"
    return ", ".join([own, *(f"{name} {version}" for name, version in found.items()),
                      f"{platform.system()} {platform.machine()}"])  # fmt: skip


def _usage(parser: argparse.ArgumentParser) -> str:
    """Return what must be stated, and that there is more."""
    words = ["%(prog)s"]
    for action in parser._actions:
        name = action.metavar if isinstance(action.metavar, str) else action.dest.upper()
        if not action.option_strings:
            words.append(f"{name} [{name} ...]" if action.nargs == "+" else name)
        elif action.required:
            words += [action.option_strings[0], name]
    return " ".join([*words, "[flags]"])
