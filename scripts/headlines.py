"""Write README's two short tables, accuracy and speed, from the stored results: `python
scripts/headlines.py`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from accuracy.runs import Results
from accuracy.suite_report import Row, suite_rows
from timings.grid import Grid, number, replace_marked
from timings.report import Machine, read_machines
from timings.whole_tables import columns, median_ms, papers, streams

_ROOT = Path(__file__).parents[1]
_RESULTS = _ROOT / "scripts" / "results"
#: What is special about the sequences outside a laboratory.
_HARD = {
    "hard_chair_6cam": "furniture hides the person",
    "hard_light_6cam": "light that changes",
    "hard_real_5cam": "calibration off, motion blur, cameras out of step",
    "hard_floor_8cam": "push-ups on the floor",
    "hard_skirt_4cam": "skirt and long hair",
    "hard_noplate_6cam": "no film of the empty room",
}


def accuracy_table() -> str:
    """Return Markdown: mean errors with an automatic start."""
    laboratory, rows = _read_rows("suite")
    own = [row for row in rows if row.observations == "voxels"]
    both = [row for row in rows if row.observations == "both"]
    cells = [
        _row(f"laboratory, {len(own)} sequences", [row.mean for row in own], own),
        _row("the same, with keypoints of a network, 12 joints", [r.limbs for r in both], both),
    ]
    hard, rows = _read_rows("hard")
    others = {row.sequence: row for row in rows if row.observations == "voxels"}
    for name, what in _HARD.items():
        cells.append([what, str(others[name].cameras), f"{others[name].mean:.0f}"])
    about = (
        f"Synthetic people with exact truth. Laboratory: {_describe_runs(laboratory, own)}; the "
        f"others: {_describe_runs(hard, list(others.values()))}."
    )
    return Grid(
        "Mean error of the joints", ["footage", "cameras", "mean error, mm"], cells, about
    ).markdown()


def _read_rows(suite: str) -> tuple[Results, list[Row]]:
    """Return the results of a suite and its rows of the defaults from an automatic start."""
    results = Results.read(_RESULTS / "accuracy" / suite / "results.json")
    settings = dict.fromkeys(run.setting for run in results.runs if not run.setting.preset)
    rows = suite_rows(results, list(settings), lambda _: np.nan)
    return results, [row for row in rows if row.start != "true"]


def _describe_runs(results: Results, rows: list[Row]) -> str:
    conditions = results.conditions
    return f"{rows[0].runs} seeds, {conditions['device']}, {results.made}, {conditions['commit']}"


def _row(what: str, errors: list[float], rows: list[Row]) -> list[str]:
    cameras = sorted({row.cameras for row in rows})
    span = f"{np.mean(errors):.0f} ({min(errors):.0f} to {max(errors):.0f})"
    return [what, f"{cameras[0]} to {cameras[-1]}", span]


def speed_table() -> str:
    """Return Markdown: a whole frame on every machine."""
    machines = read_machines(
        [folder for folder in sorted(_RESULTS.iterdir()) if (folder / "whole.json").is_file()]
    )
    cells = [list(row) for machine in machines for row in _list_headlines(machine)]
    name, *_, ms = papers()["song2012"]["tables"]["2"]["rows"][-1]
    cells.append([f"Song et al. 2012, {name}", number(ms), number(1e3 / ms)])
    about = (
        "Reconstruction, colour and one step of tracking; 8 cameras of 640 x 480, 2.25 million "
        "voxels, 200 particles x 10 layers. Streamed: pictures to pose, without colour. "
        f"{'; '.join(map(_describe_machine, machines))}."
    )
    return Grid("One frame", ["machine", "ms per frame", "frames/s"], cells, about).markdown()


def _describe_machine(machine: Machine) -> str:
    results = machine.results["whole"]
    return f"{machine.title}: {results.made[:10]}, {(results.commit or 'unknown commit')[:7]}"


def _list_headlines(machine: Machine) -> Iterator[tuple[str, str, str]]:
    """Yield title, ms and frames/s of a machine's fastest columns."""
    results = machine.results["whole"]
    found = [(title, median_ms(column)) for title, column in columns(results)]
    kinds = {
        "OpenCL CPU": min((ms for title, ms in found if "CPU" in title), default=None),
        "OpenCL GPU": min((ms for title, ms in found if "GPU" in title), default=None),
        "OpenCL GPU, streamed": min(
            (run["frames"].median for title, run in streams(results) if "GPU" in title),
            default=None,
        ),
    }
    for kind, ms in kinds.items():
        if ms is not None:
            yield f"{machine.title}: {kind}", number(ms), number(1e3 / ms)


def main() -> None:
    replace_marked(_ROOT / "README.md", "headline accuracy", accuracy_table())
    replace_marked(_ROOT / "README.md", "headline speed", speed_table())


if __name__ == "__main__":
    main()
