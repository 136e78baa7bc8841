"""The overview of a folder of takes: an HTML page, and a table for programs."""

from __future__ import annotations

import csv
import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from datetime import datetime, timezone
from pathlib import Path
from typing import Any
from urllib.parse import quote

import cv2
import numpy as np

from apf.body.stature import is_whole, stature
from apf.cluster.record import RECORD, TakeRecord
from apf.evaluation.evaluate import Evaluation
from apf.report import OVERLAY, PAGE
from apf.report.drawing import Figure, draw_mosaic
from apf.report.quality import DOUBTFUL
from apf.report.summary import read_summary
from apf.tracking.take import Take
from apf.tracking.track import Track
from psfs.common.files import open_text, resolve_path, write_picture, write_text
from psfs.common.numbers import json_number, mean_known

LOGS = "logs"
#: The files of the overview.
FILES = ("index.html", "takes.csv")
THUMBNAIL = "thumbnail.jpg"
#: Width of a thumbnail, px; it shows the first camera.
_WIDTH = 240


def _column(default: Any, heading: str, explanation: str = "") -> Any:
    return field(default=default, metadata={"heading": heading, "explanation": explanation})


@dataclass(frozen=True)
class TakeRow:
    """A track of a take; the figures of one that failed are None. limbs: lost ones if the truth is
    known, else those with a low mean confidence in the report."""

    name: str = field(metadata={"heading": "take", "explanation": "folder of the results"})
    source: str = ""
    status: str = _column("done", "status")
    quality: str = _column("", "quality", "the verdict of the track's report")
    frames: int | None = _column(None, "frames", "tracked")
    seconds: float | None = _column(None, "length, s", "filmed")
    lost_frames: int | None = _column(None, "lost frames", "in which the person was lost")
    limbs: str = _column("", "limbs", "lost where the truth is known, else doubtful")
    confidence: float | None = _column(None, "confidence", "mean over the frames, 0 to 1")
    misfit: float | None = _column(None, "misfit", "mean over the frames, 0 is perfect")
    height: float | None = _column(None, "height, m", "of the estimated body")
    mean_error: float | None = _column(None, "error, mm", "mean over the joints against a truth")
    parts: str = _column("", "parts", "mm by which parts of a take differ where they are joined")
    took: float | None = _column(None, "took, s", "of computing")
    device: str = ""
    worker: str = _column("", "worker")
    finished: str = _column("", "finished, UTC")
    error: str = ""

    @classmethod
    def summarise(
        cls,
        name: str,
        folder: Path,
        take: Take,
        track: Track,
        evaluation: Evaluation | None = None,
        **more: Any,
    ) -> TakeRow:
        """Return the row of one of the take's tracks, whose results are in `folder`; evaluation: if
        there is a truth."""
        quality = read_summary(folder)["quality"]
        if evaluation is not None:
            limbs = [limb for limb, lost in evaluation.lost_limbs.items() if lost]
        else:
            means = {part: values["mean_confidence"] for part, values in quality["parts"].items()}
            limbs = [part for part, mean in means.items() if mean is not None and mean < DOUBTFUL]
        return cls(
            name=name,
            source=str(take.sequence.folder),
            quality=quality["verdict"],
            frames=len(track),
            seconds=round(float(np.ptp(track.times)) + 1 / track.fps, 3),
            lost_frames=int(track.lost.sum()),
            limbs=", ".join(limbs),
            confidence=json_number(mean_known(track.confidence), 3),
            misfit=json_number(mean_known(track.diagnostics.get("misfit", np.zeros(0))), 3),
            height=round(stature(take.body), 3) if is_whole(take.body) else None,
            mean_error=round(1000 * evaluation.mean_error, 1) if evaluation else None,
            finished=f"{datetime.now(timezone.utc):%Y-%m-%d %H:%M:%S}",
            **more,
        )

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> TakeRow:
        """Return the row of plain values; unknown ones are ignored."""
        known = {field.name for field in fields(cls)}
        return cls(**{name: value for name, value in values.items() if name in known})


#: The columns of the page, and the files that are linked if a take has them: name, text.
_COLUMNS = [column for column in fields(TakeRow) if column.metadata]
_LINKS = ((PAGE, "report"), (OVERLAY, "overlay"), ("motion.bvh", "bvh"), ("motion.glb", "glb"))
_STYLE = """
body { font: 14px/1.4 system-ui, sans-serif; margin: 2em; color: #222; background: #fff }
table { border-collapse: collapse } th, td { padding: .35em .7em; border-bottom: 1px solid #ddd }
th { cursor: pointer; text-align: left; background: #f4f4f4; white-space: nowrap }
img { display: block } tr.failed td { background: #fdecea } .doubt { color: #b3261e }
.error { color: #b3261e; max-width: 50em; overflow-wrap: anywhere }
"""
_SCRIPT = """
for (const head of document.querySelectorAll("th[data-column]")) head.onclick = () => {
  const up = head.getAttribute("aria-sort") !== "ascending", body = document.querySelector("tbody");
  document.querySelectorAll("th").forEach(other => other.removeAttribute("aria-sort"));
  head.setAttribute("aria-sort", up ? "ascending" : "descending");
  const value = row => row.cells[head.cellIndex].dataset.value;
  body.append(...[...body.rows].sort((a, b) => {
    const [x, y] = [value(a), value(b)];
    if (x === "" || y === "") return (x === "") - (y === "");  // what has none comes last
    return (up ? 1 : -1) * x.localeCompare(y, undefined, {numeric: true});
  }));
};
"""


def write_index(out: Path, others: Mapping[str, TakeRow]) -> None:
    """Write index.html and takes.csv of the finished takes in `out`, and of `others`, which failed
    or are waiting, unless an earlier call finished them. Raises InputError."""
    rows = {name: [row] for name, row in others.items() if row.status != "failed"}
    for path in out.glob(f"*/{RECORD}"):
        record = TakeRecord.read(path.parent)
        if record is not None:
            rows[path.parent.name] = [TakeRow.from_dict(row) for row in record.rows]
    rows |= {name: [row] for name, row in others.items() if row.status == "failed"}
    in_order = [row for name in sorted(rows) for row in rows[name]]
    with open_text(out / "takes.csv") as file:
        writer = csv.DictWriter(file, [column.name for column in fields(TakeRow)])
        writer.writeheader()
        writer.writerows(asdict(row) for row in in_order)
    write_text(out / "index.html", _format_page(out, in_order))


def _format_page(out: Path, rows: Sequence[TakeRow]) -> str:
    heads = "".join(
        f'<th data-column="{column.name}" title="{html.escape(column.metadata["explanation"])}">'
        f"{html.escape(column.metadata['heading'])}</th>"
        for column in _COLUMNS
    )
    states = list({row.name.split("/")[0]: row.status for row in rows}.values())
    counts = ", ".join(f"{states.count(s)} {s}" for s in dict.fromkeys(sorted(states)))
    title = html.escape(resolve_path(out).name)
    body = "\n".join(_format_row(out, row) for row in rows)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f"<title>{title}: takes</title><style>{_STYLE}</style></head>\n"
        f"<body><h1>{title}</h1><p>{counts}. A click on a heading "
        'sorts. The same as a table: <a href="takes.csv">takes.csv</a></p>\n'
        f"<table><thead><tr><th></th>{heads}<th>files</th></tr></thead>\n<tbody>\n{body}\n</tbody>"
        f"</table>\n<script>{_SCRIPT}</script></body></html>\n"
    )


def _format_row(out: Path, row: TakeRow) -> str:
    picture = ""
    if (out / row.name / THUMBNAIL).is_file():
        picture = f'<img src="{quote(f"{row.name}/{THUMBNAIL}")}" alt="" width="120">'
    cells = "".join(_format_cell(row, column.name) for column in _COLUMNS)
    links = " ".join(f'<a href="{quote(path)}">{text}</a>' for path, text in _list_links(out, row))
    return f'<tr class="{row.status}"><td>{picture}</td>{cells}<td>{links}</td></tr>'


def _format_cell(row: TakeRow, name: str) -> str:
    value = getattr(row, name)
    text = "" if value is None else html.escape(str(value))
    style = ' class="doubt"' if value and name in ("lost_frames", "limbs") else ""
    error = f'<div class="error">{html.escape(row.error)}</div>' if name == "status" else ""
    return f'<td{style} data-value="{text}">{text}{error}</td>'


def _list_links(out: Path, row: TakeRow) -> Iterable[tuple[str, str]]:
    """Yield the paths in `out` that belong to a track, with their texts."""
    take = row.name.split("/")[0]
    paths = [(f"{row.name}/{file}", text) for file, text in _LINKS]
    if take != row.name:  # one of several people
        paths.append((f"{take}/{PAGE}", "report of all"))
    paths += [(f"{row.name}/", "folder"), (f"{LOGS}/{take}.log", "log")]
    return [(path, text) for path, text in paths if (out / path).exists()]


def write_thumbnail(folder: Path, take: Take, track: Track) -> None:
    """Write the middle frame of the first camera, with the body, into the folder of results."""
    frame = take.sequence.read(int(track.frames[len(track) // 2]))
    picture = draw_mosaic(frame, take.sequence.rig, [Figure(track)], views=[0])
    height = round(picture.shape[0] * _WIDTH / picture.shape[1])
    small = cv2.resize(picture, (_WIDTH, height), interpolation=cv2.INTER_AREA)
    write_picture(folder / THUMBNAIL, small)
