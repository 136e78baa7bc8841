"""Write docs/settings.md, the public settings: `python scripts/settings_table.py`.

Public is what has a flag, may stand in sequence.toml (`capture`), or is stated by a paper's preset.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import resources
from itertools import groupby
from pathlib import Path
from typing import Any

from pydantic.fields import FieldInfo

from apf.settings import Settings
from psfs.common.config import Config, about, describe_range, field_choices, part_kind
from psfs.common.files import parse_toml

PAGE = Path(__file__).parents[1] / "docs" / "settings.md"
_HEAD = """# Settings

The settings that have a flag, that `sequence.toml` may hold, or that a paper's preset states. This
page is generated from the code by `python scripts/settings_table.py`; a test compares them.

Each section is a node of the tree `apf.settings.Settings`. The nodes `reconstruction`, `method`
and `live` can be stated as tables of `--config FILE.toml`, in presets and in the
`settings.toml` beside results; `capture` is what `sequence.toml` may hold. So
`method.filter.search.n_layers` is `n_layers` in the table `[method.filter.search]`. In Python every
node is a class whose arguments these are, and `config.replace(...)` changes some. What lies outside
its range raises `InputError`. The tree has more settings, each described beside its definition in a
`config.py`; they can be stated in the same way, and may change without notice.
"""
_TABLE = "| setting | default | unit or range | meaning | flag |\n|---|---|---|---|---|"


def page() -> str:
    """Return the text of the page."""
    stated = set(_preset_keys())
    rows = [
        (path, _row(config, path, field))
        for config, path, field in _leaves(Settings(), ())
        if about(field, "flag") or path in stated or path[0] == "capture"
    ]
    sections = [
        "\n".join([f"## {node}\n", _TABLE, *(row for _, row in group), ""])
        for node, group in groupby(rows, key=lambda row: row[0][0])
    ]
    return "\n".join([_HEAD, *sections])


def _leaves(
    config: Config, where: tuple[str, ...]
) -> Iterator[tuple[Config, tuple[str, ...], FieldInfo]]:
    """Yield the settings of a tree, each with its class's instance and its path."""
    for name, field in type(config).model_fields.items():
        if part_kind(field) is None:
            yield config, (*where, name), field
        else:
            yield from _leaves(getattr(config, name), (*where, name))


def _preset_keys() -> Iterator[tuple[str, ...]]:
    """Yield the paths of the settings that a preset states."""
    for package in ("apf", "psfs"):
        for file in (resources.files(package) / "presets").iterdir():
            if file.name.endswith(".toml"):
                yield from _keys(parse_toml(file.read_text(), file.name), ())


def _keys(table: Mapping[str, Any], where: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    for name, value in table.items():
        if isinstance(value, Mapping):
            yield from _keys(value, (*where, name))
        else:
            yield (*where, name)


def _row(config: Config, path: tuple[str, ...], field: FieldInfo) -> str:
    value = getattr(config, path[-1])
    default = "" if value is None else f"`{value}`"
    taken = describe_range(field) or ", ".join(map(str, field_choices(field)))
    flag = f"`{about(field, 'flag')}`" if about(field, "flag") else ""
    name = ".".join(path[1:])
    cells = (f"`{name}`", default, taken or about(field, "unit"), field.description or "", flag)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
