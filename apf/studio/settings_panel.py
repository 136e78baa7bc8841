"""All settings that `apf track --config` takes, as fields that are made from the settings' tree."""

from __future__ import annotations

import json
from collections.abc import Mapping
from types import NoneType
from typing import TYPE_CHECKING, Any

from pydantic.fields import FieldInfo

from apf.settings import Settings
from cl import InputError
from psfs.common.config import (
    Config,
    about,
    describe_range,
    field_choices,
    field_kinds,
    fields_below,
    part_kind,
)
from psfs.page.words import make_lines, make_text

if TYPE_CHECKING:
    import viser

#: The nodes of the tree that `apf track` takes tables of.
_NODES = ("method", "reconstruction")
_CLOSED = "(none)"


class ChosenSettings:
    """Values of settings that differ from the defaults, by the path of names that leads to each."""

    def __init__(self) -> None:
        self.fields: dict[tuple[str, ...], FieldInfo] = {}
        self._defaults: dict[str, Config] = {}
        for node in _NODES:
            kind = part_kind(Settings.model_fields[node])
            assert kind is not None
            self._defaults[node] = kind()
            self.fields |= dict(fields_below(kind, node))
        self.values: dict[tuple[str, ...], Any] = {}

    def default(self, path: tuple[str, ...]) -> Any:
        """Return the default of a setting."""
        value: Any = self._defaults[path[0]]
        for name in path[1:]:
            value = getattr(value, name)
        return value

    def set(self, path: tuple[str, ...], value: Any) -> None:
        """Choose a value. Raises InputError, which says what is expected, and keeps the old one."""
        kinds = field_kinds(self.fields[path])
        if isinstance(value, str) and str not in kinds and not field_choices(self.fields[path]):
            value = _parse(value, ".".join(path))
        if isinstance(value, int) and not isinstance(value, bool) and int not in kinds:
            value = float(value)
        tried = {**self.values, path: value}
        if value == self.default(path) or (value is None and NoneType not in kinds):
            tried.pop(path)
        tables = _nest(tried)
        for node, config in self._defaults.items():
            config.overlay(tables.get(node, {}), node)
        self.values = tried

    @property
    def tables(self) -> dict[str, Any]:
        """The values as tables for a TOML file."""
        return _nest(self.values)


class SettingsPanel:
    """The fields of one group of settings at a time, in the current folder of `gui`."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self.chosen, self._gui = ChosenSettings(), gui
        self._groups: dict[str, list[tuple[str, ...]]] = {}
        for path in self.chosen.fields:
            self._groups.setdefault(".".join(path[:-1]), []).append(path)
        self._folder = gui.add_folder("all settings", expand_by_default=False)
        with self._folder:
            self._group = gui.add_dropdown("group", [_CLOSED, *self._groups], initial_value=_CLOSED)
            self._message = gui.add_html(make_text("All are at their defaults."))
        self._shown: list[Any] = []
        self._group.on_update(lambda event: self.show(self._group.value))

    def show(self, group: str) -> None:
        """Show the fields of a group in place of those that are shown."""
        for field in self._shown:
            field.remove()
        self._shown = []
        with self._folder:
            for path in self._groups.get(group, []):
                self._shown.append(self._add_field(path))

    def _add_field(self, path: tuple[str, ...]) -> Any:
        field, value = (
            self.chosen.fields[path],
            self.chosen.values.get(path, self.chosen.default(path)),
        )
        source = about(field, "source")
        hint = " ".join(
            filter(
                None, (field.description, describe_range(field), source and f"Default: {source}.")
            )
        )
        kinds, choices = field_kinds(field), field_choices(field)
        if kinds == (bool,):
            shown: Any = self._gui.add_checkbox(path[-1], bool(value), hint=hint)
        elif choices:
            names = [str(choice) for choice in choices]
            shown = self._gui.add_dropdown(path[-1], names, initial_value=str(value), hint=hint)
        else:
            text = value if isinstance(value, str) else json.dumps(value, default=list)
            shown = self._gui.add_text(path[-1], text, hint=hint)
        shown.on_update(lambda event: self._change(path, shown.value))
        return shown

    def _change(self, path: tuple[str, ...], value: Any) -> None:
        try:
            self.chosen.set(path, value)
        except InputError as error:
            self._message.content = make_lines([("warning", error)])
            return
        lines = [f"{'.'.join(p)} = {value}" for p, value in self.chosen.values.items()]
        self._message.content = make_lines(("note", line) for line in lines) or make_text("")


def _parse(text: str, name: str) -> Any:
    """Return the value of a text as JSON. Raises InputError."""
    try:
        return json.loads(text)
    except ValueError:
        raise InputError(f"{name} is {text!r}; expected a number, a list or null") from None


def _nest(values: Mapping[tuple[str, ...], Any]) -> dict[str, Any]:
    """Return values by paths as nested tables."""
    whole: dict[str, Any] = {}
    for path, value in values.items():
        table = whole
        for name in path[:-1]:
            table = table.setdefault(name, {})
        table[path[-1]] = value
    return whole
