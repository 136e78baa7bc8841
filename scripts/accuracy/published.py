"""The tables of suites in docs/accuracy.md."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from timings.grid import NONE, Grid, replace_marked

from accuracy.runs import OBSERVATIONS, Results
from accuracy.suite_report import Row, suite_rows
from cl import InputError


def suite_headline(results: Results) -> str:
    """Return Markdown for docs/accuracy.md: means of the default's runs with an automatic start.
    Raises InputError if there are none."""
    settings = dict.fromkeys(run.setting for run in results.runs if not run.setting.preset)
    rows = [r for r in suite_rows(results, list(settings), lambda _: np.nan) if r.start != "true"]
    voxels = {row.sequence: row for row in rows if row.observations == "voxels"}
    if not voxels:
        raise InputError("the results hold no runs of a suite by voxels from a start of their own")
    kinds = [w for w in OBSERVATIONS if any(row.observations == w for row in rows)]
    cells = []
    for name, own in sorted(voxels.items()):
        by = {row.observations: row for row in rows if row.sequence == name}
        shown = [f"{by[w].limbs:.1f}" if w in by else NONE for w in kinds]
        cells.append(
            [name, str(own.cameras), f"{own.mean:.1f} ± {own.std:.1f}", *_spread(own), *shown]
        )
    own = list(voxels.values())
    limbs = [[r.limbs for r in rows if r.observations == w] for w in kinds]
    means = [f"{np.mean(values):.1f}" if len(values) == len(own) else NONE for values in limbs]
    mean = f"{np.mean([row.mean for row in own]):.1f}"
    cells.append(["mean", "", mean, *_spread(*own), *means])
    columns = ["sequence", "cameras", "15 joints: voxels", "offset-free", "beyond 150 mm"]
    columns += [f"12 joints: {w}" for w in kinds]
    about = (
        f"{own[0].runs} seeds, from a start of their own; "
        f"{results.conditions['device']}, {results.made}, commit "
        f"{results.conditions['commit'] or 'unknown'}. Offset-free: without the offset that a "
        "joint keeps in the body's own frame. Triangulation has keypoints alone, both: voxels and "
        "keypoints."
    )
    return Grid("Mean error, mm", columns, cells, about).markdown()


def _spread(*rows: Row) -> list[str]:
    """Return the cells of the mean offset-free error, mm, and of joint-frames beyond 150 mm."""
    far = 100 * np.mean([row.lost_joints for row in rows])
    return [f"{np.mean([row.rest for row in rows]):.1f}", f"{far:.1f} %"]


def publish_suite(root: Path, results: Results) -> None:
    """Write the table of docs/accuracy.md that has the name of the results' folder, `suite` or
    `hard`; for a suite of presets only, that of docs/papers.md."""
    page = root / "docs" / "accuracy.md"
    if any(not run.setting.preset for run in results.runs):
        replace_marked(page, results.path.parent.name, suite_headline(results))
        return
    replace_marked(root / "docs" / "papers.md", "trial", trial_headline(results))


def trial_headline(results: Results) -> str:
    """Return Markdown with the mean error of each preset from the true first joints, with the
    body's own girths and, if there are such runs, with measured ones."""
    groups: dict[str, dict[str, Row]] = {}
    for setting in dict.fromkeys(run.setting for run in results.runs):
        if setting.start in _TRUE_STARTS:
            column = f"{setting.preset}{_TRUE_STARTS[setting.start]}"
            row = Row.create(setting, results.select(setting), float("nan"))
            groups.setdefault(column, {})[setting.sequence] = row
    names = sorted({name for of in groups.values() for name in of})
    cells = [
        [name, *(_describe_row(of[name]) if name in of else NONE for of in groups.values())]
        for name in names
    ]
    note = (
        f"mm, ± between up to {max(run.seed for run in results.runs) + 1} seeds; far: joint-frames "
        f"beyond 150 mm; {results.conditions['device']}, {results.made}, commit "
        f"{results.conditions['commit']}."
    )
    title = "Mean error from the true first joints"
    return Grid(title, ["sequence", *groups], cells, note).markdown()


#: Starts from the true joints, and their names beside the preset's.
_TRUE_STARTS = {"true": "", "measured": ", measured girths"}


def _describe_row(row: Row) -> str:
    if row.failed == row.runs:
        return "nobody found"
    deviation = f" ± {row.std:.1f}" if row.runs - row.failed > 1 else ""
    return f"{row.mean:.1f}{deviation}, {100 * row.lost_joints:.0f} % far"
