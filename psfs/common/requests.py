"""Requests: what a command, a script or a page asks for, as typed models. The flags of a command,
the tables of its --config and the `settings.toml` beside its results are derived from them.

A field with a `Flag` is a flag. A field with a `Part` holds the settings of a room: its settings
that name a flag are flags, too, and with `Part.table` all of them are a table of --config.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, ClassVar, Literal, TypeAlias, TypeVar, get_args, get_origin

import tomli_w
from pydantic import ConfigDict, PrivateAttr
from pydantic.fields import FieldInfo

from cl import InputError
from psfs.common.config import (
    Config,
    SettingError,
    about,
    field_choices,
    field_kinds,
    fields_below,
    part_kind,
)
from psfs.common.files import read_toml, resolve_path, write_text

R = TypeVar("R", bound="Request")

#: The name of the file with a request's settings, beside its results.
SETTINGS = "settings.toml"
#: What flags of these types take, for messages.
NUMBERS: dict[Any, str] = {float: "a number, such as 1.5", int: "a whole number"}


@dataclass(frozen=True)
class Group:
    """A heading of --help, and a line below it."""

    title: str
    description: str | None = None


@dataclass(frozen=True)
class Flag:
    """How a field is written on a command line.

    help: one sentence, with the default. metavar: name of the value. parse: converts the text;
    raises InputError. text: its inverse. name: without dashes, by default the field's. short: of
    one letter. either: flags of the same `either` exclude each other. nargs: as of argparse.
    saved: whether it is a setting, rather than where results go and what is printed.
    """

    help: str
    metavar: str = ""
    parse: Callable[[str], Any] | None = None
    text: Callable[[Any], str] | None = None
    name: str = ""
    short: str = ""
    group: Group | None = None
    choices: tuple[Any, ...] = ()
    either: str = ""
    nargs: str = ""
    positional: bool = False
    saved: bool = True
    required: bool = False


@dataclass(frozen=True)
class Part:
    """How the settings of a room are part of a request.

    only, without: names of the settings with flags. table: name of the table of --config; empty
    for none. texts: how the text of a setting's flag is parsed, and written, by its name.
    default: the text of --help on the value without the flag. fill: whether a flag's value is
    written beside results even if it is the default. extra: flags that stand for several settings.
    """

    group: Group | None = None
    only: Collection[str] | None = None
    without: Collection[str] = ()
    table: str = ""
    texts: Mapping[str, tuple[Callable[[str], Any], Callable[[Any], str] | None]] = field(
        default_factory=dict
    )
    default: Callable[[tuple[str, ...], FieldInfo], str] | None = None
    fill: bool = False
    extra: Mapping[str, Flag] = field(default_factory=dict)
    groups: Mapping[str, Group] = field(default_factory=dict)


@dataclass(frozen=True)
class Option:
    """A flag of a command. dest: the name of its field or setting. part: the field of the request
    whose settings it sets at `paths`; empty for a field of its own."""

    dest: str
    flag: Flag
    kind: Any
    default: Any
    required: bool = False
    part: str = ""
    paths: tuple[tuple[str, ...], ...] = ()
    fill: bool = True

    @property
    def name(self) -> str:
        """The name in --config, and of the long flag."""
        return self.flag.name or self.dest.replace("_", "-")

    @property
    def switch(self) -> bool:
        """Whether the flag takes no value."""
        return self.kind is bool

    @property
    def several(self) -> bool:
        """Whether the flag takes a list of values."""
        return self.flag.nargs in ("+", "*")

    def parse(self, text: str) -> Any:
        """Return the value of one text. Raises ValueError (InputError with a reason)."""
        if self.flag.parse is not None:
            return self.flag.parse(text)
        return self.kind(text) if self.kind in (int, float, Path) else text

    def plain(self, value: Any) -> Any:
        """Return a value as TOML stores it; None to leave it out."""
        if value is None:
            return None
        if self.switch:
            return bool(value) is not bool(self.default)
        if self.several:
            return [self._one(item) for item in value]
        return self._one(value)

    def _one(self, value: Any) -> Any:
        if self.flag.text is not None:
            return self.flag.text(value)
        if isinstance(value, Path):
            return str(resolve_path(value))
        if isinstance(value, slice):
            ends = [value.start, value.stop] + ([] if value.step is None else [value.step])
            return ":".join("" if end is None else str(end) for end in ends)
        if isinstance(value, (tuple, list)):
            return ",".join(map(str, value))
        return value if isinstance(value, (int, float)) else str(value)


@dataclass(frozen=True)
class Stated:
    """What a command line and its files state.

    values: of flags, by destination. tables: of --config. preset: tables of the preset, whose flags
    are among the values, see `with_preset`. file: that errors of tables name. chosen: destinations
    of the flags that the user, rather than a preset, set to another value than the default.
    """

    values: Mapping[str, Any] = field(default_factory=dict)
    tables: Mapping[str, Any] = field(default_factory=dict)
    file: Path | str | None = None
    preset: Mapping[str, Any] = field(default_factory=dict)
    chosen: frozenset[str] = frozenset()

    def over(self, below: Stated) -> Stated:
        """Return what both state; what this one states counts."""
        return Stated(
            {**below.values, **self.values},
            merge_tables(below.tables, self.tables),
            self.file or below.file,
        )

    def only(self, kind: type[Request]) -> Stated:
        """Return what of this concerns the flags of a request of this `kind`."""
        known = {option.dest for option in list_options(kind)}
        return replace(self, values={d: v for d, v in self.values.items() if d in known})

    def with_preset(self, kind: type[Request]) -> Stated:
        """Return this with the flags and tables of the preset, if one is stated, beneath, and with
        `chosen`. Raises InputError."""
        options = {option.dest: option for option in list_options(kind)}
        chosen = frozenset(d for d, value in self.values.items() if value != options[d].default)
        name = self.values.get("preset")
        if name is None:
            return replace(self, chosen=chosen)
        flags, tables = split_tables(read_preset(kind.PRESETS, name))
        known = {option.name for option in options.values()}  # psfs' presets have fewer flags
        file = kind.PRESETS[name][-1]
        preset = read_flags(file, kind, {n: v for n, v in flags.items() if n in known})
        values = {**without_excluded(kind, preset, self.values), **self.values}
        return Stated(values, self.tables, self.file or file, tables, chosen)

    def read_table(self, name: str, kind: type[Config]) -> Any:
        """Return the settings of a table as the files state them; None if they state none. Raises
        InputError that names the file."""
        if name not in self.tables and name not in self.preset:
            return None
        table = merge_tables(self.preset.get(name, {}), self.tables.get(name, {}))
        try:
            return kind.from_dict(table, name)
        except InputError as error:
            raise InputError(f"{self.file}: {error}") from None


class Request(Config):
    """What is asked for. Subclasses have a field for each flag, and parts for settings of rooms."""

    model_config = ConfigDict(arbitrary_types_allowed=True, allow_inf_nan=True)
    #: The command that takes it.
    COMMAND: ClassVar[str] = ""
    #: The rest of the command's description, after its help.
    DETAILS: ClassVar[str] = ""
    #: The presets among which --preset chooses.
    PRESETS: ClassVar[Presets] = {}
    _stated: Stated | None = PrivateAttr(None)
    _chosen: frozenset[str] | None = PrivateAttr(None)

    @classmethod
    def from_stated(cls: type[R], stated: Stated) -> R:
        """Return the request that a command line states. Raises InputError."""
        preset, stated = stated, stated.with_preset(cls)
        values = {
            name: cls.make_part(name, stated) if find_part(info) else stated.values[name]
            for name, info in cls.model_fields.items()
            if name in stated.values or find_part(info)
        }
        try:
            request = cls(**values)
        except SettingError as error:
            names = {option.dest: option.name for option in list_options(cls) if not option.part}
            if error.path not in names:
                raise
            raise InputError(f"--{names[error.path]}{error.problem}") from None
        request._stated, request._chosen = preset, stated.chosen
        return request

    @classmethod
    def make_part(cls, name: str, stated: Stated) -> Config:
        """Return the settings of a part as files and flags state them. Raises InputError."""
        info = cls.model_fields[name]
        kind, part = part_kind(info), find_part(info)
        assert kind is not None and part is not None
        base = stated.read_table(part.table, kind) or info.get_default(call_default_factory=True)
        return set_flags(cls, name, base, stated.values)

    def replace(self: R, **changes: Any) -> R:
        """Return this request with other values of some fields."""
        other: Any = super().replace(**changes)
        other._stated, other._chosen = self._stated, self._chosen
        return other

    def check_folders(self) -> None:
        """Raise InputError for what is wrong before anything else is imported."""

    @property
    def chosen(self) -> frozenset[str]:
        """The destinations of the flags that are not at their defaults; what a preset chose does
        not count."""
        if self._chosen is not None:
            return self._chosen
        return frozenset(o.dest for o in list_options(type(self)) if self.value(o) != o.default)

    @property
    def stated(self) -> Stated:
        """What was stated for it, as on a command line."""
        if self._stated is not None:
            return self._stated
        tables = list_tables(type(self))
        values = {
            o.dest: self.value(o) for o in list_options(type(self))
            if o.dest in self.chosen and o.part not in tables
        }  # fmt: skip
        return Stated(values, {t: getattr(self, name).to_dict() for name, t in tables.items()})

    def value(self, option: Option) -> Any:
        """Return the value of a flag; None for a flag that stands for several settings."""
        if not option.part:
            return getattr(self, option.dest)
        if not option.paths:
            return None
        value = getattr(self, option.part)
        for name in option.paths[0]:
            value = getattr(value, name)
        return value

    def refuse(self, dests: Iterable[str], why: str) -> None:
        """Raise InputError for the first of these flags, by destination, that is not at its
        default. why: where the flag has an effect, or what to do."""
        refuse_unused(type(self), self.chosen, dests, why)


def refuse_unused(
    kind: type[Request], chosen: Collection[str], dests: Iterable[str], why: str
) -> None:
    """Raise InputError for the first of the `chosen` flags that is among `dests`."""
    unused = set(dests).intersection(chosen)
    for option in list_options(kind):
        if option.dest in unused:
            raise InputError(f"--{option.name} {why}")


def find_part(info: FieldInfo) -> Part | None:
    """Return how a field is part of a request, None for a field that is none."""
    return next((item for item in info.metadata if isinstance(item, Part)), None)


@cache
def list_options(kind: type[Request]) -> tuple[Option, ...]:
    """Return the flags of a request, in the order of its fields."""
    options: list[Option] = []
    for name, info in kind.model_fields.items():
        flag = next((item for item in info.metadata if isinstance(item, Flag)), None)
        part = find_part(info)
        if flag is not None:
            if name == "preset":
                flag = replace(flag, choices=tuple(kind.PRESETS))
            options.append(_make_option(name, flag, info))
        if part is not None:
            options += _part_options(name, part, info)
    return tuple(options)


def _make_option(name: str, flag: Flag, info: FieldInfo) -> Option:
    kinds = [kind for kind in field_kinds(info) if kind is not NoneType]
    first = kinds[0]
    if get_origin(first) is tuple:
        first = get_args(first)[0]
    if get_origin(first) is Literal and not flag.choices:
        flag = replace(flag, choices=get_args(first))
    default = None if info.is_required() else info.get_default(call_default_factory=True)
    return Option(name, flag, first, default, flag.required or info.is_required())


def _part_options(name: str, part: Part, info: FieldInfo) -> Iterator[Option]:
    """Yield the flags of a part; one that several settings share once."""
    kind = part_kind(info)
    assert kind is not None
    for dest, flag in part.extra.items():
        yield Option(dest, flag, bool if not flag.metavar else str, None, part=name, fill=False)
    if part.only is not None and not part.only:
        return
    flagged = [(path, within) for path, within in fields_below(kind) if about(within, "flag")]
    defaults = info.get_default(call_default_factory=True)
    known: set[str] = set()
    for path, within in flagged:
        dest, flag_name = path[-1], about(within, "flag")
        left_out = part.only is not None and dest not in part.only
        if flag_name in known or dest in part.without or left_out:
            continue
        known.add(flag_name)
        paths = tuple(other for other, _ in flagged if other[-1] == dest)
        parse, text = part.texts.get(dest, (None, None))
        first, *_ = field_kinds(within)
        value = defaults
        for step in path:
            value = getattr(value, step)
        stated = FieldInfo.merge_field_infos(within, default=value)
        usual = (part.default or usual_value)(path, stated)
        flag = Flag(
            f"{about(within, 'flag_help') or _describe(within)} (default: {usual})",
            about(within, "metavar"),
            parse,
            text,
            name=flag_name.removeprefix("--"),
            group=part.groups.get(dest, part.group),
            choices=() if parse else field_choices(within),
        )
        yield Option(dest, flag, first, value, part=name, paths=paths, fill=part.fill)


def usual_value(path: tuple[str, ...], info: FieldInfo) -> str:
    """Return the text for --help about the value without the flag: the default, or its source if
    the default is None."""
    if info.default is None:
        return about(info, "source")
    return f"{info.default:g}" if isinstance(info.default, float) else str(info.default)


def _describe(info: FieldInfo) -> str:
    text = (info.description or "").rstrip(".")
    return ", ".join(filter(None, (text[:1].lower() + text[1:], about(info, "unit"))))


def set_flags(
    kind: type[Request], name: str, config: Any, values: Mapping[str, Any], without: Any = ()
) -> Any:
    """Return the settings of a part with the values that flags state, except those below the paths
    in `without`. Raises InputError that names the flag."""
    stated: dict[tuple[str, ...], Any] = {}
    flags: dict[str, str] = {}
    for option in list_options(kind):
        if option.part != name or values.get(option.dest) is None:
            continue
        for path in option.paths:
            dotted = ".".join(path)
            if dotted.startswith(tuple(without)):
                continue
            flags[dotted], stated[path] = option.name, values[option.dest]
    try:
        return config.overlay(nest_tables(stated))
    except SettingError as error:
        if error.path in flags:
            raise InputError(f"--{flags[error.path]}{error.problem}") from None
        raise


def nest_tables(values: Mapping[tuple[str, ...], Any]) -> dict[str, Any]:
    """Return values by the paths of names that lead to them as nested tables."""
    whole: dict[str, Any] = {}
    for path, value in values.items():
        table = whole
        for name in path[:-1]:
            table = table.setdefault(name, {})
        table[path[-1]] = value
    return whole


def collect_flags(request: Request, tables: Collection[str] = ()) -> dict[str, Any]:
    """Return the flags of a request by their names, as TOML has them, without those that are no
    settings, or belong to parts that are written as `tables`."""
    flags: dict[str, Any] = {}
    for option in list_options(type(request)):
        if not option.flag.saved or option.flag.positional or option.part in tables:
            continue
        value = request.value(option)
        if not option.fill and value == option.default:
            continue
        if (plain := option.plain(value)) is not None:
            flags[option.name] = plain
    return flags


def write_settings(folder: Path, request: Request, tables: Collection[str] = ()) -> None:
    """Write the settings of a request into `folder`; tables: parts of which all are written."""
    parts = {
        list_tables(type(request))[name]: getattr(request, name).model_dump(exclude_none=True)
        for name in tables
    }
    head = (
        f"# The settings of `{request.COMMAND}`, to be given back with --config.\n"
        "# Flags first, then tables with all settings that have no flag; what is left out has its "
        "default.\n\n"
    )
    text = head + tomli_w.dumps({**collect_flags(request, tables), **parts})
    write_text(folder / SETTINGS, text)


def collect_settings(request: Request) -> dict[str, Any]:
    """Return all settings of a request: flags by name, and each part that is a table."""
    tables = list_tables(type(request))
    parts = {name: getattr(request, name).to_dict() for name in tables}
    return {**collect_flags(request, tables), **parts}


def list_tables(kind: type[Request]) -> dict[str, str]:
    """Return the parts of a request that are tables of --config, with the tables' names."""
    parts = {name: find_part(info) for name, info in kind.model_fields.items()}
    return {name: part.table for name, part in parts.items() if part and part.table}


def split_tables(content: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the flags and the tables of a file."""
    tables = {name: value for name, value in content.items() if isinstance(value, Mapping)}
    return {name: value for name, value in content.items() if name not in tables}, tables


def without_excluded(
    kind: type[Request], values: Mapping[str, Any], stated: Collection[str]
) -> dict[str, Any]:
    """Return the values of flags, by destination, that are not stated, nor exclude a stated one."""
    options = {option.dest: option for option in list_options(kind)}
    groups = {options[dest].flag.either for dest in stated} - {""}
    return {
        dest: value for dest, value in values.items()
        if dest not in stated and options[dest].flag.either not in groups
    }  # fmt: skip


def read_config(kind: type[Request], file: Path) -> Stated:
    """Return what a file of --config states. Raises InputError that names the file."""
    flags, tables = split_tables(read_toml(file))
    known = list_tables(kind).values()
    for name in tables:
        if name not in known:
            expected = ", ".join(f"[{table}]" for table in known) or "no table"
            raise InputError(f"{file}: has a table [{name}]; expected {expected}")
    return Stated(read_flags(file, kind, flags), tables, file)


def read_flags(where: Path | str, kind: type[Request], flags: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values, by destination, of the flags that a file states by their names. Raises
    InputError."""
    options = [o for o in list_options(kind) if o.flag.saved and not o.flag.positional]
    by_name = {option.name: option for option in options}
    values = {}
    for stated, value in flags.items():
        if stated not in by_name:
            near = difflib.get_close_matches(stated, by_name, 1)
            hint = f"did you mean {near[0]}?" if near else f"see {kind.COMMAND} --help"
            raise InputError(f"{where}: {stated} is no setting of {kind.COMMAND}; {hint}")
        values[by_name[stated].dest] = _read_value(where, by_name[stated], value)
    return values


def _read_value(where: Path | str, option: Option, value: Any) -> Any:
    """Return a file's value as the command line would give it."""
    if option.switch:
        if not isinstance(value, bool):
            raise InputError(f"{where}: {option.name} is {value!r}; expected true or false")
        return value is not bool(option.default)
    if isinstance(value, list) != option.several:
        expected = "a list" if option.several else "one value"
        raise InputError(f"{where}: {option.name} is {value!r}; expected {expected}")
    if option.several:
        return tuple(_read_one(where, option, item) for item in value)
    return _read_one(where, option, value)


def _read_one(where: Path | str, option: Option, value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise InputError(f"{where}: {option.name} is {value!r}; expected a text or a number")
    try:
        parsed = option.parse(str(value))
    except ValueError as error:
        expected = NUMBERS.get(option.kind, "another value")
        detail = error if isinstance(error, InputError) else f"expected {expected}"
        raise InputError(f"{where}: {option.name} is {value!r}; {detail}") from None
    if option.flag.choices and parsed not in option.flag.choices:
        listed = ", ".join(map(str, option.flag.choices))
        raise InputError(f"{where}: {option.name} is {value!r}; expected one of {listed}")
    return parsed


#: The files of each preset, those of the part before first.
Presets: TypeAlias = Mapping[str, Sequence[Path]]


def find_presets(folder: Path, before: Presets | None = None) -> dict[str, list[Path]]:
    """Return the presets that lie in `folder`, NAME.toml each; one whose name is known `before`
    adds to that."""
    known = before or {}
    return {path.stem: [*known.get(path.stem, ()), path] for path in sorted(folder.glob("*.toml"))}


def read_preset(presets: Presets, name: str) -> dict[str, Any]:
    """Return the settings of a preset. Raises InputError for an unknown name."""
    if name not in presets:
        raise InputError(f"preset {name!r}; expected {', '.join(presets) or 'none'}")
    settings: dict[str, Any] = {}
    for path in presets[name]:
        settings = merge_tables(settings, read_toml(path))
    return settings


def merge_tables(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of both, table by table; where both state one, that of `above`."""
    joined = dict(below)
    for name, value in above.items():
        under = joined.get(name)
        both = isinstance(value, Mapping) and isinstance(under, Mapping)
        joined[name] = merge_tables(under, value) if both else value  # type: ignore[arg-type]
    return joined
