"""Plot the error of each frame, as in figure 6.18 of Rymut's thesis and figures 4 and 5 of Kwolek &
Rymut."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from accuracy.runs import Results, Run
from psfs.common.files import write_atomically

#: Sequences that fit into one figure.
_MOST = 8


def plot_frames(path: Path, results: Results) -> bool:
    """Plot the errors by frame of the runs from the true first joints: a panel per sequence, a line
    per preset (the mean over seeds, with the span of the seeds). Return whether there are any."""
    runs = [run for run in results.runs if run.by_frame and run.setting.start == "true"]
    sequences = sorted({run.setting.sequence for run in runs})[:_MOST]
    if not sequences:
        return False
    figure, axes = plt.subplots(
        len(sequences), 1, figsize=(9, 2.6 * len(sequences)), squeeze=False, layout="constrained"
    )
    for panel, sequence in zip(axes[:, 0], sequences, strict=True):
        own = [run for run in runs if run.setting.sequence == sequence]
        names = dict.fromkeys((run.setting.preset, run.setting.observations) for run in own)
        for k, name in enumerate(names):
            of = [r for r in own if (r.setting.preset, r.setting.observations) == name]
            _draw_line(panel, of, name[0] or f"default, {name[1]}", f"C{k}")
        panel.set_title(sequence, loc="left", fontsize=10)
        panel.set_ylabel("mean error, mm")
        panel.set_ylim(bottom=0)
        panel.grid(color="#DDDDDD", lw=0.6)
        panel.legend(frameon=False, fontsize=9, loc="center left", bbox_to_anchor=(1.01, 0.5))
    axes[-1, 0].set_xlabel("frame")
    with write_atomically(path) as temporary:
        figure.savefig(temporary, dpi=110)
    plt.close(figure)
    return True


def _draw_line(panel: plt.Axes, runs: Sequence[Run], name: str, colour: str) -> None:
    shortest = min(len(run.by_frame) for run in runs)
    errors = np.array([run.by_frame[:shortest] for run in runs])
    frames = np.arange(shortest)
    panel.fill_between(frames, errors.min(0), errors.max(0), color=colour, alpha=0.2, lw=0)
    shown = f"{name}: {errors.mean():.1f} mm\n{len(runs)} seeds"
    panel.plot(frames, errors.mean(0), color=colour, lw=1.2, label=shown)
