"""A table as data: printed by rich, or written as Markdown, also between marks of a page."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rich import box
from rich.table import Table

from cl import InputError
from psfs.cli.commandline import stdout
from psfs.common.files import write_text

#: Placeholder for a missing figure.
NONE = "-"


@dataclass(frozen=True)
class Grid:
    """A table of text. note: an explanation below it."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""

    def show(self) -> None:
        """Print it to the terminal; the first column is left-aligned, figures are right-aligned."""
        table = Table(box=box.SIMPLE, collapse_padding=True, pad_edge=False)
        for k, column in enumerate(self.columns):
            justify: Literal["left", "right"] = "right" if self._is_figures(k) else "left"
            widest = max(
                (len(row[k].strip("*_")) for row in self.rows), default=0
            )  # heads may fold
            table.add_column(
                column, justify=justify, no_wrap=not k, overflow="fold", min_width=widest
            )
        for row in self.rows:
            table.add_row(*(cell.strip("*_") for cell in row))
        stdout.print(f"\n{self.title}", style="bold")
        stdout.print(table)
        if self.note:
            stdout.print(self.note)

    def markdown(self) -> str:
        """Return it with its title in bold above and its note below."""
        rule = ["--:" if self._is_figures(k) else "---" for k in range(len(self.columns))]
        lines = ["| " + " | ".join(cells) + " |" for cells in (self.columns, rule, *self.rows)]
        return "\n".join([f"**{self.title}**", "", *lines, *(["", self.note] if self.note else [])])

    def _is_figures(self, column: int) -> bool:
        cells = [row[column].lstrip("-") for row in self.rows]
        return column > 0 and all(not cell or cell[0].isdigit() for cell in cells)


def number(value: float | None, digits: int = 3) -> str:
    """Format with `digits` significant digits and thousands separated, never as a power of ten;
    NONE for None."""
    if value is None:
        return NONE
    if value == 0:
        return "0"
    shown = float(f"{value:.{digits}g}")
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(shown))))
    return f"{shown:,.{decimals}f}"


def cell(value: float, form: str, unit: str = "") -> str:
    """Format with a format specification and a unit; NONE for NaN."""
    return NONE if math.isnan(value) else f"{value:{form}}{unit}"


def ratio(value: float | None) -> str:
    return NONE if value is None else f"{number(value)} x"


def quote(value: float | None) -> str:
    """Format a paper's figure with all the digits that the paper gives."""
    return NONE if value is None else f"{value:,}"


def replace_marked(path: Path, name: str, made: str) -> None:
    """Write `made` between the marks of that name in a file. Raises InputError if they are
    missing."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    text = path.read_text()
    pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    if len(pattern.findall(text)) != 1:
        raise InputError(f"{path}: expected {begin} and {end}, once")
    write_text(path, pattern.sub(lambda _: f"{begin}\n{made}\n{end}", text))
