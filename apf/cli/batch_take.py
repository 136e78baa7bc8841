"""One take on a worker: the commands' own code, whose results are recorded when they are whole."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from apf.cli import export
from apf.cli.take_report import track_one
from apf.cluster.record import TakeRecord, describe_files, list_files
from apf.cluster.table import TakeRow, write_thumbnail
from apf.cluster.task_side import TaskProgress, log_to
from apf.cluster.workers import select_worker_device
from apf.evaluation.evaluate import Evaluation
from apf.evaluation.people import evaluate_tracks
from apf.request import ExportRequest, TrackRequest
from apf.takes.job import list_inputs, seed_folders
from apf.takes.results import RESULTS, FinishedTake
from cl import Device, InputError, NumpyDevice
from psfs.common.outputs import MANIFEST, output_folder
from psfs.common.requests import collect_settings


@dataclass(frozen=True)
class TakeJob:
    """A take to be tracked. request: of its track, with its folder and that of its results. log:
    the file for messages. part_frames: length of a chunk, if the take is to be cut. exports:
    formats of `apf export`."""

    name: str
    request: TrackRequest
    log: Path
    part_frames: int | None = None
    exports: tuple[str, ...] = ()

    @property
    def source(self) -> Path:
        """The folder of the take."""
        return self.request.folder

    @property
    def out(self) -> Path:
        """The folder of its results."""
        assert self.request.output is not None
        return self.request.output

    def record(self, known: TakeRecord | None = None) -> TakeRecord:
        """Return the record of the inputs and settings of the results; see
        `TakeRecord.describe_take`."""
        own = {"part_frames": self.part_frames, "exports": self.exports}
        settings = collect_settings(self.request) | own
        return TakeRecord.describe_take(self.source, settings, known)


@dataclass(frozen=True)
class TakeDone:
    """The result of a take: the rows of its tracks. kept: it was finished by an earlier run."""

    rows: tuple[TakeRow, ...]
    kept: bool


def find_finished(job: TakeJob) -> TakeDone | None:
    """Return the take if it was finished with the same inputs and settings and all its files are
    there. Only files whose size or time differ are read."""
    before = TakeRecord.read(job.out)
    if before is None or not before.is_complete(job.out):
        return None
    try:
        same = before.is_same_take(job.record(before))
    except InputError:  # the same error is raised again, and reported, when the take is tracked
        return None
    return TakeDone(tuple(map(TakeRow.from_dict, before.rows)), kept=True) if same else None


def process_take(progress: TaskProgress, job: TakeJob) -> TakeDone:
    """Track a take, unless it is finished; a worker that died just after it may have finished it.

    Raises UserError, and KeyboardInterrupt when the task is to stop.
    """
    done = find_finished(job)
    if done is not None:
        return done
    with log_to(job.log, f"{job.name}: {job.source}"):
        return write_take(
            progress, job, lambda request, device: track_one(request, device, progress)
        )


def write_take(
    progress: TaskProgress,
    job: TakeJob,
    write: Callable[[TrackRequest, Device | NumpyDevice], Sequence[FinishedTake]],
    **facts: object,
) -> TakeDone:
    """Return the take that `write(request, device)` wrote into its folder, and of which it returned
    the part of each person. The record is written last. facts: for `TakeRow`."""
    progress.begin("reading")
    record = job.record()
    began = time.monotonic()
    with output_folder(job.out, "apf batch", list_inputs(job.request), RESULTS):
        device = select_worker_device(job.request.device)
        everybody = write(job.request, device)
        progress.begin("exports")
        folders = [
            folder
            for done in everybody
            for folder in seed_folders(job.request, done.folder or job.out)
        ]
        for folder in folders if job.exports else ():
            export.run(ExportRequest(track=folder, to=job.exports))
        progress.begin("writing")
        facts |= {"device": device.name, "worker": progress.worker}
        facts |= {"took": round(time.monotonic() - began, 2)}
        rows: list[TakeRow] = []  # one for each person and seed
        for done, errors in zip(everybody, compare_with_truth(everybody), strict=True):
            own, take = seed_folders(job.request, done.folder or job.out), done.take
            for track, error, folder in zip(take.tracks, errors, own, strict=True):
                write_thumbnail(folder, take, track)
                name = "/".join((job.name, *folder.relative_to(job.out).parts))
                rows.append(TakeRow.summarise(name, folder, take, track, error, **facts))
        written = [path for path in list_files(job.out) if path.name != MANIFEST]
        outputs, values = describe_files(job.out, written), tuple(map(asdict, rows))
        replace(record, outputs=outputs, rows=values).write(job.out)
    return TakeDone(tuple(rows), kept=False)


def compare_with_truth(
    everybody: Sequence[FinishedTake],
) -> list[list[Evaluation | None]]:
    """Return the evaluation of each person's tracks, one per seed, against the take's truth; None
    without a truth."""
    path = everybody[0].take.sequence.folder / "truth.npz"
    by_seed: list[list[Evaluation | None]] = []
    for seed in range(len(everybody[0].take.tracks)):
        tracks = [done.take.tracks[seed] for done in everybody]
        frames = [done.judgements[seed].quality.seen for done in everybody]
        seen = [of.frames if own is None else own for of, own in zip(tracks, frames, strict=True)]
        found: list[Evaluation | None] = [None] * len(tracks)
        if path.is_file():
            with suppress(InputError):  # it has no joint or frame in common
                found = evaluate_tracks(tracks, seen, path)
        by_seed.append(found)
    return [list(of) for of in zip(*by_seed, strict=True)]
