"""The report of `compare_timings.py`: the machines of stored results, a page of all tables, and the
figures of docs/speed.md and of the notebook."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FuncFormatter

from cl import InputError
from psfs.common.files import write_atomically, write_text
from timings import batch, methods, people
from timings.grid import NONE, Grid, number, quote, ratio, replace_marked
from timings.results import Results, read_results
from timings.stages import PARTS, STAGES
from timings.whole_tables import (
    columns,
    is_one_core,
    later,
    median_ms,
    papers,
    song_table,
    streams,
    tables,
)

#: The comparison that may be the only one of a machine.
BATCH = "batch"
#: The tables of each comparison. `song` is a part of `whole` in a file of its own.
_TABLES: dict[str, Callable[[Results], Sequence[Grid | None]]] = {
    "whole": tables,
    "song": lambda results: [song_table(results)],
    "methods": methods.tables,
    "people": people.tables,
    BATCH: batch.tables,
}
#: Colours of Okabe and Ito, which colour-blind readers can distinguish.
_KIND = {
    "numpy": "#8A8A8A",
    "one": "#56B4E9",
    "cpu": "#0072B2",
    "gpu": "#D55E00",
    "song": "#CCBFA3",
}
_BLUES, _ORANGES = plt.colormaps["Blues"], plt.colormaps["Oranges"]
STAGE_COLOURS: dict[str, Any] = {
    **dict(zip(PARTS["reconstruction"], _BLUES(np.linspace(0.35, 0.95, 6)), strict=True)),
    "colour": "#009E73",
    **dict(zip(PARTS["tracking"], _ORANGES(np.linspace(0.3, 0.95, 5)), strict=True)),
    "download": "#999999",
    "other": "#CCCCCC",
}
_STYLE: dict[Any, Any] = {
    "font.size": 10, "axes.spines.top": False, "axes.spines.right": False,
    "axes.titlelocation": "left", "axes.titlesize": 11.5, "axes.titleweight": "bold",
    "axes.edgecolor": "#8A8A8A", "legend.frameon": False, "svg.hashsalt": "psfs-apf",
    "figure.facecolor": "white",
}  # fmt: skip
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
_NOTE = (
    "Medians; Song et al.'s are means. {surface:,.0f} surface voxels, Song's about 30,000. "
    "One core : it compares the same OpenCL code, and Song's C++ with his OpenCL. Streamed: from "
    "page-locked pictures, each frame uploaded, and without colour also reconstructed, while the "
    "one before is worked on."
)
#: The columns that the fastest is compared with, and the most similar ratio in Song et al.
_COMPARED = {"one": "GPU / CPU", "cpu": "GPU / CPU+TBB (4 cores)", "numpy": None}


@dataclass(frozen=True, eq=False)
class Machine:
    """A machine of the report. name: of the folder. title: from the devices in the results.
    results: by comparison."""

    name: str
    title: str
    results: Mapping[str, Results]


def read_machines(folders: list[Path]) -> list[Machine]:
    """Read a machine from each folder that holds results other than `batch` alone. Raises
    InputError if there is none, or one without the results of `compare_timings.py whole`, on which
    the report is based."""
    machines = []
    for folder in folders:
        results = _read_results(folder)
        if set(results) <= {BATCH}:
            continue
        if "whole" not in results or not results["whole"].starting("column "):
            raise InputError(f"{folder}: no columns in whole.json; expected results of `whole`")
        machines.append(Machine(folder.name, _title(results), results))
    if not machines:
        shown = ", ".join(str(folder) for folder in folders) or "no folder"
        raise InputError(f"{shown}: no results; expected *.json of compare_timings.py")
    # The machine with the fewest devices first: pages proceed from small to large.
    return sorted(machines, key=lambda m: len(_environment(m.results)["devices"]))


def read_batches(folders: list[Path]) -> list[Machine]:
    """Read a machine from each folder that holds results of `compare_timings.py batch`."""
    found = [(folder, _read_results(folder)) for folder in folders]
    return [Machine(path.name, _title(of), of) for path, of in found if BATCH in of]


def _read_results(folder: Path) -> dict[str, Results]:
    return {file.stem: read_results(file) for file in sorted(folder.glob("*.json"))}


def _environment(results: Mapping[str, Results]) -> dict[str, Any]:
    return results["whole" if "whole" in results else BATCH].environment


def _title(results: Mapping[str, Results]) -> str:
    machine = _environment(results)
    gpus = [device["name"] for device in machine["devices"] if device["kind"] == "gpu"]
    units = [d["compute_units"] for d in machine["devices"] if d["kind"] == "cpu"]
    cores = max(units, default=machine["cores"])
    cpu = f"{short_cpu(machine['cpu'])}, {cores} core{'s' * (cores > 1)}"
    counted = [f"{n} x {name}" if n > 1 else name for name, n in Counter(gpus).items()]
    return " with ".join([*counted, cpu])


def short_cpu(name: str) -> str:
    """Return a processor's name without trademark signs and the like."""
    for noise in ("(R)", "(TM)", " CPU", " Processor"):
        name = name.replace(noise, "")
    return " ".join(name.split("@")[0].split())


def device_title(label: str, machine: Machine) -> str:
    """Return the name of a place for pages: PoCL's names mention neither OpenCL nor CPU."""
    if label.startswith(("pthread", "cpu-")):
        cores = label.rsplit(", ", 1)[-1]
        return f"{short_cpu(_environment(machine.results)['cpu'])}, {cores}"
    return label


def write_report(machines: Sequence[Machine], path: Path) -> None:
    """Write a page with the tables of every comparison on every machine, and what was left out."""
    parts = ["# Timings", "Made by `scripts/report_timings.py` from the files beside it."]
    for machine in machines:
        parts.append(f"## {machine.title}")
        for name, results in machine.results.items():
            made = f"{results.made[:10]}, commit {results.commit}; `{results.command}`"
            parts.append(f"### {name}\n\n{made}")
            parts += [grid.markdown() for grid in _TABLES[name](results) if grid is not None]
            parts += [f"Not measured: {what}: {why}" for what, why in results.left_out.items()]
    write_text(path, "\n\n".join(parts) + "\n")


def update_page(path: Path, machines: Sequence[Machine]) -> None:
    """Replace the page's table of timings. Raises InputError if its marks are not there."""
    replace_marked(path, "timings", headline_table(machines))


def headline_table(machines: Sequence[Machine]) -> str:
    """Return whole frames on every machine beside Song et al.'s."""
    rows, surfaces = [], []
    for machine in machines:
        results = machine.results["whole"]
        found = columns(results)
        surfaces += [run["surface_voxels"] for _, column in found for run in column["runs"]]
        core = next((median_ms(column) for _, column in found if is_one_core(column)), None)
        shown = [(title, median_ms(column), _frames(column)) for title, column in found]
        shown += [(title, run["frames"].median, len(run["frames"].samples))
                  for title, run in streams(results) if "one core" not in title]  # fmt: skip
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


def headline_sentences(machines: Sequence[Machine]) -> str:
    """Return sentences on the fastest machine's whole frame: against one core of the same code,
    against all cores, and against the twin."""
    machine = machines[-1]
    by_kind = {column_kind(column): (title, column)
               for title, column in columns(machine.results["whole"])}  # fmt: skip
    best = by_kind.get("gpu") or by_kind.get("cpu") or by_kind["one"]
    ms = median_ms(best[1])
    sentences = [f"**{machine.title}**: a whole frame takes {number(ms)} ms on {best[0]}"]
    song = {name: final for name, _, final in papers()["song2012"]["tables"]["3"]["rows"]}
    for kind, name in _COMPARED.items():
        if kind in by_kind and by_kind[kind] is not best:
            title, column = by_kind[kind]
            theirs = f" (Song et al., {name}: {song[name]:.0f} x)" if name in song else ""
            beside = theirs if "gpu" in by_kind else ""
            sentences.append(f"{number(median_ms(column) / ms)} x as fast as {title}{beside}")
    return ", ".join(sentences) + ". Medians."


def write_figure(figure: Any, path: Path) -> None:
    """Write SVG or PNG without the date, so that the same results give the same file."""
    metadata = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    with write_atomically(path) as temporary:
        figure.savefig(temporary, dpi=130, metadata=metadata, bbox_inches="tight")
    plt.close(figure)


def apply_style(draw: Callable[..., Any]) -> Callable[..., Any]:
    def drawn(*args: Any) -> Any:
        with plt.rc_context(_STYLE):
            return draw(*args)

    return drawn


@apply_style
def headline_figure(machines: Sequence[Machine]) -> Any:
    """Plot whole frames of every column of every machine, and Song's."""
    rows: list[tuple[str, float, str] | None] = []
    for machine in machines:
        rows.append((machine.title, 0.0, ""))
        for title, column in columns(machine.results["whole"]):
            rows.append((title, median_ms(column), column_kind(column)))
        rows.append(None)
    song = papers()["song2012"]["tables"]["2"]["rows"]
    rows.append(("Song et al. 2012: Core i7 860, Radeon HD 6870", 0.0, ""))
    rows += [(name, values[-1], "song") for name, *values in song]
    figure, axes = plt.subplots(figsize=(9.5, 0.33 * len(rows) + 0.9))
    times = [row[1] for row in rows if row and row[1]]
    left = 10 ** np.floor(np.log10(min(times)) - 0.1)
    for y, row in enumerate(rows):
        if row is None:
            continue
        label, ms, kind = row
        if not ms:
            axes.text(left, y, label, va="center", weight="bold", fontsize=10)
            continue
        axes.barh(y, ms - left, left=left, color=_KIND[kind], height=0.72)
        text = f" {number(ms)} ms" + (f"  ({number(1e3 / ms)} frames/s)" if ms < 1e4 else "")
        axes.text(ms, y, text, va="center", fontsize=9.5)
    shown = [y for y, row in enumerate(rows) if row and row[1]]
    axes.set_yticks(shown, [rows[y][0].split(", NVIDIA")[0] for y in shown])  # type: ignore[index]
    axes.set_ylim(len(rows) - 0.4, -0.7)
    axes.set_xscale("log")
    axes.set_xlim(left, max(times) * 12)
    axes.tick_params(axis="y", length=0)
    plain_numbers(axes.xaxis)
    axes.set_xlabel("ms per frame, logarithmic (lower is better)")
    axes.set_title("One frame: reconstruction, colour and tracking", x=0, pad=8)
    return figure


def column_kind(column: Any) -> str:
    return "one" if is_one_core(column) else column["kind"]


def plain_numbers(axis: Any) -> None:
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))


def core_times(results: Results) -> list[tuple[int, float]]:
    """Return (cores, ms per frame) of the CPU's columns."""
    found = {
        section["cores"]: median_ms(section)
        for section in (*results.starting("column "), *results.starting("cores "))
        if section["kind"] == "cpu"
    }
    return sorted(found.items())


def serial_share(times: Sequence[tuple[int, float]]) -> float:
    """Fit the s of Amdahl's law T(n) = T(1) (s + (1 - s) / n), in [0, 1]."""
    cores, ms = np.array(times, float).T
    rest = 1 - 1 / cores
    slower = ms / ms[0] - 1 / cores
    return float(np.clip(np.sum(rest * slower) / np.sum(rest**2), 0, 1))


@apply_style
def amdahl(machines: Sequence[Machine]) -> Any:
    """Plot the speed-up over cores, and Amdahl's law fitted to it."""
    figure, axes = plt.subplots(figsize=(6.5, 4.4), layout="constrained")
    most = 2
    for machine, colour, mark in zip(machines, _COLOURS, "osD^vP", strict=False):
        times = core_times(machine.results["whole"])
        if len(times) < 2 or times[0][0] != 1:
            continue
        share = serial_share(times)
        cores = np.array([n for n, _ in times])
        most = max(most, int(cores[-1]))
        axes.plot(cores, times[0][1] / np.array([ms for _, ms in times]), mark, color=colour,
                  label=device_title("cpu-", machine).rsplit(",", 1)[0])  # fmt: skip
        fine = np.geomspace(1, cores[-1], 60)
        axes.plot(fine, 1 / (share + (1 - share) / fine), color=colour, linewidth=1,
                  label=f"Amdahl's law, {share:.1%} serial")  # fmt: skip
    song = papers()["song2012"]["tables"]["3"]["rows"][0]
    axes.plot(
        [4], [song[2]], "*", color="#8A8A8A", markersize=11, label="Song et al.: CPU+TBB, 4 cores"
    )
    ideal = np.array([1, max(most, 4)])
    axes.plot(ideal, ideal, ":", color="#8A8A8A", label="ideal")
    axes.set_xscale("log", base=2)
    axes.set_yscale("log", base=2)
    for axis in (axes.xaxis, axes.yaxis):
        plain_numbers(axis)
    axes.set_xlabel("cores")
    axes.set_ylabel("times as fast as one core")
    axes.set_title("Whole frame over CPU cores")
    axes.legend(fontsize=9, loc="upper left")
    axes.grid(alpha=0.3)
    return figure


@apply_style
def roofline(machines: Sequence[Machine]) -> Any:
    """Plot every stage's rate of operations over its operations per byte, below the device's
    limits; None if no stages were measured."""
    found = [
        (device_title(section["label"], machine), section)
        for machine in machines
        for section in machine.results["whole"].starting("stages ")
    ]
    if not found:
        return None
    figure, all_axes = plt.subplots(
        1, len(found), figsize=(max(7.0, 4.6 * len(found)), 4.7), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for axes, (title, section) in zip(all_axes[0], found, strict=True):
        limits = section["limits"]
        intensity = np.geomspace(0.05, 3000, 100)
        roof = np.minimum(limits.flops_per_s, limits.bytes_per_s * intensity) / 1e9
        axes.loglog(intensity, roof, color="#222222", linewidth=1.3)
        gigabytes, gigaflops = limits.bytes_per_s / 1e9, limits.flops_per_s / 1e9
        text = f"copies {gigabytes:,.0f} GB/s\nmultiply-adds {gigaflops:,.0f} GFLOP/s"
        axes.text(0.03, 0.98, text, fontsize=9, va="top", transform=axes.transAxes)
        for stage in STAGES:
            nbytes, operations = section["work"].get(stage, (0, 0))
            if not operations or stage not in section["stages"]:
                continue
            rate = operations / (section["stages"][stage].median * 1e-3) / 1e9
            axes.plot(operations / nbytes, rate, "o", color=STAGE_COLOURS[stage], markersize=8,
                      markeredgecolor="#444444", markeredgewidth=0.6, label=stage)  # fmt: skip
        axes.set_title(title, fontsize=10)
        axes.set_xlabel("operations per byte")
        axes.grid(alpha=0.25)
        axes.set_ylim(top=gigaflops * 12)
    all_axes[0][0].set_ylabel("10⁹ operations per second")
    handles, labels = all_axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=9, ncols=5, loc="outside lower center")
    return figure
