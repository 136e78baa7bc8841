"""The settings of a command as a TOML file. `--config FILE` reads one, and one is written beside
results. A preset is such a file that comes with the program. --config overrides the preset, flags
override both.

The top level of the file holds flags by their long names, as texts or numbers. Its tables are the
configs that the command declares by `add_configs`, with all of their settings.
"""

from __future__ import annotations

import argparse
import difflib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w

from cl import InputError
from psfs.cli.commandline import NUMBER_TYPES, path_or_name
from psfs.cli.recording import RecordingParser
from psfs.common.config import Config, part_kind
from psfs.common.files import resolve_path, write_text
from psfs.common.presets import Presets, merge_tables, read_preset
from psfs.common.toml import read_toml

#: The name of the file beside results.
FILE = "settings.toml"
#: Flags that are no settings: they choose where results go and what is printed.
_NONE = (
    *("help", "output", "overwrite", "config"),
    *("verbose", "quiet", "log_file", "print_completion"),
)


def add_config_flag(parser: argparse.ArgumentParser) -> None:
    """Add --config."""
    group = parser.add_argument_group("settings")
    group.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help=f"settings (TOML), such as the {FILE} that is written beside results; flags beat it",
    )
    kinds = parser.get_default("config_kinds") or {}
    parser.set_defaults(parser=parser, config_kinds=kinds)


def add_configs(parser: argparse.ArgumentParser, tree: type[Config], *names: str) -> None:
    """Let `parser`'s settings have tables for these nodes of a tree of settings: `configs[name]` of
    the arguments, where it is stated."""
    kinds = {name: part_kind(tree.model_fields[name]) for name in names}
    parser.set_defaults(config_kinds={**(parser.get_default("config_kinds") or {}), **kinds})


def add_preset_flag(parser: argparse.ArgumentParser, presets: Presets) -> None:
    """Add --preset, for a command with configs."""
    parser.add_argument(
        "--preset",
        choices=tuple(presets),
        help="settings that are exactly a paper's; flags and --config beat them (docs/tracking.md)",
    )
    parser.set_defaults(presets=presets)


def with_settings(
    parser: argparse.ArgumentParser, args: argparse.Namespace, argv: Sequence[str]
) -> argparse.Namespace:
    """Return the arguments completed by --config and --preset.

    New attributes: `stated_settings` holds the flags as stated, `configs` the configs,
    `preset_tables` the preset's own tables, `chosen_flags` the destinations of the flags that
    differ from the defaults. Raises InputError naming the file.
    """
    command: RecordingParser | None = getattr(args, "parser", None)
    if command is None:
        return args
    given = command.find_stated(argv[argv.index(args.command) + 1 :])
    stated = {a.dest: given[a.dest] for a in _settings(command) if a.dest in given}
    found: dict[str, tuple[Any, Any]] = {}
    tables: dict[str, Any] = {}
    file = args.config
    if file is not None:
        flags, tables = _split(read_toml(file))
        found = _flags(file, command, flags, stated)
    usual = {action.dest: action.default for action in command.actions}
    chosen = {*stated, *found}
    beneath: dict[str, Any] = {}
    name = ({dest: raw for dest, (raw, _) in found.items()} | stated).get("preset")
    if name is not None:
        file = file or args.presets[name][-1]
        flags, beneath = _split(read_preset(args.presets, name))
        known = {_name(a) for a in _settings(command)}  # psfs' presets have fewer flags
        flags = {name: value for name, value in flags.items() if name in known}
        found |= _flags(file, command, flags, {**stated, **found})
    command.set_defaults(**{dest: parsed for dest, (_, parsed) in found.items()})
    args = parser.parse_args(argv)
    args.stated_settings = {dest: raw for dest, (raw, _) in found.items()} | stated
    joined = {name: table for name, table in beneath.items() if name in args.config_kinds}
    args.configs = _configs(file, merge_tables(joined, tables), args.config_kinds)
    args.preset_tables = beneath
    args.chosen_flags = {dest for dest in chosen if getattr(args, dest) != usual[dest]}
    return args


def refuse_unused(args: argparse.Namespace, flags: Iterable[str], why: str) -> None:
    """Raise InputError for the first of these unused `flags` (destinations) that the command line
    or --config set to another value than the default. why: where the flag has an effect, or what to
    do."""
    chosen = args.chosen_flags.intersection(flags)
    for action in args.parser.actions:
        if action.dest in chosen:
            raise InputError(f"--{_name(action)} {why}")


def _split(content: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the flags and the tables of a file."""
    tables = {name: value for name, value in content.items() if isinstance(value, Mapping)}
    return {name: value for name, value in content.items() if name not in tables}, tables


def write_settings(
    folder: Path,
    args: argparse.Namespace,
    configs: Mapping[str, Any] | None = None,
    without: Sequence[str] = (),
) -> Path:
    """Write the settings that `args` hold into `folder`, and return the file. configs: by table,
    all of their settings; without: flags that these contain."""
    flags: dict[str, Any] = {}
    for action in _settings(args.parser):
        if action.dest not in without:
            value = args.stated_settings.get(action.dest, getattr(args, action.dest))
            value = _plain(action, value)
            if value is not None:
                flags[_name(action)] = value
    tables = {name: _without_none(config.to_dict()) for name, config in (configs or {}).items()}
    head = (
        f"# The settings of `{args.parser.prog}`, to be given back with --config.\n"
        "# Flags first, then tables with all settings that have no flag; what is left out has its "
        "default.\n\n"
    )
    path = folder / FILE
    write_text(path, head + tomli_w.dumps({**flags, **tables}))
    return path


def collect_settings(args: argparse.Namespace) -> dict[str, Any]:
    """Return the values of all settings that `args` hold, by destination, and the configs."""
    flags = {a.dest: getattr(args, a.dest) for a in _settings(args.parser)}
    return {**flags, **{name: config.to_dict() for name, config in args.configs.items()}}


def list_stated_words(args: argparse.Namespace, without: Sequence[str] = ()) -> list[str]:
    """Return the flags that were stated on the command line or in --config as words of a command
    line that works in any folder, except those with a destination in `without`."""
    words: list[str] = []
    for action in args.parser.actions:
        if action.dest not in args.stated_settings or action.dest in without:
            continue
        value, flag = args.stated_settings[action.dest], f"--{_name(action)}"
        if action.nargs == 0:
            words += [flag] * (value == action.const)
        elif isinstance(value, list):
            words += [flag, *(_with_absolute_paths(action, entry) for entry in value)]
        else:
            words.append(f"{flag}={_with_absolute_paths(action, value)}")
    return words


def _with_absolute_paths(action: argparse.Action, value: Any) -> str:
    is_path = action.type is Path or action.type is path_or_name
    return path_or_name(str(value)) if is_path else str(value)


def command_flags(command: RecordingParser, words: Sequence[str]) -> list[str]:
    """Return the flags among `words` that choose where results go and what is printed."""
    given = set(command.find_stated(words)).intersection(_NONE) - {"config"}
    return [f"--{_name(action)}" for action in command.actions if action.dest in given]


def _settings(command: RecordingParser) -> list[argparse.Action]:
    """Return the flags of a command that are settings."""
    return [a for a in command.actions if a.option_strings and a.dest not in _NONE]


def _name(action: argparse.Action) -> str:
    return max(action.option_strings, key=len).removeprefix("--")


def _configs(
    file: Path | None, tables: Mapping[str, Any], kinds: Mapping[str, type[Config]]
) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, values in tables.items():
        if name not in kinds:
            expected = ", ".join(f"[{kind}]" for kind in kinds) or "no table"
            raise InputError(f"{file}: has a table [{name}]; expected {expected}")
        try:
            found[name] = kinds[name].from_dict(values, name)
        except InputError as error:
            raise InputError(f"{file}: {error}") from None
    return found


def _flags(
    file: Path,
    command: RecordingParser,
    flags: Mapping[str, Any],
    stated: Mapping[str, Any],
) -> dict[str, tuple[Any, Any]]:
    """Return the file's flags by destination, as stated and as parsed, except those that the
    command line states or excludes."""
    by_name = {_name(action): action for action in _settings(command)}
    excluded = set(stated)
    for members in command.alternatives:
        if members & stated.keys():
            excluded |= members
    found = {}
    for name, value in flags.items():
        if name not in by_name:
            near = difflib.get_close_matches(name, by_name, 1)
            hint = f"did you mean {near[0]}?" if near else f"see {command.prog} --help"
            raise InputError(f"{file}: {name} is no setting of {command.prog}; {hint}")
        action = by_name[name]
        parsed = _parse(file, action, value)
        if action.dest not in excluded:
            found[action.dest] = (parsed if action.nargs == 0 else value, parsed)
    return found


def _parse(file: Path, action: argparse.Action, value: Any) -> Any:
    """Return a file's value as the command line would give it."""
    name = _name(action)
    if action.nargs == 0:
        if not isinstance(value, bool):
            raise InputError(f"{file}: {name} is {value!r}; expected true or false")
        return action.const if value else not action.const
    several = action.nargs in ("+", "*")
    if isinstance(value, list) != several:
        expected = "a list" if several else "one value"
        raise InputError(f"{file}: {name} is {value!r}; expected {expected}")
    parsed = [_one(file, action, entry) for entry in (value if several else [value])]
    return parsed if several else parsed[0]


def _one(file: Path, action: argparse.Action, value: Any) -> Any:
    name, kind = _name(action), action.type if callable(action.type) else str
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise InputError(f"{file}: {name} is {value!r}; expected a text or a number")
    try:
        parsed = kind(str(value))
    except (ValueError, argparse.ArgumentTypeError) as error:
        expected = NUMBER_TYPES.get(kind, "another value")
        detail = error if isinstance(error, argparse.ArgumentTypeError) else f"expected {expected}"
        raise InputError(f"{file}: {name} is {value!r}; {detail}") from None
    if action.choices is not None and parsed not in action.choices:
        listed = ", ".join(map(str, action.choices))
        raise InputError(f"{file}: {name} is {value!r}; expected one of {listed}")
    return parsed


def _plain(action: argparse.Action, value: Any) -> Any:
    """Return a flag's value, either a stated text or a default, as TOML stores it; None to omit
    it."""
    if value is None or value is argparse.SUPPRESS:
        return None
    if action.nargs == 0:
        return bool(value == action.const)
    if isinstance(value, Mapping):  # shifts of late cameras
        return ",".join(f"{name}={number}" for name, number in value.items())
    if isinstance(value, list):
        several = [_plain(action, entry) for entry in value]
        return several if action.nargs in ("+", "*") else ",".join(map(str, several))
    if action.type in (int, float, path_or_name) and isinstance(value, str):
        return action.type(value)
    if isinstance(value, Path) or action.type is Path:
        return str(resolve_path(value))
    return value if isinstance(value, (int, float)) else str(value)


def _without_none(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values, also in nested tables, without None, which TOML does not have."""
    return {
        name: _without_none(value) if isinstance(value, Mapping) else value
        for name, value in values.items()
        if value is not None
    }
