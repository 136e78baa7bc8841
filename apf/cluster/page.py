"""The overview of a folder of takes: an HTML page, and a table for programs."""

from __future__ import annotations

import csv
import html
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from urllib.parse import quote

from apf.cluster.record import RECORD, TakeRecord
from apf.cluster.take_row import THUMBNAIL, TakeRow
from apf.report import PAGE
from psfs.common.files import open_text, resolve_path, write_text

LOGS = "logs"
#: The files of the overview.
FILES = ("index.html", "takes.csv")
#: Columns of the page: field of the row, heading, explanation.
_COLUMNS = (
    ("name", "take", "folder of the results"),
    ("status", "status", ""),
    ("quality", "quality", "the verdict of the track's report"),
    ("frames", "frames", "tracked"),
    ("seconds", "length, s", "filmed"),
    ("lost_frames", "lost frames", "frames in which the person was lost"),
    ("limbs", "limbs", "lost where the truth is known, else doubtful by the report"),
    ("confidence", "confidence", "mean over the frames, 0 to 1"),
    ("misfit", "misfit", "mean over the frames, 0 is perfect"),
    ("height", "height, m", "of the body found"),
    ("mean_error", "error, mm", "mean over the joints, where there is a truth"),
    ("parts", "parts", "mm by which parts of a long take differ where they are joined"),
    ("took", "took, s", "of computing"),
    ("worker", "worker", ""),
    ("finished", "finished, UTC", ""),
)
#: Files that are linked if a take has them: name, text.
_LINKS = (
    (PAGE, "report"),
    ("overlay.mp4", "overlay"),
    ("motion.bvh", "bvh"),
    ("motion.glb", "glb"),
)
_TEXT = ("name", "status", "quality", "limbs", "parts", "worker", "finished")
_STYLE = """
body { font: 14px/1.4 system-ui, sans-serif; margin: 2em; color: #222; background: #fff }
table { border-collapse: collapse } th, td { padding: .35em .7em; border-bottom: 1px solid #ddd }
th { cursor: pointer; text-align: left; position: sticky; top: 0; background: #f4f4f4;
     user-select: none; white-space: nowrap }
th[aria-sort=ascending]::after { content: " \\25b2" }
th[aria-sort=descending]::after { content: " \\25bc" }
td.number { text-align: right; font-variant-numeric: tabular-nums } img { display: block }
tr.failed td { background: #fdecea } .doubt { color: #b3261e; font-weight: 600 }
.error:empty { display: none }
.error { color: #b3261e; min-width: 25em; max-width: 50em; overflow-wrap: anywhere }
.doubt { min-width: 5em }
"""
_SCRIPT = """
for (const head of document.querySelectorAll("th[data-column]")) head.onclick = () => {
  const up = head.getAttribute("aria-sort") !== "ascending", body = document.querySelector("tbody");
  document.querySelectorAll("th").forEach(other => other.removeAttribute("aria-sort"));
  head.setAttribute("aria-sort", up ? "ascending" : "descending");
  const value = row => row.cells[head.cellIndex].dataset.value;
  const number = head.dataset.column === "number";
  const rows = [...body.rows].sort((a, b) => {
    const [x, y] = [value(a), value(b)];
    if (x === "" || y === "") return (x === "") - (y === "");  // what has none comes last
    return (up ? 1 : -1) * (number ? x - y : x.localeCompare(y, undefined, {numeric: true}));
  });
  body.append(...rows);
};
"""


def read_rows(out: Path) -> dict[str, list[TakeRow]]:
    """Read the rows of every finished take in `out`, by the take's name."""
    if not out.is_dir():
        return {}
    found = {path.parent.name: TakeRecord.read(path.parent) for path in out.glob(f"*/{RECORD}")}
    return {
        name: [TakeRow.from_dict(row) for row in record.rows]
        for name, record in sorted(found.items())
        if record is not None and not name.startswith(".")
    }


def write_index(
    out: Path, failed: Mapping[str, TakeRow], unfinished: Iterable[TakeRow] = ()
) -> None:
    """Write index.html and takes.csv of the finished takes in `out` and of failed and unfinished
    ones.

    Raises InputError.
    """
    rows = read_rows(out) | {name: [row] for name, row in failed.items()}
    rows = {row.name: [row] for row in unfinished} | rows
    in_order = [row for name in sorted(rows) for row in rows[name]]
    with open_text(out / "takes.csv") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(TakeRow)])
        writer.writeheader()
        writer.writerows(row.plain() for row in in_order)
    write_text(out / "index.html", _format_page(out, in_order))


def _format_page(out: Path, rows: list[TakeRow]) -> str:
    heads = "".join(
        f'<th data-column="{"text" if name in _TEXT else "number"}" title="{html.escape(what)}">'
        f"{html.escape(head)}</th>"
        for name, head, what in _COLUMNS
    )
    body = "\n".join(_format_row(out, row) for row in rows)
    takes = {row.name.split("/")[0]: row.status for row in rows}
    states = list(takes.values())
    counts = ", ".join(
        f"{states.count(s)} {s}" for s in ("done", "failed", "waiting") if s in states
    )
    title = html.escape(resolve_path(out).name)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{title}: takes</title><style>{_STYLE}</style></head>\n"
        f"<body><h1>{title}</h1><p>{counts}. A click on a heading "
        'sorts. The same as a table: <a href="takes.csv">takes.csv</a></p>\n'
        f"<table><thead><tr><th></th>{heads}<th>files</th></tr></thead>\n<tbody>\n{body}\n</tbody>"
        f"</table>\n<script>{_SCRIPT}</script></body></html>\n"
    )


def _format_row(out: Path, row: TakeRow) -> str:
    picture = out / row.name / THUMBNAIL
    shown = (
        f'<img src="{_link(row.name, THUMBNAIL)}" alt="" width="120">' if picture.is_file() else ""
    )
    cells = "".join(_format_cell(row, name) for name, _, _ in _COLUMNS)
    kind = ' class="failed"' if row.status == "failed" else ""
    return f"<tr{kind}><td>{shown}</td>{cells}<td>{_format_links(out, row)}</td></tr>"


def _format_cell(row: TakeRow, name: str) -> str:
    value: object = getattr(row, name)
    text = "" if value is None else html.escape(str(value))
    style = "" if name in _TEXT else ' class="number"'
    if value and name in ("lost_frames", "limbs"):
        style = ' class="number doubt"' if name == "lost_frames" else ' class="doubt"'
    more = f'<div class="error">{html.escape(row.error)}</div>' if name == "status" else ""
    return f'<td{style} data-value="{text}">{text}{more}</td>'


def _format_links(out: Path, row: TakeRow) -> str:
    links = [
        (_link(row.name, file), text) for file, text in _LINKS if (out / row.name / file).is_file()
    ]
    take = row.name.split("/")[0]
    if take != row.name and (out / take / PAGE).is_file():  # of one of several people
        links.append((_link(take, PAGE), "report of all"))
    if (out / row.name).is_dir():
        links.append((_link(row.name, ""), "folder"))
    log = f"{take}.log"
    if (out / LOGS / log).is_file():
        links.append((_link(LOGS, log), "log"))
    return " ".join(f'<a href="{href}">{text}</a>' for href, text in links)


def _link(*parts: str) -> str:
    return quote("/".join(parts))
