"""Table, CSV, Markdown and plot of a suite."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Patch
from timings.grid import NONE, Grid, cell

from accuracy.ablation import ABLATIONS
from accuracy.runs import Results, Run, Setting
from apf.body.model import sideless
from apf.evaluation.angle_truth import UNDEFINED
from apf.evaluation.evaluate import FlagCounts
from psfs.common.files import write_atomically, write_text

_NOTE = (
    "preset: whose settings, a paper's or the defaults. by: what is looked at, triangulation "
    "having neither body nor start. mm, mean ± standard deviation of the seeds' means; all other "
    "figures are means over the seeds. free: offset-free, without the offset that a joint keeps "
    "in the body's own frame. far: share of joint-frames beyond 150 mm. 12: the same of "
    "shoulders, elbows, wrists, hips, knees and ankles, which keypoints have, too. heading: runs "
    "that face within 90 degrees of the truth in their first frame. stature: of the body, % too "
    "tall. IoU: of the silhouettes with the true masks. lost: share of frames in which a limb's "
    "end is farther than 200 mm. flagged: share of such limb-frames that the track itself says to "
    "be lost; false: of those within 150 mm. in 95 %: share of the other joint-frames within the "
    "ellipsoid stated for 95 %. s: all that a run took."
)
#: Colours by observation and start.
_COLOURS = {
    ("triangulation", "none"): "#777777",
    ("voxels", "found"): "#C44E1B",
    ("voxels", "true"): "#2B6CA3",
    ("voxels", "measured"): "#1B4B72",
    ("keypoints", "found"): "#2E7D32",
    ("keypoints", "true"): "#81B784",
    ("both", "found"): "#6A2E91",
    ("both", "true"): "#B08CC6",
}
_HATCHES = ("", "//", "..", "xx", "--")


#: Preset, observation and start.
Group: TypeAlias = tuple[str, str, str]


@dataclass(frozen=True)
class Row:
    """The runs of a sequence by a preset and an observation from a start, in columns of `_NOTE`."""

    sequence: str
    cameras: int
    preset: str
    observations: str
    start: str
    runs: int
    failed: int
    mean: float
    std: float
    rest: float
    limbs: float
    limbs_rest: float
    limbs_far: float
    wrists: float
    lost_joints: float
    heading_right: int
    heading_known: int
    stature: float
    iou: float
    limb_frames: float
    flags: FlagCounts
    inside: float
    seconds: float

    @property
    def group(self) -> Group:
        """The key that rows of several sequences share."""
        return self.preset, self.observations, self.start

    @classmethod
    def create(cls, setting: Setting, runs: Sequence[Run], iou: float) -> Row:
        """Return the row of the runs that did not fail."""
        tracked = [run for run in runs if not run.failed]

        def over(figure: Callable[[Run], float]) -> float:
            return float(np.mean([figure(run) for run in tracked])) if tracked else float("nan")

        return cls(
            setting.sequence, setting.cameras, setting.preset, setting.observations, setting.start,
            len(runs), len(runs) - len(tracked),
            mean=over(lambda run: run.mean),
            std=float(np.std([run.mean for run in tracked], ddof=1)) if len(tracked) > 1 else 0.0,
            rest=over(lambda run: run.rest),
            limbs=over(lambda run: run.limbs),
            limbs_rest=over(lambda run: run.limbs_rest),
            limbs_far=over(lambda run: run.limbs_far),
            wrists=over(lambda run: run.wrists),
            lost_joints=over(lambda run: run.lost_joints),
            heading_right=sum(run.heading < 90 for run in tracked),
            heading_known=sum(bool(run.failed) or not math.isnan(run.heading) for run in runs),
            stature=over(lambda run: run.stature),
            iou=iou,
            limb_frames=over(lambda run: run.limb_frames),
            flags=_sum_flags([run.flags for run in runs]),
            inside=over(lambda run: run.inside_unflagged),
            seconds=over(lambda run: run.seconds),
        )  # fmt: skip

    def cells(self) -> list[str]:
        failed = f", {self.failed} failed" if self.failed else ""
        return [
            self.sequence,
            str(self.cameras),
            self.preset or "default",
            self.observations,
            self.start,
            f"{self.runs}{failed}",
            cell(self.mean, ".1f") + (f" ± {self.std:.1f}" if self.runs > 1 else ""),
            cell(self.rest, ".1f"),
            cell(100 * self.lost_joints, ".1f", " %"),
            cell(self.limbs, ".1f"),
            cell(self.limbs_rest, ".1f"),
            cell(100 * self.limbs_far, ".1f", " %"),
            cell(self.wrists, ".0f"),
            f"{self.heading_right}/{self.heading_known}" if self.heading_known else NONE,
            cell(self.stature, "+.1f" if self.cameras else ".1f", " %"),
            cell(self.iou, ".3f"),
            cell(100 * self.limb_frames, ".0f", " %"),
            cell(100 * self.flags.found, ".0f", " %"),
            cell(100 * self.flags.falsely, ".1f", " %"),
            cell(100 * self.inside, ".0f", " %"),
            cell(self.seconds, ".1f" if self.seconds < 10 else ".0f"),
        ]


def _sum_flags(flags: Sequence[Sequence[int]]) -> FlagCounts:
    return FlagCounts(*np.sum(flags, axis=0, dtype=int).tolist())


_COLUMNS = ("sequence", "cameras", "preset", "by", "start", "runs", "mean", "free", "far",
            "12: mean", "12: free", "12: far", "wrists", "heading", "stature", "IoU", "lost",
            "flagged", "false", "in 95 %", "s")  # fmt: skip


def suite_rows(
    results: Results, settings: Sequence[Setting], iou: Callable[[Setting], float]
) -> list[Row]:
    """Return a row per sequence, preset, observation and start that has runs."""
    return [Row.create(s, results.select(s), iou(s)) for s in settings if results.select(s)]


def suite_grid(rows: Sequence[Row]) -> Grid:
    """Return the table; its last rows are means over the sequences per preset, observation and
    start."""
    cells = [row.cells() for row in rows]
    for group in _groups(rows):
        of = [row for row in rows if row.group == group]
        if len(of) > 1:
            cells.append(["all", "", *mean_row(of).cells()[2:]])
    return Grid("Errors over the suite", _COLUMNS, cells, _NOTE)


def ablation_table(results: Results) -> Grid:
    """Return means over the sequences, and the mean error of each, of the defaults and without each
    of their parts, the most important part first."""
    settings = dict.fromkeys(r.setting for r in results.runs if r.setting.observations == "voxels")
    rows = suite_rows(results, list(settings), lambda _: np.nan)
    groups = {name: [r for r in rows if r.preset == name] for name in ("", *ABLATIONS)}
    means = {name: mean_row(of) for name, of in groups.items() if of}
    names = sorted({row.sequence for row in rows})

    def cells(shown: str, mean: Row, of: Sequence[Row]) -> list[str]:
        by = {row.sequence: f"{row.mean:.1f}" for row in of}
        figures = [f"{mean.mean:.1f}", f"{mean.rest:.1f}", f"{100 * mean.lost_joints:.1f} %"]
        return [shown, *figures, f"{mean.wrists:.0f}", *(by.get(name, NONE) for name in names)]

    # The defaults first.
    order = sorted(means, key=lambda name: (bool(name), -means[name].mean))
    table = [cells(name or "the defaults", means[name], groups[name]) for name in order]
    starts = {"found": "a start of their own", "true": "the true first joints"}
    about = (
        f"mm; far: beyond 150 mm. From {' and '.join(starts[s] for s in {r.start for r in rows})}, "
        f"up to {max(run.seed for run in results.runs) + 1} seeds; "
        f"{results.conditions['device']}, {results.made}, commit {results.conditions['commit']}."
    )
    columns = ("without", "mean", "free", "far", "wrists", *names)
    return Grid("Without a part", columns, table, about)


def angle_table(results: Results) -> Grid | None:
    """Return the errors of the joint angles by the defaults, a row per sequence; None without
    any."""
    runs = [run for run in results.runs if run.angles and not run.setting.preset]
    if not runs:
        return None
    names = list(dict.fromkeys(sideless(name) for run in runs for name in run.angles))
    shown = [name for name in names if not name.endswith(UNDEFINED)]
    rows = []
    groups = dict.fromkeys((run.setting.observations, run.setting.start) for run in runs)
    for by, start in groups:
        own = [r for r in runs if (r.setting.observations, r.setting.start) == (by, start)]
        means = {}
        for sequence in sorted({run.setting.sequence for run in own}):
            of = [run for run in own if run.setting.sequence == sequence]
            means[sequence] = {name: _mean_angle(of, name) for name in shown}
            rows.append([sequence, by, start, *_angle_cells(means[sequence])])
        over = {name: np.nanmean([m[name] for m in means.values()], axis=0) for name in shown}
        rows.append(["all", by, start, *_angle_cells(over)])
    return Grid(
        "Joint angles, degrees: RMS / without the mean offset",
        ["sequence", "by", "start", "all", *(name.replace("_", " ") for name in shown)], rows,
        "Against the truth's rotations, by apf evaluate's rules: left and right together, means "
        "over seeds. All: mean over the angles.",
    )  # fmt: skip


def _mean_angle(runs: Sequence[Run], name: str) -> np.ndarray:
    """Return (2,) degrees, means over runs and sides; NaN where no run has the angle."""
    found = [pair for run in runs for key, pair in run.angles.items() if sideless(key) == name]
    return np.mean(found, axis=0) if found else np.full(2, np.nan)


def _angle_cells(by: dict[str, np.ndarray]) -> list[str]:
    mean = np.nanmean(list(by.values()), axis=0)
    return [f"{rms:.1f} / {free:.1f}" for rms, free in (mean, *by.values())]


def _groups(rows: Sequence[Row]) -> list[Group]:
    """Return the presets, observations and starts in the order of the rows."""
    return list(dict.fromkeys(row.group for row in rows))


def mean_row(rows: Sequence[Row]) -> Row:
    """Return means over sequences, and sums of counts, without cameras. The deviation is that
    between sequences; errors of stature enter as absolute values."""

    def over(values: list[float]) -> float:
        known = [value for value in values if not np.isnan(value)]
        return float(np.mean(known)) if known else float("nan")

    names = ("mean", "rest", "limbs", "limbs_rest", "limbs_far", "wrists", "lost_joints", "iou",
             "limb_frames", "inside", "seconds")  # fmt: skip
    means = {name: over([getattr(row, name) for row in rows]) for name in names}
    return Row(
        "all", 0, *rows[0].group,
        sum(row.runs for row in rows), sum(row.failed for row in rows),
        std=float(np.nanstd([row.mean for row in rows], ddof=1)),
        heading_right=sum(row.heading_right for row in rows),
        heading_known=sum(row.heading_known for row in rows),
        flags=_sum_flags([row.flags for row in rows]),
        stature=over([abs(row.stature) for row in rows]),
        **means,
    )  # fmt: skip


def write_suite(out: Path, results: Results, rows: Sequence[Row]) -> None:
    """Write suite.md, suite.csv (a row per sequence, preset, observation and start), runs.csv (a
    row per run), suite.png."""
    runs = [run for run in results.runs if run.failed]
    failed = [
        f"- {r.setting.sequence}, {r.setting.preset or 'default'}, {r.setting.observations}, "
        f"seed {r.seed}, {r.setting.start}: {r.failed}"
        for r in runs
    ]
    about = (
        f"{results.conditions['device']}, {results.made}, commit "
        f"{results.conditions['commit'] or 'unknown'}"
    )
    texts = ["# Accuracy over a suite", about, suite_grid(rows).markdown()]
    if any(row.preset in ABLATIONS for row in rows):
        texts.append(ablation_table(results).markdown())
    angles = angle_table(results)
    texts += [] if angles is None else [angles.markdown()]
    texts += ["Failed:", "\n".join(failed)] if failed else []
    write_text(out / "suite.md", "\n\n".join(texts) + "\n")
    results.write_csv(out / "runs.csv")
    with write_atomically(out / "suite.csv") as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        names = [f.name for f in fields(Row) if f.name != "flags"]
        writer.writerow(names + list(FlagCounts._fields))
        for row in rows:
            values = [*(getattr(row, name) for name in names), *row.flags]
            writer.writerow([f"{v:.4g}" if isinstance(v, float) else v for v in values])
    _plot(out / "suite.png", results, rows)


def _plot(path: Path, results: Results, rows: Sequence[Row]) -> None:
    """Plot a row per sequence, with a dot per run and a bar for the mean of its preset, observation
    and start. Ablations are left out, because they are too many."""
    rows = [row for row in rows if row.preset not in ABLATIONS] or rows
    sequences, groups = list(dict.fromkeys(row.sequence for row in rows)), _groups(rows)
    size = (12, 1.4 + len(sequences) * max(0.55, 0.2 * len(groups)))
    panels: tuple[tuple[str, Callable[[Run], float]], ...] = (
        ("mean error, mm", lambda run: run.mean),
        ("offset-free, mm", lambda run: run.rest),
        ("wrists, mm", lambda run: run.wrists),
        ("joint-frames beyond 150 mm, %", lambda run: 100 * run.lost_joints),
    )
    if {row.observations for row in rows} != {"voxels"}:  # the joints that all observations have
        panels = (
            ("mean error of 12 joints, mm", lambda run: run.limbs),
            ("offset-free, 12 joints, mm", lambda run: run.limbs_rest),
            panels[2],
            ("beyond 150 mm, 12 joints, %", lambda run: 100 * run.limbs_far),
        )
    figure, axes = plt.subplots(1, len(panels), figsize=size, sharey=True, layout="constrained")
    for panel, (title, figure_of) in zip(axes, panels, strict=True):
        _panel(panel, results, rows, sequences, figure_of)
        panel.set_title(title, loc="left", fontsize=10)
    ious = {row.sequence: row.iou for row in rows if not row.preset}
    labels = [
        name if np.isnan(ious.get(name, np.nan)) else f"{name}\nIoU {ious[name]:.2f}"
        for name in sequences
    ]
    axes[0].set_yticks(range(len(sequences)), labels, fontsize=8)
    axes[0].invert_yaxis()
    hatches = _hatches(groups)
    marks = [
        Patch(facecolor=_COLOURS[group[1:]], alpha=0.5, hatch=hatches[group[0]]) for group in groups
    ]
    named = [_describe_block(*group) for group in groups]
    figure.legend(
        marks, named, loc="outside lower center", ncols=4, frameon=False, fontsize=9
    )  # fmt: skip
    with write_atomically(path) as temporary:
        figure.savefig(temporary, dpi=130)
    plt.close(figure)


def _describe_block(preset: str, observations: str, start: str) -> str:
    shown = observations if start == "none" else f"{observations}, start {start}"
    return f"{preset}: {shown}" if preset else shown


def _hatches(groups: Sequence[Group]) -> dict[str, str]:
    """Return the hatching of the bars of each preset."""
    presets = dict.fromkeys(preset for preset, _, _ in groups)
    return {preset: _HATCHES[k % len(_HATCHES)] for k, preset in enumerate(presets)}


def _panel(
    axes: Any,
    results: Results,
    rows: Sequence[Row],
    sequences: list[str],
    figure_of: Callable[[Run], float],
) -> None:
    groups = _groups(rows)
    hatches = _hatches(groups)
    pitch = 0.68 / len(groups)
    for row in rows:
        group = row.group
        runs = [r for r in results.runs if not r.failed and r.setting.sequence == row.sequence]
        values = [
            figure_of(run)
            for run in runs
            if (run.setting.preset, run.setting.observations, run.setting.start) == group
        ]
        colour = _COLOURS[group[1:]]
        at = sequences.index(row.sequence) + pitch * (groups.index(group) - (len(groups) - 1) / 2)
        if values:
            hatch = hatches[group[0]]
            axes.barh(at, np.mean(values), 0.8 * pitch, color=colour, alpha=0.25, hatch=hatch)
            axes.plot(values, [at] * len(values), "o", ms=4, color=colour)
    axes.set_xlim(left=0)
    axes.grid(axis="x", color="#DDDDDD", lw=0.6)
    axes.tick_params(axis="y", length=0)
