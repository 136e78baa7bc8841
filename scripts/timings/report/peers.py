"""The reconstruction against its peers, and the tracker's rate: tables of `psfs` and `apf`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from timings.report.machines import Machine, device_title, missing, name_processors
from timings.tables.apf import tables
from timings.tables.grid import Grid
from timings.tables.psfs import comparison_table, growth_tables


def peers(machines: Sequence[Machine]) -> str:
    """Return the chapters on the two halves alone, as far as they were measured."""
    names = {machine: partial(device_title, machine=machine) for machine in machines}
    reconstruction = [
        text
        for machine in machines
        if "psfs" in machine.results
        for text in (
            comparison_table(machine.results["psfs"], machine.title, names[machine]).markdown(),
            *(_fold(grid) for grid in growth_tables(machine.results["psfs"], names[machine])),
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
