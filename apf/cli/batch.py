"""`apf batch`: many takes, folders and TOML lists of folders with their own settings, on many
workers.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack, closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from rich.progress import TaskID

from apf.cli.batch_chunks import PARTS, track_take
from apf.cli.batch_take import TakeDone, TakeJob, find_finished
from apf.cluster.connection import DaskPool, connect_cluster, find_scheduler, import_distributed
from apf.cluster.processes import Pool, Processes
from apf.cluster.table import FILES, LOGS, TakeRow, write_index
from apf.cluster.task_side import Progress
from apf.cluster.workers import share_machine
from apf.request import TRIANGULATE, BatchRequest, TrackRequest
from apf.takes.job import take_names
from apf.takes.track import check_request
from apf.tracking.progress import BY_FRAMES
from cl import InputError
from psfs.cli.commandline import progress_bar, stderr, stdout, warn
from psfs.cli.program import describe
from psfs.common.files import name_file_in_errors, read_toml, resolve_path
from psfs.common.outputs import MANIFEST, output_folder
from psfs.common.ranges import check_name
from psfs.common.requests import Stated, read_config, read_flags

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
        for task in [task for task in self._lines if task.split("/")[0] == name]:
            self._bar.remove_task(self._lines.pop(task))
        stderr.print(f"{name}: {text}")
        words = ["takes"]
        if self._failed:
            words.append(f"{len(self._failed)} failed")
        computed = len(self._done) + len(self._failed) - self._n_kept
        left = len(self._names) - self._n_kept - computed
        if computed and left:  # which the bar cannot estimate for takes of minutes
            seconds = (time.monotonic() - self._begun) / computed * left
            words.append(f"about {seconds / 60:.0f} min left" if seconds > 90 else "soon done")
        self._bar.update(self._all, advance=1, description=", ".join(words))
        if time.monotonic() > self._written + _APART:
            self._write()

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


#: Names in OUT that are reserved: no take may have them.
_TAKEN = (LOGS, PARTS, *FILES, MANIFEST)


@dataclass(frozen=True)
class ListedTake:
    """A take as requested: its folder, its name if one was given, what it states itself, and
    where, for errors."""

    source: Path
    name: str | None = None
    stated: Stated = field(default_factory=Stated)
    where: str = "apf batch"


def run(request: BatchRequest) -> None:
    if request.scheduler is not None:
        import_distributed()  # before anything that takes time
    jobs = make_jobs(request)
    assert request.output is not None
    shares = [] if request.scheduler else share_machine(request.device, request.workers)
    done = {job.name: take for job in jobs if (take := find_finished(job)) is not None}
    left = [job for job in jobs if job.name not in done]
    if left and request.scheduler is not None:
        find_scheduler(request.scheduler)  # before anything is written
    with ExitStack() as stack:
        inputs = [job.source for job in jobs]
        out = output_folder(request.output, request.COMMAND, inputs, FILES)
        stack.enter_context(out).begin()
        report = stack.enter_context(BatchReport(request.output, [job.name for job in jobs]))
        for name, take in done.items():
            report.add(name, take)
        if left:
            pool: Pool
            if request.scheduler is not None:
                cluster = connect_cluster(request.scheduler, resolve_path(request.output))
                pool = DaskPool(stack.enter_context(cluster), report.progress)
            else:
                shares = shares[: len(left)] if request.workers is None else shares
                pool = stack.enter_context(Processes(shares, report.progress))
            takes = ((job.name, partial(track_take, pool, job)) for job in left)
            for name, outcome in stack.enter_context(closing(pool.outcomes(takes))):
                report.add(name, outcome)
    report.raise_failures()


def make_jobs(request: BatchRequest) -> list[TakeJob]:
    """Return a job for each take, by its name. Raises InputError if two takes have the same name,
    if OUT lies in a take or is one, or if a take has a flag that `apf track` does not have."""
    out, takes = resolve_path(request.output or Path()), list_takes(request.folders)
    names = iter(take_names(tuple(take.source for take in takes if take.name is None)))
    jobs: dict[str, TakeJob] = {}
    for take in takes:
        name = next(names) if take.name is None else take.name
        check_name(name, f"the take {take.source}")
        if name.startswith(".") or name in _TAKEN or name in jobs:
            wanted = f"names of folders that differ, and not {' or '.join(_TAKEN)}"
            raise InputError(f"a take is called {name!r}; expected {wanted}")
        if take.source in (out / name, out, *out.parents):
            raise InputError(f"{out}: lies in the take {take.source}; expected a folder elsewhere")
        jobs[name] = TakeJob(
            name, make_request(request, take, out / name), out / LOGS / f"{name}.log",
            request.part_frames, tuple(request.to),
        )  # fmt: skip
    return list(jobs.values())


def make_request(batch: BatchRequest, take: ListedTake, out: Path) -> TrackRequest:
    """Return the request of one take: what it states itself counts before what the batch states.
    Raises InputError that names the place of an invalid flag."""
    with name_file_in_errors(take.where):
        stated = Stated({"folders": (take.source,), "output": out}).over(take.stated)
        request = TrackRequest.from_stated(stated.over(batch.stated).only(TrackRequest))
        if request.triangulate:
            raise InputError(f"{TRIANGULATE} has no body; expected apf track for it")
        if batch.part_frames is not None:
            if request.people not in ("auto", 1):
                raise InputError(
                    f"--people is {request.people}; a take that is cut by --part-frames has one "
                    "person; expected one of them"
                )
            request = request.replace(people=1)
        check_request(request)
    return request


def list_takes(folders: tuple[Path, ...]) -> list[ListedTake]:
    """Return the takes that the command names. Raises InputError."""
    takes: list[ListedTake] = []
    for folder in folders:
        if folder.suffix == ".toml" and folder.exists() and not folder.is_dir():
            takes += _read_list(folder)
        elif folder.is_file():
            warn(f"{folder}: no folder; left out")  # `takes/*` also matches files such as notes
        else:
            takes.append(ListedTake(resolve_path(folder)))
    if not takes:
        raise InputError("no take is named; expected folders, or a TOML list of them")
    return takes


def _read_list(path: Path) -> list[ListedTake]:
    """Return the takes of a list: [[take]] with folder, optional name, and flags of `apf track` by
    their names; [defaults] hold for takes that do not set them."""
    content = read_toml(path)
    defaults, takes = content.pop("defaults", {}), content.pop("take", None)
    tables = isinstance(takes, list) and takes and all(isinstance(each, dict) for each in takes)
    if content or not isinstance(defaults, dict) or not tables:
        found = ", ".join(content) or "no list of takes"
        raise InputError(f"{path}: found {found}; expected [[take]] tables, and perhaps [defaults]")
    listed = []
    for number, stated in enumerate(takes, 1):
        where = f"{path}: take {number}"
        flags = {k.replace("_", "-"): v for part in (defaults, stated) for k, v in part.items()}
        folder, name = flags.pop("folder", None), flags.pop("name", None)
        if not isinstance(folder, str) or not isinstance(name, str | None):
            raise InputError(f"{where}: folder = {folder!r}, name = {name!r}; expected text")
        values = {flag: _resolve(value, path.parent) for flag, value in flags.items()}
        config = values.pop("config", None)
        stated = Stated(read_flags(where, TrackRequest, values))
        if config is not None:
            stated = stated.over(read_config(TrackRequest, Path(config)))
        listed.append(ListedTake(resolve_path(path.parent / folder), name, stated, where))
    return listed


def _resolve(value: Any, folder: Path) -> Any:
    """Return a setting of a list that lies in `folder`: paths are relative to it, and a list is
    what a flag writes with commas."""
    if isinstance(value, list):
        return ",".join(map(str, value))
    if isinstance(value, str) and ("/" in value or "." in value):
        named = resolve_path(folder / value)
        return str(named) if named.exists() else value
    return value
