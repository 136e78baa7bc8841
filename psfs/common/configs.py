"""Configs (frozen dataclasses, made of smaller ones) from plain values, as JSON holds them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any, TypeVar, get_type_hints

T = TypeVar("T")


def config_of(kind: type[T], values: Mapping[str, Any]) -> T:
    """Return the config of class `kind` with `values`, the inverse of `dataclasses.asdict`.

    Fields that are not stated have their defaults. Raises KeyError for a name that is no field,
    TypeError for a part that is no mapping, InputError for what the config refuses.
    """
    kinds, stated = get_type_hints(kind), {}
    for name, value in dict(values).items():
        part = kinds[name]
        stated[name] = config_of(part, value) if is_dataclass(part) else value  # type: ignore[arg-type]
    return kind(**stated)
