"""Progress and results of `apf track`: a line of the bar for each take in work, a table at the
end."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from rich.table import Table

from apf.evaluation.evaluate import evaluate
from apf.evaluation.people import load_followed_truth
from apf.takes.results import Judgement, was_interrupted
from apf.tracking.progress import ProgressLine
from apf.tracking.take import Take
from apf.tracking.track import spans
from cl import InputError
from psfs.cli.commandline import remark, stderr, stdout, warn


class TakeLine(ProgressLine):
    """The line of one take in the bar of a command, which prints what there is to tell."""

    def warn(self, text: str) -> None:
        warn(text)

    def note(self, text: str) -> None:
        remark("note", "cyan", text)

    def tell(self, text: str) -> None:
        stderr.print(text, soft_wrap=True, markup=False)


@dataclass
class TakeReport:
    """The results of all takes so far, with a row for each seed."""

    names: list[str]
    rows: dict[str, list[tuple[str, ...]]] = field(default_factory=dict)
    spreads: dict[str, list[str]] = field(default_factory=dict)
    errors: dict[str, str] = field(default_factory=dict)

    def add_take(
        self, name: str, take: Take, n_frames: int, judgements: list[Judgement], spread: list[str]
    ) -> None:
        """Record a take, of which `n_frames` were requested, with a judgement per seed; call it
        once for each person. spread: lines on the differences between seeds."""
        start = "given" if take.start is None else f"{take.start.registration_error:.2f}"
        done = len(take.tracks[0])
        frames = str(done) if done == n_frames else f"{done} of {n_frames}"
        self.rows[name] = self.rows.get(name, []) + [
            (
                frames,
                f"{done / take.seconds:.1f}",
                str(one.quality.track.lost.sum()),
                start,
                one.quality.verdict,
                str(one.folder),
            )
            for one in judgements
        ]
        self.spreads[name] = self.spreads.get(name, []) + spread

    def add_failure(self, name: str, error: Exception) -> None:
        """Record a take with invalid input."""
        self.errors[name] = f"{name} failed: {error}"
        self.rows[name] = [("-", "-", "-", "-", "-", "failed")]

    def line(self, name: str) -> str:
        """Return a line on a take that is done."""
        return self.errors.get(name, f"{name}: {self.rows[name][0][0]} frames tracked")

    def show(self) -> None:
        """Print a table of all takes in the order given, the differences between their seeds, and
        the errors of those that failed."""
        table = Table()
        figures = ("frames", "frames/s", "lost frames", "start's error")
        for heading in ("take", *figures, "looks", "results"):
            words = heading in ("take", "looks", "results")
            table.add_column(heading, justify="left" if words else "right", overflow="fold")
        for name in self.names:
            for row in self.rows.get(name, [("-", "-", "-", "-", "-", "not tracked")]):
                style = "red" if name in self.errors else None
                table.add_row(name, *row, style=style)
        stdout.print(table)
        spreads = [f"{name}: {text}" for name, texts in self.spreads.items() for text in texts]
        for text in (*spreads, *self.errors.values()):
            stdout.print(text, soft_wrap=True)


def describe_spread(take: Take) -> list[str]:
    """Describe the differences between several runs and, if the truth is known, their errors."""
    tracks = take.tracks
    if len(tracks) == 1:
        return []
    joints = np.stack([track.joints for track in tracks])
    away = 1000 * np.linalg.norm(joints - joints.mean(0), axis=-1)
    lines = [f"{len(tracks)} runs: joints lie {away.mean():.1f} mm from the runs' mean"]
    path = take.sequence.folder / "truth.npz"
    with suppress(InputError):  # there is none
        truth, _ = load_followed_truth(tracks[0], path)
        errors = [1000 * evaluate(track, truth).mean_error for track in tracks]
        spread = f"{np.mean(errors):.1f} ± {np.std(errors, ddof=1):.1f} mm"
        lines.append(f"mean error: {spread}, {min(errors):.1f} to {max(errors):.1f}")
    return lines


def print_outcome(judgement: Judgement, n_frames: int) -> None:
    """Print the result of a track of which `n_frames` were requested: its quality, the frames to
    check, and the files that were written."""
    track, folder = judgement.quality.track, judgement.folder
    if was_interrupted(track, n_frames):
        stderr.print(f"{len(track)} of {n_frames} frames are in {folder}")
        return
    stdout.print(f"{len(track)} frames tracked: {folder}", soft_wrap=True)
    if len(track.restarts):
        stdout.print(f"found again by a new search in frames {spans(track.restarts.tolist())}")
    for line in judgement.quality.lines():
        stdout.print(line, soft_wrap=True)
    stdout.print(f"wrote {', '.join(judgement.files)}", soft_wrap=True)
