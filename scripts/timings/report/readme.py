"""The table of timings in docs/speed.md, between two marks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cl import InputError
from psfs.common.files import write_text
from timings.report.machines import Machine
from timings.report.page import headline_sentences
from timings.tables.grid import NONE, Grid, number, quote, ratio
from timings.tables.whole import columns, is_one_core, later, median_ms, papers, streams

_NOTE = (
    "Medians; Song et al.'s are means. {surface:,.0f} surface voxels, Song's about 30,000. "
    "One core : it compares the same OpenCL code, and Song's C++ with his OpenCL. Streamed: from "
    "page-locked pictures, each frame uploaded, and without colour also reconstructed, while the "
    "one before is worked on."
)


def update_page(path: Path, machines: Sequence[Machine]) -> None:
    """Replace the page's table of timings. Raises InputError if its marks are not there."""
    replace_marked(path, "timings", headline(machines))


def replace_marked(path: Path, name: str, made: str) -> None:
    """Write `made` between the marks of that name in a file. Raises InputError if they are
    missing."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    text = path.read_text()
    pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    if len(pattern.findall(text)) != 1:
        raise InputError(f"{path}: expected {begin} and {end}, once")
    write_text(path, pattern.sub(lambda _: f"{begin}\n{made}\n{end}", text))


def headline(machines: Sequence[Machine]) -> str:
    """Return whole frames on every machine beside Song et al.'s."""
    rows, surfaces = [], []
    for machine in machines:
        results = machine.results["whole"]
        found = columns(results)
        surfaces += [run["surface_voxels"] for _, column in found for run in column["runs"]]
        core = next((median_ms(column) for _, column in found if is_one_core(column)), None)
        shown = [(title, median_ms(column), _frames(column)) for title, column in found]
        shown += [(title, run["frames"].median, len(run["frames"].samples))
                  for title, run in streams(results)]  # fmt: skip
        for title, ms, frames in shown:
            against = NONE if core is None else ratio(core / ms)
            rows.append([machine.title, title, number(ms), number(1e3 / ms), against, str(frames)])
    song = papers()["song2012"]["tables"]["2"]["rows"]
    for name, *_, ms in song:
        against = ratio(song[0][-1] / ms)
        rows.append(["_Song et al. 2012_", f"_{name}_", quote(ms), number(1e3 / ms), against,
                     "600"])  # fmt: skip
    results = machines[-1].results["whole"]
    nx, ny, nz = results.settings["shape"]
    config = results.settings["filter"]
    grid = Grid(
        f"One frame: reconstruction, colour and tracking; {results.settings['views']} cameras "
        f"640 x 480, {nx} x {ny} x {nz} voxels, {config['n_particles']} particles x "
        f"{config['n_layers']} layers",
        ["machine", "program", "ms per frame", "frames/s", "one core : it", "frames"], rows,
        _NOTE.format(surface=np.median(surfaces)),
    )  # fmt: skip
    picture = "![Milliseconds per frame on every device](timings.png)"
    return f"{headline_sentences(machines)}\n\n{picture}\n\n{grid.markdown()}"


def _frames(column: Any) -> int:
    """Return the number of frames behind a column's time."""
    return sum(len(later(run["frames"])) for run in column["runs"])
