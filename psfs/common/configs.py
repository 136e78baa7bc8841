"""Configs (frozen dataclasses, made of smaller ones) from plain values, as JSON and TOML hold
them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import field, fields, is_dataclass, replace
from types import NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from cl import InputError

T = TypeVar("T")


def config_of(kind: type[T], values: Mapping[str, Any], where: str = "") -> T:
    """Return the config of class `kind` with `values`, the inverse of `dataclasses.asdict`.

    What is not stated has its default; lists become tuples. `where` precedes the names in errors.
    Raises InputError for a name that is no field, for a value of another kind and for what the
    config itself refuses.
    """
    return changed_config(kind(), values, where)


def changed_config(config: T, values: Mapping[str, Any], where: str = "") -> T:
    """Return `config` with other `values`, as `config_of` takes them."""
    kinds, stated = get_type_hints(type(config)), {}
    names = [entry.name for entry in fields(config)]  # type: ignore[arg-type]
    for name, value in values.items():
        path = f"{where}.{name}" if where else name
        if name not in names:
            raise InputError(f"{path}: no such setting; expected some of {', '.join(names)}")
        if is_dataclass(kinds[name]):
            if not isinstance(value, Mapping):
                raise InputError(f"{path} is {value!r}; expected settings with names")
            stated[name] = changed_config(getattr(config, name), value, path)
        else:
            stated[name] = _value_of(kinds[name], value, path)
    changed: T = replace(config, **stated)  # type: ignore[type-var]
    return changed


def with_settings(parts: Mapping[str, type]) -> Callable[[type[T]], type[T]]:
    """Return a decorator that gives a class, before it becomes a dataclass, a field for each of
    `parts` that it does not have: settings of a class, with its defaults."""

    def extended(kind: type[T]) -> type[T]:
        for name, part in parts.items():
            if name not in kind.__annotations__:
                kind.__annotations__[name] = part
                setattr(kind, name, field(default_factory=part))
        return kind

    return extended


def _value_of(kind: Any, value: Any, path: str) -> Any:
    if get_origin(kind) is tuple:
        if not isinstance(value, (list, tuple)):
            raise InputError(f"{path} is {value!r}; expected a list")
        inner = get_args(kind)[0]
        return tuple(_value_of(inner, entry, path) for entry in value)
    allowed = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    if not any(_is_a(value, one) for one in allowed):
        expected = " or ".join(_WORDS.get(one, str(one)) for one in allowed)
        raise InputError(f"{path} is {value!r}; expected {expected}")
    return float(value) if float in allowed and value is not None else value


_WORDS: dict[Any, str] = {
    float: "a number", int: "a whole number", bool: "true or false", str: "a text", NoneType: "none"
}  # fmt: skip


def _is_a(value: Any, kind: Any) -> bool:
    if kind is float:
        return isinstance(value, (int, float)) and type(value) is not bool and math.isfinite(value)
    if kind is int:
        return isinstance(value, int) and type(value) is not bool
    return isinstance(value, kind) if kind in _WORDS else True
