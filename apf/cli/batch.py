"""`apf batch`: many takes, folders and TOML lists of folders with their own settings, on many
workers."""

from __future__ import annotations

from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from apf.cli.batch_chunks import PARTS, track_take
from apf.cli.batch_report import BatchReport
from apf.cli.batch_take import TakeJob, find_finished
from apf.cluster.connection import (
    DaskPool,
    connect_cluster,
    find_scheduler,
    import_distributed,
)
from apf.cluster.processes import Pool, Processes
from apf.cluster.table import FILES, LOGS
from apf.cluster.workers import share_machine
from apf.request import TRIANGULATE, BatchRequest, TrackRequest
from apf.takes.job import take_names
from apf.takes.track import check_request
from cl import InputError
from psfs.cli.commandline import warn
from psfs.common.files import read_toml, resolve_path
from psfs.common.outputs import MANIFEST, output_folder
from psfs.common.ranges import check_name, check_number
from psfs.common.requests import Stated, read_config, read_flags

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
    if request.part_frames is not None:
        check_number("--part-frames", request.part_frames, 2)
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
    where = take.where
    try:
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
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
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
    if content or not isinstance(defaults, dict) or not _tables(takes):
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


def _tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)


def _resolve(value: Any, folder: Path) -> Any:
    """Return a setting of a list that lies in `folder`: paths are relative to it, and a list is
    what a flag writes with commas."""
    if isinstance(value, list):
        return ",".join(map(str, value))
    if isinstance(value, str) and ("/" in value or "." in value):
        named = resolve_path(folder / value)
        return str(named) if named.exists() else value
    return value
