"""The base of all settings: frozen pydantic models whose fields state what they are, their unit,
their range and where their defaults come from."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, ClassVar, Literal, TypeVar, Union, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidationInfo,
    create_model,
    field_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError

from cl import InputError
from psfs.common.ranges import LARGEST, SHOWN, SMALLEST, escape_unprintable, range_text

C = TypeVar("C", bound="Config")


class SettingError(InputError):
    """Error of a setting: the path of names that leads to it, and the problem."""

    def __init__(self, problem: str, path: str = "") -> None:
        super().__init__(f"{path}{problem}" if path else problem.removeprefix(": "))
        self.path, self.problem = path, problem

    def within(self, name: str) -> SettingError:
        """Return the same error of settings that are a part of others, by the part's `name`."""
        return SettingError(self.problem, ".".join(filter(None, (name, self.path))))


class Config(BaseModel):
    """Settings of one room. Instances are frozen. Types are not converted, except lists to tuples
    and NumPy's numbers to Python's. Raises InputError (a ValueError) for an invalid value."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True
    )
    #: Source of the defaults whose fields do not state their own.
    SOURCE: ClassVar[str] = ""

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise _first_error(type(self), error) from None

    @field_validator("*", mode="before")
    @classmethod
    def _plain(cls, value: Any, info: ValidationInfo) -> Any:
        field = cls.model_fields[str(info.field_name)]
        registered = _extra(field).get("enum")
        if registered and value not in registered:
            raise PydanticCustomError("registered", "one of those that are registered")
        if isinstance(value, list) and Any not in field_kinds(field):
            return tuple(value)
        return value.item() if getattr(value, "ndim", None) == 0 else value

    def replace(self: C, **changes: Any) -> C:
        """Return these settings with other values of some; raise InputError as the class does."""
        values = {name: getattr(self, name) for name in self.__class__.model_fields}
        return type(self)(**{**values, **changes})

    def overlay(self: C, values: Mapping[str, Any], where: str = "") -> C:
        """Return these settings with `values` as JSON and TOML hold them, tables for the parts:
        what is not stated stays. `where` precedes the names in errors (InputError)."""
        changes: dict[str, Any] = {}
        try:
            for name, value in values.items():
                part = getattr(self, name) if name in self.__class__.model_fields else None
                deeper = isinstance(part, Config) and isinstance(value, Mapping)
                changes[name] = part.overlay(value, name) if deeper else value  # type: ignore[union-attr]
            return self.replace(**changes)
        except SettingError as error:
            raise error.within(where) from None

    @classmethod
    def from_dict(cls: type[C], values: Mapping[str, Any], where: str = "") -> C:
        """Return the inverse of `to_dict`; what is not stated has its default. Arguments and errors
        as of `overlay`."""
        return cls().overlay(values, where)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, tables for the parts."""
        return self.model_dump()


def setting(
    default: Any,
    description: str,
    source: str = "",
    unit: str = "",
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
    choices: Iterable[str] = (),
    flag: str = "",
    flag_help: str = "",
    metavar: str = "",
) -> Any:
    """Return a field: its default, what it is, where the default comes from and its unit.

    above, below: exclusive bounds; least, most: inclusive bounds. A number without a bound of its
    own is at most 1e9; it stays 1e-12 away from an exclusive bound. choices: registered names among
    which the setting chooses. flag, flag_help, metavar: the command-line flag, its help where that
    differs from `description`, and the name of its value.
    """
    bounds: dict[str, Any] = {"gt": above, "ge": least, "lt": below, "le": most}
    if isinstance(default, (int, float)) and not isinstance(default, bool):
        if above is None and least is None:
            bounds["ge"] = -LARGEST
        if below is None and most is None:
            bounds["le"] = LARGEST
        if above is not None and isinstance(default, float):
            bounds["ge"] = above + SMALLEST
    extra: dict[str, Any] = {"unit": unit, "source": source}
    extra |= {"flag": flag, "flag_help": flag_help, "metavar": metavar}
    extra["enum"] = [*choices]
    return Field(
        default,
        description=description,
        json_schema_extra={name: value for name, value in extra.items() if value},
        **{name: bound for name, bound in bounds.items() if bound is not None},
    )


#: A `setting` from 0 to 1; one above 0; one of 0 or more; and one of 1 or more.
fraction, positive = partial(setting, least=0, most=1), partial(setting, above=0)
nonnegative, natural = partial(setting, least=0), partial(setting, least=1)


def part(kind: type[Config], **defaults: Any) -> Any:
    """Return a field that holds settings of class `kind`, whose docstring says what they are; with
    other `defaults` of some."""
    return Field(default_factory=partial(kind, **defaults))


def with_parts(parts: Mapping[str, type[Any]]) -> Callable[[type[C]], type[C]]:
    """Return a decorator that gives a class of settings a field for each of `parts` that it does
    not have: settings of a class, with its defaults."""

    def extended(kind: type[C]) -> type[C]:
        fields: dict[str, Any] = {
            name: (inner, part(inner))
            for name, inner in parts.items()
            if name not in kind.model_fields
        }
        if not fields:
            return kind
        return create_model(
            kind.__name__, __base__=kind, __module__=kind.__module__, __doc__=kind.__doc__, **fields
        )

    return extended


def about(field: FieldInfo, name: str) -> str:
    """Return an entry of a field's metadata, such as its unit or flag; empty if it has none."""
    return str(_extra(field).get(name, ""))


def _extra(field: FieldInfo) -> dict[str, Any]:
    return field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}


def field_kinds(field: FieldInfo) -> tuple[Any, ...]:
    """Return the types that a field takes."""
    kind = field.annotation
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def field_choices(field: FieldInfo) -> tuple[Any, ...]:
    """Return the values among which a field chooses; empty for a field without choices."""
    kinds = [kind for kind in field_kinds(field) if get_origin(kind) is Literal]
    registered = tuple(_extra(field).get("enum", ()))
    return registered or tuple(value for kind in kinds for value in get_args(kind))


def part_kind(field: FieldInfo) -> type[Config] | None:
    """Return the class of the settings that a field holds; None for a single setting."""
    for kind in field_kinds(field):
        if isinstance(kind, type) and issubclass(kind, Config):
            return kind
    return None


def fields_below(kind: type[Config], *path: str) -> Iterator[tuple[tuple[str, ...], FieldInfo]]:
    """Yield every single setting of a class and of its parts, with the names that lead to it."""
    for name, field in kind.model_fields.items():
        inner = part_kind(field)
        if inner is None:
            yield (*path, name), field
        else:
            yield from fields_below(inner, *path, name)


def describe_range(field: FieldInfo) -> str:
    """Return the numbers that a field takes, as in `from 0 to 10 px`; empty where any."""
    bounds = {
        name: getattr(rule, name)
        for rule in field.metadata
        for name in ("gt", "ge", "lt", "le")
        if getattr(rule, name, None) is not None
    }
    if "gt" in bounds:
        bounds.pop("ge", None)
    if bounds.get("ge") == -LARGEST and bounds.get("le") == LARGEST:
        return ""
    text = range_text(**bounds)
    return " ".join(filter(None, (text, about(field, "unit"))))


_KINDS: dict[Any, str] = {
    float: "a number", int: "a whole number", bool: "true or false", str: "a text", Path: "a path"
}  # fmt: skip


def describe_expected(field: FieldInfo) -> str:
    """Return the text of an error message for the values that a field accepts."""
    if part_kind(field) is not None:
        return "settings with names"
    choices = field_choices(field)
    if choices:
        return ", ".join(map(str, choices))
    kinds = [kind for kind in field_kinds(field) if kind not in (Any, NoneType)]
    words = [_KINDS.get(kind, "a list") for kind in kinds]
    if float in kinds or int in kinds:
        words[0] = " ".join(filter(None, (words[0], describe_range(field))))
    return " or ".join(words)


def _first_error(kind: type[Config], error: ValidationError) -> SettingError:
    """Return the first of the errors with what was found and expected."""
    first = error.errors(include_url=False)[0]
    cause = (first.get("ctx") or {}).get("error")
    name = str(first["loc"][0]) if first["loc"] else ""
    if isinstance(cause, SettingError):
        return cause.within(name)
    field = kind.model_fields.get(name)
    if field is None and name:
        names = ", ".join(kind.model_fields)
        return SettingError(f": no such setting; expected some of {names}", name)
    if isinstance(cause, InputError):  # a sentence of its own
        return SettingError(f": {cause}")
    if cause is not None:
        return SettingError(f": {cause}", name)
    value = escape_unprintable(repr(first["input"]))[:SHOWN]
    place = "".join(f"[{step}]" for step in first["loc"][1:] if isinstance(step, int))
    expected = first["msg"].removeprefix("Input should be ")
    if field is not None and not place:
        expected = describe_expected(field)
    return SettingError(f"{place} is {value}; expected {expected}", name)
