"""The reconstruction against its peers, and the tracker's rate: tables of `psfs` and `apf`."""

from __future__ import annotations

from collections.abc import Sequence

from timings.measure import Timing
from timings.report.machines import Machine, device_title, missing, name_processors
from timings.results import Results
from timings.tables.apf import tables
from timings.tables.grid import NONE, Grid, number
from timings.tables.psfs import compare_programs


def peers(machines: Sequence[Machine]) -> str:
    """Return the chapters on the two halves alone, as far as they were measured."""
    reconstruction = [
        text
        for machine in machines
        if "psfs" in machine.results
        for text in (
            _reconstruction(machine, machine.results["psfs"]).markdown(),
            *(_fold(grid) for grid in _growth(machine, machine.results["psfs"])),
            *missing(machine, "psfs", "device ", "numpy", "open3d", "growth ", "memory"),
        )
    ]
    tracking = [
        text
        for machine in machines
        if "apf" in machine.results
        for text in (
            *(name_processors(_fold(grid), machine) for grid in tables(machine.results["apf"])),
            *missing(machine, "apf", "numpy", "device ", "particles, ", "layers, ", "cameras, "),
        )
    ]
    for name, texts in (("psfs", reconstruction), ("apf", tracking)):
        absent = [machine for machine in machines if name not in machine.results]
        texts += [line for machine in absent for line in missing(machine, name)]
    parts = []
    if reconstruction:
        parts += ["## Reconstruction alone, against its peers", _PEERS, *reconstruction]
    if tracking:
        parts += ["## Tracking alone, in Song et al.'s setting", _TRACKING, *tracking]
    return "\n\n".join(parts)


_PEERS = """From pictures in page-locked host memory to surface voxels on the device. Dense: all
voxels of the grid; sparse: only bricks that can be occupied, with the same result. Open3D carves
the same masks, cameras and grid, its dense grid made beforehand; it keeps a voxel where any of its
corners hits."""

_TRACKING = """Hypotheses are poses, scored in all cameras at once. Frames and halves by the clock,
from pictures or from voxels that are there already; kernels by the device's own events."""

#: Tables with more rows are folded.
_ROWS = 12


def _fold(grid: Grid) -> str:
    if len(grid.rows) <= _ROWS:
        return grid.markdown()
    return f"<details><summary>{grid.title}</summary>\n\n{grid.markdown()}\n\n</details>"


def _reconstruction(machine: Machine, results: Results) -> Grid:
    carving = results.sections.get("open3d", {}).get("carving")
    twin = results.sections.get("numpy", {}).get("whole")
    rows = []
    for device, what, timing in compare_programs(results):
        name = f"{device_title(device, machine)}, {what}"
        rows.append([name, number(timing.median), _spread(timing), number(timing.least),
                     _faster(carving, timing), _faster(twin, timing)])  # fmt: skip
    nx, ny, nz = results.settings["shape"]
    return Grid(
        f"{machine.title}: {results.settings['views']} cameras, {nx} x {ny} x {nz} voxels",
        ["program", "median, ms", "quartiles", "least", "Open3D : it", "NumPy : it"], rows,
    )  # fmt: skip


def _growth(machine: Machine, results: Results) -> list[Grid]:
    """Return a table for every device: voxels up to 512^3, and cameras."""
    grids = []
    for name, rows in results.sections.items():
        if not name.startswith("growth "):
            continue
        title = device_title(name.removeprefix("growth "), machine)
        cells = [
            [row["mode"], " x ".join(map(str, row["shape"])), str(row["views"]), str(row["ms"])]
            for row in rows
        ]
        heads = ["mode", "voxels", "cameras", "ms, median [quartiles]"]
        grids.append(Grid(f"{title}: growth with voxels and cameras", heads, cells))
    return grids


def _spread(timing: Timing) -> str:
    return f"{number(timing.low)} to {number(timing.high)}"


def _faster(peer: Timing | None, timing: Timing) -> str:
    return NONE if peer is None else f"{number(peer.median / timing.median)} x"
