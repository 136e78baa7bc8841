"""Tables of `compare_timings.py apf`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from timings.measure import Timing
from timings.results import Results
from timings.tables.grid import Grid, number
from timings.tables.whole import SPECIFICATION

_HALVES = ("both", "reconstruction", "tracking")
_HEADINGS = ("pictures to pose", "reconstruction", "tracking")


def print_report(results: Results) -> None:
    """Print the results, the most interesting first."""
    for grid in tables(results):
        grid.show()


def tables(results: Results) -> list[Grid]:
    """Return tables: devices beside each other, growth with each setting, kernels of each
    device."""
    devices = [section for name, section in results.sections.items() if name.startswith("device ")]
    growths = [
        _growth(name, section)
        for name, section in results.sections.items()
        if name.startswith(("particles, ", "layers, ", "cameras, "))
    ]
    return [_devices(results, devices), *growths, *map(_kernels, devices)]


def rate(scored: int, cameras: int, timing: Timing) -> float:
    """Return hypotheses times cameras per second."""
    return scored * cameras / (1e-3 * timing.median)


def _devices(results: Results, devices: list[Mapping[str, Any]]) -> Grid:
    settings, twin = results.settings, results.sections.get("numpy")
    views, scored = settings["views"], settings["scored"]
    slow = rate(twin["scored"], views, twin["scoring"]) if twin else None
    rows = []
    if twin and slow:
        rows.append([f"NumPy, {SPECIFICATION}", "", number(slow), "1", "", "", ""])
    for device in devices:
        fast = rate(scored, views, device["scoring"])
        rows.append([
            device["label"], str(device["scoring"]), number(fast),
            number(fast / slow) if slow else "", *(str(device[half]) for half in _HALVES),
        ])  # fmt: skip
    search = settings["filter"]
    title = (
        f"{views} cameras; a frame of {search['n_particles']} particles x {search['n_layers']} "
        "layers, ms, median [quartiles]"
    )
    first = ("device", f"{scored} scored", "hypotheses x cameras / s", "x NumPy")
    return Grid(title, (*first, *_HEADINGS), rows)


def _growth(name: str, section: list[Mapping[str, Any]]) -> Grid:
    what, label = name.split(", ", 1)
    rows = [
        [
            f"{row['value']:,}",
            number(rate(row["scored"], row["cameras"], row["scoring"])) if "scoring" in row else "",
            *(str(row[half]) for half in _HALVES),
        ]
        for row in section
    ]
    return Grid(
        f"{label}: growth with {what}, ms", (what, "hypotheses x cameras / s", *_HEADINGS), rows
    )


def _kernels(device: Mapping[str, Any]) -> Grid:
    rows = []
    for half, kernels in device["kernels"].items():
        total = sum(timing.median for timing in kernels.values())
        for name, timing in sorted(kernels.items(), key=lambda row: -row[1].median):
            rows.append([half, name, str(timing), f"{timing.median / total:.0%}"])
        rows.append([half, "all", number(total), ""])
    return Grid(
        f"{device['label']}: device time per frame, ms", ("half", "kernel", "ms", "share"), rows
    )
