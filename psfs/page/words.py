"""Pieces of HTML for the page's panels, from texts that are escaped."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

from psfs.common.ranges import escape_unprintable

_HEAD = "padding:1px 8px 1px 0;vertical-align:bottom;text-align:left"
_CELL = "padding:1px 8px 1px 0;vertical-align:top;white-space:nowrap"
#: Least time between two changes of a page, s: browsers draw whole panels again.
REFRESH = 0.2
#: Signs before a line, so that its kind does not depend on a colour.
_SIGNS = {"warning": "⚠", "note": "•", "good": "✓"}


def escape(text: object) -> str:
    """Return a text as HTML that shows it as it is."""
    return html.escape(escape_unprintable(str(text)))


def make_table(rows: Iterable[Sequence[object]], heading: Sequence[object] = ()) -> str:
    """Return rows of texts as an HTML table."""
    head = "".join(f"<th style='{_HEAD}'>{escape(c)}</th>" for c in heading)
    body = "".join(
        "<tr>" + "".join(f"<td style='{_CELL}'>{escape(cell)}</td>" for cell in row) + "</tr>"
        for row in rows
    )
    return _block(
        f"<table style='border-spacing:0'>{f'<tr>{head}</tr>' if head else ''}{body}</table>"
    )


def classify(line: str, kind: str) -> tuple[str, str]:
    """Return kind and text of a line that a command has printed; `kind` where it states none."""
    stated, _, text = line.partition(": ")
    return (stated, text) if stated in _SIGNS else (kind, line)


def make_lines(lines: Iterable[tuple[str, object]]) -> str:
    """Return lines of text, each with its kind: a key of `_SIGNS`."""
    return _block("".join(f"<div>{_SIGNS[kind]} {escape(text)}</div>" for kind, text in lines))


def make_text(text: object) -> str:
    """Return one passage of text."""
    return _block(f"<div>{escape(text)}</div>")


def make_code(text: object) -> str:
    """Return a command as it is typed, small."""
    style = "font-family:monospace;font-size:0.85em;opacity:0.6;padding:4px 0"
    return _block(f"<div style='{style}'>{escape(text)}</div>")


def make_steps(steps: Sequence[str], current: str) -> str:
    """Return a numbered row of steps; those before the current one are ticked, it is marked."""
    number = steps.index(current)
    cells = []
    for index, step in enumerate(steps):
        sign = _SIGNS["good"] if index < number else str(index + 1)
        style = "font-weight:bold;border-bottom:2px solid" if index == number else "opacity:0.6"
        style += ";margin-right:6px;padding:2px 0;white-space:nowrap"
        cells.append(f"<span style='{style}'>{sign} {escape(step)}</span>")
    return _block("".join(cells))


def make_scale(text: str, colours: Sequence[str]) -> str:
    """Return a strip of colours, as CSS has them, and what its ends mean; nothing without
    colours."""
    if not colours:
        return ""
    strip = f"height:10px;background:linear-gradient(to right,{','.join(colours)})"
    return _block(f"<div style='{strip}'></div><div>{escape(text)}</div>")


def _block(content: str) -> str:
    style = "font-size:0.85em;padding:2px 9px;overflow-x:auto;overflow-wrap:break-word"
    return f"<div style='{style}'>{content}</div>"
