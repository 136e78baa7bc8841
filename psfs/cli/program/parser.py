"""A program with subcommands: its parser and its main function."""

from __future__ import annotations

import argparse
import os
import platform
import sys
import traceback
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from cl import InputError
from psfs.cli.commandline import (
    CommandParser,
    add_command,
    add_message_flags,
    has_log,
    log_line,
    messages,
    path_or_name,
)
from psfs.cli.program.command import Command
from psfs.cli.program.outcome import exit_code
from psfs.common.single_files import guard_files
from psfs.common.system import memory_limit
from psfs.common.versions import versions

#: The shells that shtab writes completions for.
_SHELLS = ("bash", "zsh", "tcsh", "fish", "powershell")

#: Bytes of address space that the libraries take before anything is read.
_LEAST_MEMORY = 1.25 * 2**30


def run_program(
    prog: str, description: str, commands: Sequence[Command], argv: Sequence[str] | None = None
) -> int:
    """Run the subcommand that `argv` names and return the exit code. Only its modules are imported.
    argv: the process's own by default."""
    parser = program_parser(prog, description, commands)
    return run_command(parser, argv)


def program_parser(
    prog: str,
    description: str,
    commands: Sequence[Command],
    kind: type[CommandParser] = CommandParser,
) -> CommandParser:
    """Return the parser of a program with these subcommands; each gets its flags when it parses."""
    parser = kind(prog=prog, description=description, allow_abbrev=False)
    parser.add_argument("--version", action=_Version, help="print the versions, and exit")
    parser.add_argument(
        "--completion",
        action=_Completion,
        choices=_SHELLS,
        help="print what completes this program's commands and flags in that shell, and exit",
    )
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in commands:
        subparser = add_command(subparsers, command.name, command.run, command.help)
        subparser.fill = partial(_add_flags, command, subparser)
        parser.commands.append(subparser)
    return parser


def _add_flags(command: Command, parser: CommandParser) -> None:
    """Add a subcommand's own flags and those of all subcommands."""
    from psfs.cli.settings import add_config_flag  # imports pydantic, which --help does without

    command.add_flags(parser)
    add_config_flag(parser)
    add_message_flags(parser)
    parser.usage = _usage(parser)


def run_command(parser: argparse.ArgumentParser, argv: Sequence[str] | None = None) -> int:
    """Parse, run the chosen subcommand's `run(args)` and return the exit code of
    `psfs.cli.program.outcome`."""
    words = sys.argv[1:] if argv is None else list(argv)
    if argv is None:  # a process of its own
        os.environ.pop("MPLBACKEND", None)  # plots go into files, not to a display

    def run() -> None:
        if any("\0" in word for word in words):
            parser.error("an argument holds the character NUL; expected text")
        args = parser.parse_args(words)
        from psfs.cli.settings import with_settings

        args = with_settings(parser, args, words)
        _check_memory_limit()
        with guard_files(getattr(args, "overwrite", False)), messages(args):
            _run_logged(parser.prog, args, words)

    return exit_code(parser.prog, run)


def _check_memory_limit() -> None:
    """Raise InputError if the process may use less memory than its libraries take, which else fail
    with reasons of their own."""
    limit = memory_limit()
    if limit < _LEAST_MEMORY:
        raise InputError(
            f"the process may use {limit / 2**20:,.0f} MiB (ulimit -v); expected at least "
            f"{_LEAST_MEMORY / 2**20:,.0f}, or no limit"
        )


def _run_logged(prog: str, args: argparse.Namespace, words: Sequence[str]) -> None:
    """Run the subcommand, and write its start and end into the log file."""
    if has_log():
        log_line(f"{prog} {' '.join(words)} ({version_line()})")
    try:
        args.run(args)
    except BaseException as error:
        log_line(f"{prog}: {type(error).__name__}\n{traceback.format_exc()}")
        raise
    log_line(f"{prog}: done")


class _Version(argparse.Action):
    """An action that prints the versions and exits; they are determined only then."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str | None = None) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"{parser.prog}: {version_line()}")
        parser.exit()


class _Completion(argparse.Action):
    """An action that prints a shell's completion script for all subcommands and flags, and
    exits."""

    def __call__(
        self, parser: argparse.ArgumentParser, _: argparse.Namespace, shell: object, *__: object
    ) -> None:
        import shtab

        assert isinstance(parser, CommandParser)
        for subparser in parser.commands:
            subparser.add_flags()
            for flag in subparser.actions:
                if flag.type in (Path, path_or_name) or flag.dest in ("folder", "folders"):
                    flag.complete = shtab.FILE  # type: ignore[attr-defined]
        print(shtab.complete(parser, str(shell)))
        parser.exit()


def version_line() -> str:
    """Return the versions of this program and of the platform that it runs on."""
    found = versions()
    own = f"psfs-apf {found.pop('psfs-apf')}"
    return ", ".join([own, *(f"{name} {version}" for name, version in found.items()),
                      f"{platform.system()} {platform.machine()}"])  # fmt: skip


def _usage(parser: CommandParser) -> str:
    """Return the usage with the required arguments, and a hint at the optional ones."""
    words = ["%(prog)s"]
    for action in parser.actions:
        name = action.metavar if isinstance(action.metavar, str) else action.dest.upper()
        if not action.option_strings:
            words.append(f"{name} [{name} ...]" if action.nargs == "+" else name)
        elif action.required:
            words += [action.option_strings[0], name]
    return " ".join([*words, "[flags]"])
