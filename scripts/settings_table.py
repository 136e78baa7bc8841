"""Write docs/settings.md from the tree of settings: `python scripts/settings_table.py`."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from functools import reduce
from pathlib import Path

from pydantic.fields import FieldInfo

from apf.settings import Settings
from psfs.common.config import Config, about, describe_range, field_choices, fields_below, part_kind

PAGE = Path(__file__).parents[1] / "docs" / "settings.md"
_HEAD = """# Settings

This page is generated from the code by `python scripts/settings_table.py`; a test compares them.

Each section is a node of the tree `apf.settings.Settings`. The nodes `reconstruction`, `method`,
`live` and `calibration` can be stated as tables of `--config FILE.toml`, in presets and in the
`settings.toml` beside results, for the commands that use them; `capture` is what `sequence.toml`
may hold. In Python every node is a class whose arguments these are, `config.replace(...)` changes
some, and what lies outside its range raises `InputError`. An empty range means any value of the
default's kind.
"""


def page() -> str:
    """Return the text of the page."""
    return "\n".join([_HEAD, *_sections(Settings(), "", {})])


def _sections(config: Config, where: str, shown: dict[type[Config], str]) -> Iterator[str]:
    """Yield a section for each part of `config`; classes in `shown` are not shown again."""
    for name, field in type(config).model_fields.items():
        kind, inner = part_kind(field), getattr(config, name)
        if kind is None:
            continue
        path = f"{where}.{name}" if where else name
        yield f"{'###' if where else '##'} {path}\n"
        if kind in shown:
            yield _again(inner, shown[kind])
            continue
        shown[kind] = path
        yield f"`{kind.__name__}`: {' '.join((inspect.getdoc(kind) or '').split())}\n"
        rows = [_row(inner, *item) for item in kind.model_fields.items() if not part_kind(item[1])]
        if rows:
            head = "| setting | default | unit or range | flag | what it is | source |"
            yield "\n".join([head, "|---|---|---|---|---|---|", *rows, ""])
        yield from _sections(inner, path, shown)


def _again(config: Config, before: str) -> str:
    """Return a section for a class that already has one in `before`, with the differences."""
    others = []
    for path, _ in fields_below(type(config)):
        own, usual = (reduce(getattr, path, of) for of in (config, type(config)()))
        if own != usual:
            others.append(f"`{'.'.join(path)}` = `{own}`")
    differs = f", but for {', '.join(others)}" if others else ""
    return f"As `{before}`{differs}.\n"


def _row(config: Config, name: str, field: FieldInfo) -> str:
    value = getattr(config, name)
    default = "" if value is None else f"`{value}`"
    takes = (
        describe_range(field) or ", ".join(map(str, field_choices(field))) or about(field, "unit")
    )
    flag = f"`{about(field, 'flag')}`" if about(field, "flag") else ""
    source = about(field, "source") or config.SOURCE
    cells = (f"`{name}`", default, takes, flag, field.description or "", source)
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
