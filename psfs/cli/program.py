"""A program with subcommands: its parser, which is derived from the commands' requests, and the
exit codes and messages of its end."""

from __future__ import annotations

import argparse
import contextlib
import errno
import os
import platform
import re
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from cl import InputError, UserError
from psfs.cli.commandline import Messages, add_message_flags, log_line, messages
from psfs.common.outputs import guard_files
from psfs.common.ranges import escape_unprintable
from psfs.common.system import (
    handle_signals,
    import_nothing_from_current_folder,
    interrupt,
    versions,
)

if TYPE_CHECKING:
    from psfs.common.requests import Option, Request, Stated

DONE, MENDABLE, UNEXPECTED, INTERRUPTED = 0, 2, 70, 130
_LONGEST_LINE = 800
#: Signals after which finished work is kept.
_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")
#: The shells that shtab writes completions for.
_SHELLS = ("bash", "zsh", "tcsh", "fish", "powershell")
#: Values that begin with a minus, as in `--up -z` and `--volume -1,1,...`: argparse takes them for
#: flags.
_NEGATIVE = re.compile(r"-([xyz]$|[\d.])")


@dataclass(frozen=True)
class Command:
    """A subcommand of a package's program. NAME takes the request `package.request.NAMERequest`;
    `run(request)` of `package.cli.NAME` does its work. Both modules are imported when they are
    needed. help: one line. group: heading of --help."""

    package: str
    name: str
    help: str
    group: str = ""

    @property
    def kind(self) -> type[Request]:
        """The class of its request."""
        module = import_module(f"{self.package}.request")
        kind: type[Request] = getattr(module, f"{self.name.capitalize()}Request")
        return kind

    def run(self, request: Request) -> None:
        """Check the request, import the work and run it. Raises UserError."""
        request.check_folders()
        import_module(f"{self.package}.cli.{self.name}").run(request)


def list_commands(package: str, groups: Mapping[str, Mapping[str, str]]) -> tuple[Command, ...]:
    """Return the commands of a package's program from their names and one-line helps, in groups."""
    return tuple(
        Command(package, name, text, group)
        for group, helps in groups.items()
        for name, text in helps.items()
    )


class _GroupedHelp(argparse.HelpFormatter):
    """The help of a program, with a heading before the first command of each group."""

    def __init__(self, prog: str, headings: Mapping[str, str]) -> None:
        super().__init__(prog)
        self._headings = headings

    def _format_action(self, action: argparse.Action) -> str:
        text = super()._format_action(action)
        command = isinstance(action, argparse._SubParsersAction._ChoicesPseudoAction)
        heading = self._headings.get(action.dest) if command else None
        return f"\n  {heading}:\n{text}" if heading else text


class CommandParser(argparse.ArgumentParser):
    """A parser that reports errors in one line, and allows values that begin with a minus. The
    parser of a `command` gets its flags before the first words are parsed."""

    command: Command | None = None

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        #: The parsers of the subcommands, by their names.
        self.commands: dict[str, CommandParser] = {}
        self._filled = False
        self._negative_number_matcher = _NEGATIVE  # argparse's own takes plain numbers alone

    def add_flags(self) -> None:
        """Add the flags of the command, unless they have been added."""
        if self.command is not None and not self._filled:
            self._filled = True
            _fill(self, self.command.kind)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Add the flags of the command, and parse like argparse."""
        self.add_flags()
        return super().parse_known_args(args, namespace)

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        # Path("") would be the current folder
        if not arg_string and action.nargs != argparse.PARSER:
            raise argparse.ArgumentError(action, "is empty; expected a value")
        try:
            if callable(action.type):
                return action.type(arg_string)
        except InputError as error:
            raise argparse.ArgumentError(action, str(error)) from None
        except ValueError:
            from psfs.common.requests import NUMBERS

            if action.type in NUMBERS:
                expected = f"is {arg_string!r}; expected {NUMBERS[action.type]}"
                raise argparse.ArgumentError(action, expected) from None
        return super()._get_value(action, arg_string)

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: error: {escape_unprintable(message)}; see {self.prog} --help\n")


def _fill(parser: CommandParser, kind: type[Request]) -> None:
    """Add the flags of a request, of --config and of the messages."""
    from psfs.common.requests import SETTINGS, list_options

    parser.description = f"{(parser.description or '').rstrip('.')}{kind.DETAILS or '.'}"
    groups: dict[Any, Any] = {None: parser}
    exclusive: dict[Any, Any] = {}
    usage = ["%(prog)s"]
    for option in list_options(kind):
        group = option.flag.group
        if group is not None and group not in groups:
            groups[group] = parser.add_argument_group(group.title, group.description)
        target = groups[group]
        if option.flag.either:
            key = group, option.flag.either
            if key not in exclusive:
                exclusive[key] = target.add_mutually_exclusive_group()
            target = exclusive[key]
        _add_option(target, option)
        name = option.flag.metavar or option.dest.upper()
        if option.flag.positional:
            shown = {"+": f"{name} [{name} ...]", "?": f"[{name}]"}
            usage.append(shown.get(option.flag.nargs, name))
        elif option.required:
            usage += [option.flag.short or f"--{option.name}", name]
    parser.add_argument_group("settings").add_argument(
        "--config", type=Path, metavar="FILE", default=argparse.SUPPRESS,
        help=f"settings (TOML), such as the {SETTINGS} that is written beside results; flags beat "
        "it",
    )  # fmt: skip
    add_message_flags(parser)
    parser.usage = " ".join([*usage, "[flags]"])


def _add_option(target: Any, option: Option) -> None:
    from psfs.common.requests import NUMBERS

    flag = option.flag
    texts: dict[str, Any] = {"help": flag.help.replace("%", "%%"), "default": argparse.SUPPRESS}
    names = [*([flag.short] if flag.short else []), f"--{option.name}"]
    if flag.positional:
        names = [option.dest]
        texts["default"] = None if flag.nargs == "?" else argparse.SUPPRESS
    else:
        texts |= {"dest": option.dest, "required": bool(option.required)}
    if option.switch:
        target.add_argument(*names, action="store_const", const=not option.default, **texts)
        return
    texts |= {"nargs": flag.nargs or None, "choices": flag.choices or None}
    kind = flag.parse or option.kind
    parse = kind if kind in NUMBERS else option.parse
    target.add_argument(*names, type=parse, metavar=flag.metavar or None, **texts)


def program_parser(
    prog: str,
    description: str,
    commands: Sequence[Command],
    example: str = "",
) -> CommandParser:
    """Return the parser of a program with these subcommands; each gets its flags when it parses."""
    headings = {command.group: command.name for command in reversed(commands)}
    parser = CommandParser(
        prog=prog,
        description=description,
        allow_abbrev=False,
        formatter_class=partial(_GroupedHelp, headings={v: k for k, v in headings.items()}),
        epilog=f"example: {example}" if example else None,
    )
    parser.add_argument("--version", action=_Version, help="print the versions, and exit")
    parser.add_argument(
        "--completion",
        action=_Completion,
        choices=_SHELLS,
        help="print what completes this program's commands and flags in that shell, and exit",
    )
    subparsers = parser.add_subparsers(
        title="commands", metavar="COMMAND", required=True, dest="command"
    )
    for command in commands:
        subparser = subparsers.add_parser(
            command.name, help=command.help, description=command.help, allow_abbrev=False
        )
        subparser.command = command
        parser.commands[command.name] = subparser
    return parser


def run_program(
    prog: str,
    description: str,
    commands: Sequence[Command],
    argv: Sequence[str] | None = None,
    example: str = "",
) -> int:
    """Run the subcommand that `argv` names and return the exit code. Only its modules are imported.
    argv: the process's own by default."""
    parser = program_parser(prog, description, commands, example)

    def run(args: argparse.Namespace) -> None:
        command = parser.commands[args.command].command
        assert command is not None
        request = command.kind.from_stated(find_stated(command.kind, args))
        with guard_files(getattr(request, "overwrite", False)):
            command.run(request)

    parser.set_defaults(run=run)
    return run_command(parser, argv)


def find_stated(kind: type[Request], args: argparse.Namespace) -> Stated:
    """Return what parsed words and the file of --config state. Raises InputError that names the
    file."""
    from psfs.common.requests import Stated, list_options, read_config, without_excluded

    given = vars(args)
    dests = [option.dest for option in list_options(kind)]
    values = {dest: given[dest] for dest in dests if given.get(dest) is not None}
    file: Path | None = given.get("config")
    if file is None:
        return Stated(values)
    config = read_config(kind, file)
    return replace(config, values={**without_excluded(kind, config.values, values), **values})


def run_command(parser: argparse.ArgumentParser, argv: Sequence[str] | None = None) -> int:
    """Parse, call the `run(args)` that the parser set and return the exit code, see `exit_code`."""
    words = sys.argv[1:] if argv is None else list(argv)
    if argv is None:  # a process of its own
        for name in ("MPLBACKEND", "SOURCE_DATE_EPOCH"):  # of plots on a display, and of builds:
            os.environ.pop(name, None)  # Matplotlib and NumPy end with an error at a wrong one
        import_nothing_from_current_folder()

    def run() -> None:
        if any("\0" in word for word in words):
            parser.error("an argument holds the character NUL; expected text")
        args = parser.parse_args(words)
        with messages(args):
            if Messages.log is not None:
                log_line(f"{parser.prog} {' '.join(words)} ({version_line()})")
            try:
                args.run(args)
            except BaseException as error:
                log_line(f"{parser.prog}: {type(error).__name__}\n{traceback.format_exc()}")
                raise
            log_line(f"{parser.prog}: done")

    return exit_code(parser.prog, run)


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
        for subparser in parser.commands.values():
            subparser.add_flags()
            for flag in subparser._actions:
                if flag.metavar in ("FILE", "FOLDER", "PATH", "OUT", "TRACK"):
                    flag.complete = shtab.FILE  # type: ignore[attr-defined]
        print(shtab.complete(parser, str(shell)))
        parser.exit()


def version_line() -> str:
    """Return the versions of this program and of the platform that it runs on."""
    found = versions()
    program = f"psfs-apf {found.pop('psfs-apf')}"
    return ", ".join([program, *(f"{name} {version}" for name, version in found.items()),
                      f"{platform.system()} {platform.machine()}"])  # fmt: skip


def exit_code(program: str, run: Callable[[], None]) -> int:
    """Call `run` and return the exit code.

    0: success. 2: an error that the user can mend. 130: interrupted, also by SIGTERM and SIGHUP.
    70: a bug of the program, with the traceback in a log file. All but 0 print one line on standard
    error.
    """
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # for LANG=C and paths that are not UTF-8
            stream.reconfigure(errors="backslashreplace")
    try:
        main = threading.current_thread() is threading.main_thread()  # signals come to it alone
        with handle_signals(interrupt, _ENDING) if main else contextlib.nullcontext():
            run()
        sys.stdout.flush()
        return DONE
    except SystemExit as exit:  # from the parser, which has printed the reason
        return exit.code if isinstance(exit.code, int) else DONE
    except BrokenPipeError:  # `psfs info x | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except KeyboardInterrupt:
        _say(f"{program}: interrupted")
        return INTERRUPTED
    except Exception as error:
        reason = describe_user_error(error)
        if reason is not None:
            _say(f"{program}: error: {reason}")
            return MENDABLE
        _say(f"{program}: error: {describe(error)}; please report it{_write_traceback(program)}")
        return UNEXPECTED


def describe(error: BaseException) -> str:
    """Return the message of an error: of one that the user can mend its reason, of others that they
    are unexpected, with their kind."""
    reason = describe_user_error(error) if isinstance(error, Exception) else None
    if reason is not None:
        return reason
    text = " ".join(str(error).split())[: _LONGEST_LINE // 2]
    return f"unexpected {type(error).__name__}{f': {text}' if text else ''}"


def describe_user_error(error: Exception) -> str | None:
    """Return the message for an error that the user can mend: the program's own errors, those of
    the file system, and a lack of memory. Return None for all others, which are bugs."""
    if isinstance(error, UserError):
        return str(error)
    short = "not enough memory; expected fewer or larger voxels, smaller pictures or fewer frames"
    if isinstance(error, OSError) and error.errno is not None:
        named = isinstance(error.filename, str | bytes)
        if not named and error.errno in (errno.ENOMEM, errno.EAGAIN):  # no process was started
            return f"{short} ({error.strerror})"
        where = os.fsdecode(error.filename) if named else "standard output, or a file"
        return f"{where}: cannot be read or written: {error.strerror}"
    unmapped = isinstance(error, ImportError) and "failed to map segment" in str(error)
    cv2 = sys.modules.get("cv2")  # an error of OpenCV's comes from an imported OpenCV
    opencv = cv2 is not None and isinstance(error, cv2.error) and error.code == cv2.Error.StsNoMem
    return short if isinstance(error, MemoryError) or unmapped or opencv else None


def _say(text: str) -> None:
    # A closed or full standard error must not hide the exit code.
    with contextlib.suppress(OSError):
        line = escape_unprintable(text)
        if len(line) > _LONGEST_LINE:  # an error may quote a list of a thousand numbers
            line = f"{line[: _LONGEST_LINE // 2]} ... {line[-_LONGEST_LINE // 2 :]}"
        print(line, file=sys.stderr, flush=True)


def _write_traceback(program: str) -> str:
    """Write the traceback of the current error to a file; return a text that names the file."""
    name = f"{program.split()[0]}-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}.log"
    try:
        path = Path(tempfile.gettempdir()) / name
        arguments = " ".join(map(repr, sys.argv[1:]))
        text = f"{program} {arguments}\n{traceback.format_exc()}"
        path.write_text(text, encoding="utf-8", errors="backslashreplace")
    except OSError:
        return " with the command that you gave"
    return f" with the log {path}"
