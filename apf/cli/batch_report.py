"""Progress of `apf batch`: a line per take in work, a bar for all, the time left, and the page."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from rich.progress import TaskID

from apf.cli.batch_take import TakeDone
from apf.cluster.table import LOGS, TakeRow, write_index
from apf.cluster.task_side import Progress
from apf.tracking.progress import BY_FRAMES
from cl import InputError
from psfs.cli.commandline import progress_bar, stderr, stdout
from psfs.cli.program import describe

#: Seconds between two versions of the page.
_APART = 10.0


class BatchReport(AbstractContextManager["BatchReport"]):
    """Shows the progress of the takes `names`. OUT/index.html and takes.csv are updated regularly,
    and at the end, also after an interrupt."""

    def __init__(self, out: Path, names: Sequence[str]) -> None:
        self._out, self._names = out, list(names)
        self._bar = progress_bar()
        self._all = self._bar.add_task("takes", total=len(names))
        self._lines: dict[str, TaskID] = {}
        self._done: dict[str, TakeDone] = {}
        self._failed: dict[str, TakeRow] = {}
        self._n_kept = 0
        self._begun, self._written = time.monotonic(), 0.0

    def __enter__(self) -> BatchReport:
        self._write()
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._bar.stop()
        self._write()
        self._show()

    def progress(self, report: Progress) -> None:
        """Show the progress of a take; called by a thread of Dask's client."""
        take = report.task.split("/")[0]
        if take in self._done or take in self._failed:
            return
        if report.task not in self._lines:
            self._lines[report.task] = self._bar.add_task(report.task, total=None)
        total = report.total if report.stage in BY_FRAMES else None
        self._bar.update(
            self._lines[report.task],
            description=f"{report.task}: {report.whose}{report.stage}",
            completed=report.done if total else 0,
            total=total,
        )

    def add(self, name: str, outcome: Any) -> None:
        """Record a take that is done, or that failed with an exception."""
        if isinstance(outcome, TakeDone):
            self._done[name] = outcome
            self._n_kept += outcome.kept
            text = "finished already" if outcome.kept else describe_done(outcome)
        else:
            text = describe(outcome)
            self._failed[name] = TakeRow(name, status="failed", error=text)
            text = f"failed: {text}"
        self._remove_lines(name)
        stderr.print(f"{name}: {text}")
        self._bar.update(self._all, advance=1, description=self._describe_progress())
        if time.monotonic() > self._written + _APART:
            self._write()

    def _describe_progress(self) -> str:
        """Return the number of failed takes, and the time left, which the bar cannot estimate for
        takes of minutes."""
        words = ["takes"]
        if self._failed:
            words.append(f"{len(self._failed)} failed")
        computed = len(self._done) + len(self._failed) - self._n_kept
        left = len(self._names) - self._n_kept - computed
        if computed and left:
            seconds = (time.monotonic() - self._begun) / computed * left
            words.append(f"about {seconds / 60:.0f} min left" if seconds > 90 else "soon done")
        return ", ".join(words)

    def _remove_lines(self, name: str) -> None:
        """Remove the lines of a take and of its chunks."""
        for task in [task for task in self._lines if task.split("/")[0] == name]:
            self._bar.remove_task(self._lines.pop(task))

    def raise_failures(self) -> None:
        """Raise InputError if a take failed."""
        if self._failed:
            names = ", ".join(name for name in self._names if name in self._failed)
            raise InputError(f"{len(self._failed)} of {len(self._names)} takes failed: {names}")

    def _write(self) -> None:
        waiting = [n for n in self._names if n not in self._done and n not in self._failed]
        rows = {name: TakeRow(name, status="waiting") for name in waiting}
        write_index(self._out, {**rows, **self._failed})
        self._written = time.monotonic()

    def _show(self) -> None:
        before = f", {self._n_kept} of them before" if self._n_kept else ""
        count = f"{len(self._done)} of {len(self._names)} takes done{before}"
        stdout.print(f"{count}: {self._out / 'index.html'}")
        for name, row in self._failed.items():
            log = self._out / LOGS / f"{name}.log"
            stdout.print(f"{name} failed: {row.error}; log: {log}")


def describe_done(outcome: TakeDone) -> str:
    """Return a line on a take that was tracked: its people, frames, and what to look at."""
    rows, first = outcome.rows, outcome.rows[0]
    lost = sum(row.lost_frames or 0 for row in rows)
    limbs = ", ".join(dict.fromkeys(row.limbs for row in rows if row.limbs))
    people = {folder for row in rows for folder in row.name.split("/")[1:] if "person" in folder}
    who = f"{len(people)} people, " if people else ""
    words = [f"{who}{first.frames} frames tracked in {first.took:.1f} s"]
    words += [f"lost in {lost}"] * (lost > 0)
    words += [f"look at {limbs}"] * bool(limbs)
    words += [verdict for verdict in dict.fromkeys(row.quality for row in rows) if verdict]
    return ", ".join(words)
