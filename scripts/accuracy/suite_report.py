"""Table, CSV, Markdown and plot of a suite."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from timings.tables.grid import NONE, Grid

from accuracy.runs import Results, Run
from accuracy.settings import Setting
from psfs.common.files import written_whole

_NOTE = (
    "mm, mean ± standard deviation of the seeds' means; all other figures are means over the "
    "seeds. offset-free: without the offset that a joint keeps in the body's own frame. > 150 mm: "
    "share of joint-frames. heading: runs whose start looks within 90 degrees of the truth. "
    "stature: of the body, % too tall. IoU: of the silhouettes with the true masks. limb lost: "
    "share of frames in which a limb's end is farther than 200 mm. s: all that a run took."
)
_COLOURS = {"found": "#C44E1B", "true": "#2B6CA3"}


@dataclass(frozen=True)
class Row:
    """The runs of a sequence from one start, in the columns of `_NOTE`."""

    sequence: str
    cameras: int
    start: str
    runs: int
    failed: int
    mean: float
    std: float
    rest: float
    wrists: float
    lost_joints: float
    heading_right: int
    stature: float
    iou: float
    limb_frames: float
    seconds: float

    @classmethod
    def of(cls, setting: Setting, runs: Sequence[Run], iou: float) -> Row:
        """Figures of the runs that did not fail."""
        tracked = [run for run in runs if not run.failed]

        def over(figure: Callable[[Run], float]) -> float:
            return float(np.mean([figure(run) for run in tracked])) if tracked else float("nan")

        return cls(
            setting.sequence, setting.cameras, setting.start, len(runs), len(runs) - len(tracked),
            mean=over(lambda run: run.mean),
            std=float(np.std([run.mean for run in tracked], ddof=1)) if len(tracked) > 1 else 0.0,
            rest=over(lambda run: run.rest),
            wrists=over(lambda run: run.wrists),
            lost_joints=over(lambda run: run.lost_joints),
            heading_right=sum(run.heading < 90 for run in tracked),
            stature=over(lambda run: run.stature),
            iou=iou,
            limb_frames=over(lambda run: run.limb_frames),
            seconds=over(lambda run: run.seconds),
        )  # fmt: skip

    def cells(self) -> list[str]:
        failed = f", {self.failed} failed" if self.failed else ""
        return [
            self.sequence,
            str(self.cameras),
            self.start,
            f"{self.runs}{failed}",
            f"{_shown(self.mean, '.1f')} ± {self.std:.1f}",
            _shown(self.rest, ".1f"),
            _shown(self.wrists, ".0f"),
            _shown(100 * self.lost_joints, ".1f", " %"),
            f"{self.heading_right}/{self.runs}",
            _shown(self.stature, "+.1f" if self.cameras else ".1f", " %"),
            _shown(self.iou, ".3f"),
            _shown(100 * self.limb_frames, ".0f", " %"),
            _shown(self.seconds, ".0f"),
        ]


_COLUMNS = ("sequence", "cameras", "start", "runs", "mean", "offset-free", "wrists", "> 150 mm",
            "heading right", "stature", "IoU", "limb lost", "s")  # fmt: skip


def _shown(value: float, how: str, unit: str = "") -> str:
    return NONE if np.isnan(value) else f"{value:{how}}{unit}"


def suite_rows(
    results: Results, settings: Sequence[Setting], iou: Callable[[str], float]
) -> list[Row]:
    """A row per sequence and start that has runs."""
    return [Row.of(s, results.of(s), iou(s.sequence)) for s in settings if results.of(s)]


def suite_grid(rows: Sequence[Row]) -> Grid:
    """The table, last a row of means over the sequences for each start of several."""
    cells = [row.cells() for row in rows]
    for start in dict.fromkeys(row.start for row in rows):
        of = [row for row in rows if row.start == start]
        if len(of) > 1:
            cells.append(["all", "", *_mean_row(of).cells()[2:]])
    return Grid("Errors over the suite", _COLUMNS, cells, _NOTE)


def _mean_row(rows: Sequence[Row]) -> Row:
    """Means over sequences, sums of counts, no cameras; the deviation is that between sequences,
    the stature's error without its sign."""

    def over(values: list[float]) -> float:
        known = [value for value in values if not np.isnan(value)]
        return float(np.mean(known)) if known else float("nan")

    names = ("mean", "rest", "wrists", "lost_joints", "iou", "limb_frames", "seconds")
    means = {name: over([getattr(row, name) for row in rows]) for name in names}
    return Row(
        "all", 0, rows[0].start, sum(row.runs for row in rows), sum(row.failed for row in rows),
        std=float(np.nanstd([row.mean for row in rows], ddof=1)),
        heading_right=sum(row.heading_right for row in rows),
        stature=over([abs(row.stature) for row in rows]),
        **means,
    )  # fmt: skip


def write_suite(out: Path, results: Results, rows: Sequence[Row]) -> None:
    """suite.md, suite.csv (a row per sequence and start), runs.csv (a row per run), suite.png."""
    runs = [run for run in results.runs if run.failed]
    failed = [f"- {r.setting.sequence}, seed {r.seed}, {r.setting.start}: {r.failed}" for r in runs]
    about = (
        f"{results.conditions['device']}, {results.made}, commit "
        f"{results.conditions['commit'] or 'unknown'}"
    )
    texts = ["# Accuracy over a suite", about, suite_grid(rows).markdown()]
    texts += ["Failed:", "\n".join(failed)] if failed else []
    with written_whole(out / "suite.md") as temporary:
        temporary.write_text("\n\n".join(texts) + "\n")
    results.write_csv(out / "runs.csv")
    with written_whole(out / "suite.csv") as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        names = [f.name for f in fields(Row)]
        writer.writerow(names)
        for row in rows:
            values = [getattr(row, name) for name in names]
            writer.writerow([f"{v:.4g}" if isinstance(v, float) else v for v in values])
    _plot(out / "suite.png", results, rows)


def _plot(path: Path, results: Results, rows: Sequence[Row]) -> None:
    """A row per sequence; a dot per run, a bar for the mean of its start."""
    sequences = list(dict.fromkeys(row.sequence for row in rows))
    size = (12, 1.4 + 0.55 * len(sequences))
    panels: tuple[tuple[str, Callable[[Run], float]], ...] = (
        ("mean error, mm", lambda run: run.mean),
        ("offset-free, mm", lambda run: run.rest),
        ("wrists, mm", lambda run: run.wrists),
        ("joint-frames beyond 150 mm, %", lambda run: 100 * run.lost_joints),
    )
    figure, axes = plt.subplots(1, len(panels), figsize=size, sharey=True, layout="constrained")
    for panel, (title, figure_of) in zip(axes, panels, strict=True):
        _panel(panel, results, rows, sequences, figure_of)
        panel.set_title(title, loc="left", fontsize=10)
    ious = {row.sequence: row.iou for row in rows}
    labels = [
        name if np.isnan(ious[name]) else f"{name}\nIoU {ious[name]:.2f}" for name in sequences
    ]
    axes[0].set_yticks(range(len(sequences)), labels, fontsize=8)
    axes[0].invert_yaxis()
    starts = dict.fromkeys(row.start for row in rows)
    marks = [plt.Line2D([], [], marker="o", ls="", color=_COLOURS[start]) for start in starts]
    figure.legend(
        marks, [f"start {start}" for start in starts], loc="outside lower center", ncols=2,
        frameon=False, fontsize=9,
    )  # fmt: skip
    with written_whole(path) as temporary:
        figure.savefig(temporary, dpi=130)
    plt.close(figure)


def _panel(
    axes: Any,
    results: Results,
    rows: Sequence[Row],
    sequences: list[str],
    figure_of: Callable[[Run], float],
) -> None:
    for row in rows:
        runs = [r for r in results.runs if not r.failed and r.setting.sequence == row.sequence]
        values = [figure_of(run) for run in runs if run.setting.start == row.start]
        at = sequences.index(row.sequence) + (0.17 if row.start == "true" else -0.17)
        if values:
            axes.barh(at, np.mean(values), 0.26, color=_COLOURS[row.start], alpha=0.25)
            axes.plot(values, [at] * len(values), "o", ms=4, color=_COLOURS[row.start])
    axes.set_xlim(left=0)
    axes.grid(axis="x", color="#DDDDDD", lw=0.6)
    axes.tick_params(axis="y", length=0)
