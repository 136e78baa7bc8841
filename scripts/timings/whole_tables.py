"""Song et al.'s tables 2 to 4, with our figures beside the paper's, and the stages' table."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from apf.timings.measure import Timing
from timings.grid import NONE, Grid, number, quote, ratio
from timings.results import Results
from timings.stages import PARTS, STAGES

#: Description of the NumPy twins: they were not optimised.
SPECIFICATION = "an unoptimised specification"
_PAPERS = Path(__file__).with_name("papers.json")


@cache
def papers() -> dict[str, Any]:
    """Return the papers' own tables, the only figures here that were not measured in this
    project."""
    return json.loads(_PAPERS.read_text())


def columns(results: Results, name: str = "column") -> list[tuple[str, Any]]:
    """Return (title, section) of each measured column: NumPy, one core, all cores, GPUs. name:
    "song" for those by `--preset song`."""
    order = {"numpy": 0, "cpu": 1, "gpu": 2}
    found = results.starting(f"{name} ")
    found.sort(key=lambda column: (order.get(column["kind"], 3), column["cores"] or 0))
    return [(_title(column), column) for column in found]


def _title(column: Any) -> str:
    if column["kind"] == "numpy":
        return f"NumPy, one thread ({SPECIFICATION})"
    if column["kind"] == "cpu":
        cores = column["cores"]
        return f"OpenCL CPU, {'one core' if cores == 1 else f'{cores} cores'}"
    return f"OpenCL GPU, {column['label']}"


def is_one_core(column: Any) -> bool:
    """Return whether a column is of the OpenCL code on one core."""
    return bool(column["kind"] == "cpu" and column["cores"] == 1)


def later(timing: Timing) -> tuple[float, ...]:
    """Return the times, ms, of all frames but the first, which is reconstructed twice; of a single
    frame, its time."""
    return timing.samples[1:] or timing.samples


def median_ms(column: Any) -> float:
    """Return the median time, ms, of the frames of all runs, without first frames."""
    return float(np.median([ms for run in column["runs"] for ms in later(run["frames"])]))


def table_2(results: Results) -> Grid:
    """Return the median time per frame of every run."""
    n_runs = results.settings["repetitions"]["opencl"]
    song = papers()["song2012"]["tables"]["2"]
    rows = []
    for title, column in columns(results):
        runs = [float(np.median(later(run["frames"]))) for run in column["runs"]]
        shown = [*map(number, runs), *[NONE] * (n_runs - len(runs))]
        frames = sorted({len(run["frames"].samples) for run in column["runs"]})
        error = float(np.mean([run["error_mm"] for run in column["runs"]]))
        surface = float(np.median([run["surface_voxels"] for run in column["runs"]]))
        rows.append([title, *shown, number(median_ms(column)), " to ".join(map(str, frames)),
                     number(1e3 / median_ms(column)), f"{surface:,.0f}",
                     number(error)])  # fmt: skip
    for name, *values in song["rows"]:
        rows.append(
            [
                f"_Song: {name}_",
                *map(quote, values),
                "200",
                number(1e3 / values[-1]),
                "_about 30,000_",
                NONE,
            ]
        )
    heads = [f"run {k + 1}, ms" for k in range(n_runs)]
    return Grid(
        "Time per frame (Song table 2)",
        [
            "program",
            *heads,
            "all, ms",
            "frames of a run",
            "frames/s",
            "surface voxels",
            "error, mm",
        ],
        rows,
        "Ours: medians, each run's first frame, which is worked on twice, left out; Song's: means. "
        "The error is the mean distance of the joints to the truth over the frames of a run; of "
        "programs with other numbers of frames it is that of other poses.",
    )


def song_table(results: Results) -> Grid | None:
    """Return whole frames by `--preset song` beside those by the defaults and Song's; None if there
    are none."""
    found = columns(results, "song")
    if not found:
        return None
    defaults = dict(columns(results))
    core = next((median_ms(column) for _, column in found if is_one_core(column)), None)
    rows = []
    for title, column in found:
        ms, ours = median_ms(column), defaults.get(title)
        rows.append([
            title, number(ms), number(1e3 / ms), NONE if core is None else ratio(core / ms),
            number(column["to_cloud"]["frames"].median), number(ours and median_ms(ours)),
            number(float(np.mean([run["error_mm"] for run in column["runs"]]))),
        ])  # fmt: skip
    song = papers()["song2012"]["tables"]["2"]["rows"]
    for name, *_, ms in song:
        rows.append([f"_Song: {name}_", quote(ms), number(1e3 / ms), ratio(song[0][-1] / ms),
                     NONE, NONE, NONE])  # fmt: skip
    return Grid(
        "The paper's own algorithm, `--preset song`",
        ["program", "whole frame, ms", "frames/s", "one core : it", "streamed, ms",
         "by the defaults, ms", "error, mm"], rows,
        "Pixel by pixel silhouettes, annealed particle filter with eq. (16), coloured voxels "
        "downloaded; no contours, part colours, refinement or limb search. From the true first "
        "joints, with the model's girths. Song's are means, ours medians of the same run as the "
        "defaults.",
    )  # fmt: skip


#: Kinds of streamed frames, as `whole_timings.column` names them, and what they leave out.
STREAMS = {
    "to_pose": "streamed, without colour and download of voxels",
    "to_cloud": "streamed, coloured voxels downloaded",
}


def streams(results: Results) -> list[tuple[str, Any]]:
    """Return (title, run) of the programs whose frames were streamed."""
    found = columns(results)
    return [
        (f"{title}, {what}", column[name])
        for title, column in found
        for name, what in STREAMS.items()
        if name in column
    ]


def stream_table(results: Results) -> Grid:
    """Return the time from pose to pose if frames follow each other as fast as possible."""
    rows = []
    for title, run in streams(results):
        ms = run["frames"]
        rows.append([title, *map(number, (ms.median, ms.low, ms.high)), str(len(ms.samples)),
                     number(1e3 / ms.median), number(run["error_mm"])])  # fmt: skip
    return Grid(
        "Streamed, from pictures in page-locked memory",
        ["program", "median, ms", "lower quartile", "upper quartile", "frames", "frames/s",
         "error, mm"], rows,
        "By the clock, from one pose, or one cloud of voxels, to the next, on the host. A frame is "
        "uploaded while the one before is worked on; without clouds it is reconstructed then, too.",
    )  # fmt: skip


def table_3(results: Results) -> Grid:
    """Return the speed-up of each program over each other."""
    found = columns(results)
    song = {name: final for name, _, final in papers()["song2012"]["tables"]["3"]["rows"]}
    rows = []
    for place, (title, column) in enumerate(found):
        for other, slower in found[:place]:
            beside = _songs_ratio(slower, column, song)
            rows.append(
                [f"{title} : {other}", ratio(median_ms(slower) / median_ms(column)), beside]
            )
    return Grid(
        "Acceleration ratios (Song table 3)",
        ["ratio of the times", "ours (medians)", "Song et al. (means)"],
        rows, "Song's CPU is C++ on one core, his CPU+TBB that on 4 cores; so his GPU / CPU stands "
        "beside OpenCL on one core.",
    )  # fmt: skip


def _songs_ratio(slower: Any, faster: Any, song: dict[str, float]) -> str:
    kinds = (slower["kind"], slower["cores"] == 1, faster["kind"])
    name = {
        ("cpu", True, "gpu"): "GPU / CPU",
        ("cpu", False, "gpu"): "GPU / CPU+TBB (4 cores)",
        ("cpu", True, "cpu"): "CPU+TBB (4 cores) / CPU",
    }.get(kinds)
    return f"{quote(song[name])} x" if name else NONE


def stage_table(section: Any) -> Grid:
    """Return the stages on one device by its events, beside the least time that its limits
    allow."""
    limits, stages = section["limits"], section["stages"]
    total = sum(timing.median for timing in stages.values())
    rows = []
    for stage in STAGES:
        if stage not in stages:
            continue
        ms = stages[stage].median
        nbytes, operations = section["work"].get(stage, (None, None))
        least = None if nbytes is None else limits.ms(nbytes, operations)
        rows.append([
            stage, number(ms), f"{ms / total:.0%}",
            number(None if nbytes is None else nbytes / 1e6),
            number(None if operations is None else operations / 1e6),
            number(least), NONE if least is None else f"{least / ms:.0%}",
        ])  # fmt: skip
    parts = {part: sum(stages[s].median for s in names if s in stages)
             for part, names in PARTS.items()}  # fmt: skip
    rows += [[f"**{part}**", number(ms), f"{ms / total:.0%}", *[""] * 4]
             for part, ms in parts.items()]  # fmt: skip
    return Grid(
        f"Stages on {section['label']}",
        ["stage", "ms", "share", "MB", "million operations", "least, ms", "least / time"],
        rows,
        f"Median of the device's own events. Measured in the same run: copies "
        f"{limits.bytes_per_s / 1e9:,.0f} GB/s, multiply-adds {limits.flops_per_s / 1e9:,.0f} "
        "GFLOP/s; the least time moves the bytes and does the operations at those rates, without "
        "any cleverness (every voxel into every camera).",
    )


def tables(results: Results) -> list[Grid]:
    """Return all tables of `compare_timings.py whole`."""
    found = [table_2(results), stream_table(results), song_table(results)]
    found += [table_3(results), *map(stage_table, results.starting("stages "))]
    return [grid for grid in found if grid is not None]
