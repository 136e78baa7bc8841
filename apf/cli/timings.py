"""`apf timings`: OpenCL against the CPU, on the computer that one has."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from apf.request import TimingsRequest
from apf.timings.measure import apart, cpu_place, only_cores, places
from apf.timings.scene import ONE_THREAD, column, make_problem, on_cpu, on_numpy
from psfs.cli.commandline import stdout
from psfs.common.files import write_atomically, write_json
from psfs.common.outputs import output_folder

#: Distinct frames of the walk, and most frames of a run.
_DISTINCT, _FRAMES = 6, 200
_RESULTS = ("timings.json", "timings.png")


def run(request: TimingsRequest) -> None:
    with output_folder(request.output, request.COMMAND, expected=_RESULTS) as out:
        out.begin()
        rows = measure(request.seconds)
        write_json(request.output / "timings.json", {"rows": rows})
        _show(rows)
        _draw(rows, request.output / "timings.png")
    stdout.print(f"wrote {request.output / 'timings.json'} and timings.png")


def measure(seconds: float) -> list[dict[str, Any]]:
    """Return a row per program, the slowest first: its name, ms per frame, ms per frame of a
    stream, joint error, and how many times as fast as one core it is. Raises InputError without an
    OpenCL device."""
    problem, found = make_problem(_DISTINCT), places()
    size = _FRAMES, 1, 0.1 * seconds
    tasks = {place.label: partial(column, place, problem, *size) for place in found}
    if any(place.cores and place.cores > 1 for place in found):
        one = f"{cpu_place().label.rpartition(', ')[0]}, one core"
        tasks[one] = partial(apart, only_cores(1), on_cpu, problem, *size)
    twin = partial(apart, ONE_THREAD, on_numpy, problem, 2, 1, 0.1 * seconds, 0)
    tasks["NumPy, one thread (the specification)"] = twin
    rows = list[dict[str, Any]]()
    for name, task in tasks.items():
        stdout.print(f"measuring {name}")
        made = task()
        ms = made["runs"][0]["frames"].samples[1:] or made["runs"][0]["frames"].samples
        streamed = made["to_pose"]["frames"].median if "to_pose" in made else None
        rows.append({
            "program": name, "kind": made["kind"], "cores": made["cores"], "frames": len(ms),
            "ms": float(np.median(ms)), "streamed_ms": streamed,
            "error_mm": float(made["runs"][0]["error_mm"]),
        })  # fmt: skip
    core: Any = next((r["ms"] for r in rows if (r["kind"], r["cores"]) == ("cpu", 1)), None)
    for row in rows:
        row["times_one_core"] = core and core / row["ms"]
    return sorted(rows, key=lambda row: -row["ms"])


def _show(rows: list[dict[str, Any]]) -> None:
    table = Table()
    table.add_column("program", overflow="fold")
    for head in ("ms per frame", "frames/s", "x one core", "streamed, ms", "joint error, mm"):
        table.add_column(head, justify="right")
    for row in rows:
        faster, streamed = row["times_one_core"], row["streamed_ms"]
        table.add_row(
            row["program"], f"{row['ms']:,.2f}", f"{1e3 / row['ms']:,.1f}",
            "-" if faster is None else f"{faster:,.2f}",
            "-" if streamed is None else f"{streamed:,.2f}", f"{row['error_mm']:.1f}",
        )  # fmt: skip
    stdout.print(table)
    stdout.print(
        "One frame from pictures in memory to pose and coloured voxels in memory; streamed: from "
        "pose to pose, without the voxels' download. Medians, without each run's first frame."
    )


def _draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Draw the times as bars, logarithmic."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 0.8 + 0.5 * len(rows)), layout="constrained")
    axes = figure.add_subplot()
    ms = [row["ms"] for row in rows]
    bars = axes.barh([row["program"] for row in rows], ms, color="tab:blue")
    axes.bar_label(bars, [f"{value:,.{0 if value >= 100 else 2}f} ms" for value in ms], padding=3)
    axes.set_xscale("log")
    axes.set_xlim(min(ms) / 3, max(ms) * 8)
    axes.set_xlabel("ms per frame: reconstruction, colour and tracking")
    axes.invert_yaxis()
    axes.spines[["top", "right"]].set_visible(False)
    with write_atomically(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120)
