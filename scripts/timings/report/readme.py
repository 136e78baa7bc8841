"""The README's table of timings, between two marks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from cl import InputError
from psfs.common.files import written_whole
from timings.report.machines import Machine
from timings.report.page import headline_sentences
from timings.tables.grid import Grid, number, quoted, ratio
from timings.tables.whole import average, columns, papers, streams

#: What the rows of streamed frames are.
_STREAMED = (
    "Streamed: from page-locked pictures to the pose, each frame reconstructed while the one "
    "before is searched for; the voxels stay on the device."
)


def update_readme(path: Path, machines: Sequence[Machine]) -> None:
    """Replace the README's table of timings. Raises InputError if its marks are not there."""
    replace_marked(path, "timings", headline(machines))


def replace_marked(path: Path, name: str, made: str) -> None:
    """Put `made` between the marks of that name in a file. Raises InputError if they are not
    there."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    text = path.read_text()
    pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    if len(pattern.findall(text)) != 1:
        raise InputError(f"{path}: expected {begin} and {end}, once")
    with written_whole(path) as temporary:
        temporary.write_text(pattern.sub(lambda _: f"{begin}\n{made}\n{end}", text))


def headline(machines: Sequence[Machine]) -> str:
    """Whole frames on every machine beside Song et al.'s."""
    rows = []
    for machine in machines:
        found = columns(machine.results["whole"])
        slowest = average(found[0][1])
        shown = [(title, average(column)) for title, column in found]
        shown += [(title, run["frames"].median) for title, run in streams(machine.results["whole"])]
        for title, ms in shown:
            against = ratio(slowest / ms)
            rows.append([machine.title, title, number(ms), number(1e3 / ms), against])
    song = papers()["song2012"]["tables"]["2"]["rows"]
    for name, *_, ms in song:
        against = ratio(song[0][-1] / ms)
        rows.append(["_Song et al. 2012_", f"_{name}_", quoted(ms), number(1e3 / ms), against])
    results = machines[-1].results["whole"]
    nx, ny, nz = results.settings["shape"]
    config = results.settings["filter"]
    grid = Grid(
        f"One frame: reconstruction, colour and tracking; {results.settings['views']} cameras "
        f"640 x 480, {nx} x {ny} x {nz} voxels, {config['n_particles']} particles x "
        f"{config['n_layers']} layers",
        ["machine", "program", "ms per frame", "frames/s", "slowest : it"], rows,
        _STREAMED if any(streams(machine.results["whole"]) for machine in machines) else "",
    )  # fmt: skip
    picture = "![Milliseconds per frame on every device](docs/timings.png)"
    return f"{headline_sentences(machines)}\n\n{picture}\n\n{grid.markdown()}"
