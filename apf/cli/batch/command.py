"""`apf batch`: many takes on many workers."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import closing, contextmanager

from apf.cli.batch.chunks import PARTS, plan_take
from apf.cli.batch.report import BatchReport
from apf.cli.batch.take import TakeJob, find_finished
from apf.cli.batch.takes import list_takes
from apf.cli.takes.job import take_names
from apf.cluster.connection import (
    connect_cluster,
    find_scheduler,
    import_distributed,
    start_cluster,
)
from apf.cluster.courses import run_workflows
from apf.cluster.page import FILES, LOGS
from apf.cluster.pool import Pool
from apf.cluster.whole_folder import clear_partial
from apf.cluster.workers import share_machine
from cl import InputError
from psfs.cli.settings import list_stated_words
from psfs.common.files import resolve_path
from psfs.common.names import check_name
from psfs.common.outputs import MANIFEST, output_folder
from psfs.common.ranges import check_number

#: Flags of this command that `apf track` does not have.
_OWN = ("workers", "scheduler", "part_frames", "to")
#: Names in OUT that are reserved: no take may have them.
_TAKEN = (LOGS, PARTS, *FILES, MANIFEST)


def run(args: argparse.Namespace) -> None:
    import_distributed()  # before anything that takes time
    if args.part_frames is not None:
        check_number("--part-frames", args.part_frames, 2)
    jobs = make_jobs(args)
    if args.scheduler is None and args.workers is not None:
        share_machine(args.device, args.workers)  # before anything is written
    if args.scheduler is not None and not all(map(find_finished, jobs)):
        find_scheduler(args.scheduler)
    inputs = [job.source for job in jobs]
    with output_folder(args.output, "apf batch", inputs, FILES) as out:
        out.begin()
        with BatchReport(args.output, [job.name for job in jobs]) as report:
            left = []
            for job in jobs:
                done = find_finished(job)
                left += [job] if done is None else []
                if done is not None:
                    report.add(job.name, done)
            if left:
                _do(args, left, report)
        report.raise_failures()


def _do(args: argparse.Namespace, jobs: list[TakeJob], report: BatchReport) -> None:
    with _cluster(args, len(jobs)) as client:
        courses = {job.name: plan_take(job) for job in jobs}
        pool = Pool(client, report.progress)
        with closing(run_workflows(pool, courses)) as outcomes:
            for name, outcome in outcomes:
                report.add(name, outcome)
    for job in jobs:  # no worker processes them any more, here or elsewhere
        clear_partial(job.out, of_all=True)


def make_jobs(args: argparse.Namespace) -> list[TakeJob]:
    """Return a job for each take, by its name. Raises InputError if two takes have the same name,
    if OUT lies in a take or is one, or if a take has a flag that `apf track` does not have."""
    out, takes = resolve_path(args.output), list_takes(args.folders)
    found = iter(take_names([take.source for take in takes if take.name is None]))
    words = list_stated_words(args, without=_OWN)
    jobs: dict[str, TakeJob] = {}
    for take in takes:
        name = next(found) if take.name is None else take.name
        check_name(name, f"the take {take.source}")
        if name.startswith(".") or name in _TAKEN or name in jobs:
            wanted = f"names of folders that differ, and not {' or '.join(_TAKEN)}"
            raise InputError(f"a take is called {name!r}; expected {wanted}")
        if take.source in (out / name, out, *out.parents):
            raise InputError(f"{out}: lies in the take {take.source}; expected a folder elsewhere")
        log = out / LOGS / f"{name}.log"
        own = (*words, *take.words)
        jobs[name] = TakeJob(
            name, take.source, out / name, log, own, args.configs, take.where,
            part_frames=args.part_frames, exports=tuple(args.to),
        )  # fmt: skip
        jobs[name].arguments()  # raises if a flag is invalid
    return list(jobs.values())


@contextmanager
def _cluster(args: argparse.Namespace, n_takes: int) -> Iterator[object]:
    if args.scheduler is not None:
        with connect_cluster(args.scheduler, resolve_path(args.output)) as client:
            yield client
        return
    shares = share_machine(args.device, args.workers)
    with start_cluster(shares[:n_takes] if args.workers is None else shares) as client:
        yield client
