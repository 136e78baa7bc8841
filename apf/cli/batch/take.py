"""One take on a worker: run the commands' own code, into a folder that is either complete or
absent."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NoReturn

from apf.cli import track
from apf.cli.commands import COMMANDS
from apf.cli.flags.shared import TRIANGULATE
from apf.cli.method_flags import select_method
from apf.cli.takes.flags import check_flags
from apf.cli.takes.job import list_seeds, seed_folders
from apf.cli.takes.results import FinishedTake
from apf.cluster.record import FileFacts, TakeRecord, list_files
from apf.cluster.take_row import TakeRow, write_thumbnail
from apf.cluster.task_side import TaskProgress, log_to
from apf.cluster.whole_folder import replace_folder
from apf.cluster.workers import select_worker_device
from apf.evaluation.evaluate import Evaluation
from apf.evaluation.people import evaluate_tracks
from cl import Device, InputError, NumpyDevice
from psfs.cli.commandline import CommandParser
from psfs.cli.program import program_parser
from psfs.cli.settings import collect_settings, command_flags, with_settings
from psfs.common.outputs import MANIFEST, output_folder


@dataclass(frozen=True)
class TakeJob:
    """A take to be tracked. source: its folder. out: folder of its results. log: the file for
    messages. words: the flags of its `apf track`, with absolute paths. configs: as of --config, by
    their names. where: source of the words, for errors. part_frames: length of a chunk, if the take
    is to be cut. exports: formats of `apf export`."""

    name: str
    source: Path
    out: Path
    log: Path
    words: tuple[str, ...]
    configs: Mapping[str, object] = field(default_factory=dict)
    where: str = "apf batch"
    part_frames: int | None = None
    exports: tuple[str, ...] = ()

    def arguments(self, output: Path | None = None) -> argparse.Namespace:
        """Return the arguments of `apf track` that write the results to `output`. Raises InputError
        that names the place of an invalid flag."""
        parser = program_parser("apf", "", COMMANDS, _TakeParser)
        words = ["track", str(self.source), f"--output={output or self.out}", *self.words]
        try:
            args = with_settings(parser, parser.parse_args(words), words)
        except _Refused as error:
            raise InputError(f"{self.where}: {error}") from None
        beyond = command_flags(args.parser, [str(self.source), *self.words])
        if beyond:
            raise InputError(
                f"{self.where}: {', '.join(beyond)} applies only to the whole batch; expected "
                "settings of a take"
            )
        if args.method == TRIANGULATE:
            raise InputError(f"{self.where}: {args.method} has no body; expected apf track for it")
        if self.part_frames is not None:
            if args.people not in ("auto", "1"):
                raise InputError(
                    f"{self.where}: --people is {args.people}; a take that is cut by --part-frames "
                    "has one person; expected one of them"
                )
            args.people = "1"
        args.configs = {**self.configs, **args.configs}
        try:
            check_flags(args)
        except InputError as error:
            raise InputError(f"{self.where}: {error}") from None
        return args

    def record(self, known: TakeRecord | None = None) -> TakeRecord:
        """Return the record of the inputs and settings of the results; see
        `TakeRecord.describe_take`."""
        own = {"part_frames": self.part_frames, "exports": self.exports}
        settings = collect_settings(self.arguments()) | own
        return TakeRecord.describe_take(self.source, settings, known)


class _Refused(Exception):
    """Error of argparse about the flags of a take."""


class _TakeParser(CommandParser):
    def error(self, message: str) -> NoReturn:
        raise _Refused(message)


@dataclass(frozen=True)
class TakeDone:
    """The result of a take: the rows of its tracks. kept: it was finished by an earlier run.
    seconds: duration of each stage. core_seconds: CPU time of the process."""

    rows: tuple[Mapping[str, object], ...]
    kept: bool
    seconds: Mapping[str, float] = field(default_factory=dict)
    core_seconds: Mapping[str, float] = field(default_factory=dict)


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
    return TakeDone(before.rows, kept=True) if same else None


def process_take(progress: TaskProgress, job: TakeJob) -> TakeDone:
    """Track a take, unless it is finished; a worker that died just after it may have finished it.

    Raises UserError, and KeyboardInterrupt when the task is to stop; the folder of results is then
    unchanged.
    """
    done = find_finished(job)
    if done is not None:
        return done
    with log_to(job.log, f"{job.name}: {job.source}"):
        return write_take(progress, job, lambda args, on: track.track_one(args, on, progress))


def write_take(
    progress: TaskProgress,
    job: TakeJob,
    write: Callable[[argparse.Namespace, Device | NumpyDevice], Sequence[FinishedTake]],
    **facts: object,
) -> TakeDone:
    """Return the take that `write(args, device)` wrote into the folder `args.output`, and of which
    it returned the part of each person. The folder gets its final name when the record and all
    other files of the take are in it. facts: for `TakeRow`."""
    progress.begin("reading")
    wanted = job.record()
    began = time.monotonic()
    with replace_folder(job.out) as partial, output_folder(partial, "apf batch"):
        args = job.arguments(partial)
        device = select_worker_device(args.device)
        everybody = write(args, device)
        progress.begin("exports")
        folders = [folder for done in everybody for folder in _folders(args, done.folder)]
        for folder in folders if job.exports else ():
            _run("export", str(folder), "--to", *job.exports)
        progress.begin("writing")
        facts |= {"device": device.name, "worker": progress.worker}
        facts |= {"took": round(time.monotonic() - began, 2)}
        errors = compare_with_truth(everybody)
        rows = tuple(
            row
            for done, found in zip(everybody, errors, strict=True)
            for row in _write_rows(job, args, done, found, facts)
        )
        written = [path for path in list_files(partial) if path.name != MANIFEST]
        outputs = {str(path.relative_to(partial)): FileFacts.read(path) for path in written}
        replace(wanted, outputs=outputs, rows=rows).write(partial)
    progress.end()
    return TakeDone(rows, False, dict(progress.seconds), dict(progress.core_seconds))


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


def _write_rows(
    job: TakeJob,
    args: argparse.Namespace,
    done: FinishedTake,
    errors: Sequence[Evaluation | None],
    facts: Mapping[str, object],
) -> list[dict[str, object]]:
    """Return the rows of the tracks of a person, one per seed, and write their thumbnails."""
    rows, take = [], done.take
    for own, found, folder in zip(take.tracks, errors, _folders(args, done.folder), strict=True):
        write_thumbnail(folder, take, own)
        name = "/".join((job.name, *folder.relative_to(args.output).parts))
        rows.append(TakeRow.summarise(name, folder, take, own, found, **facts).plain())
    return rows


def _folders(args: argparse.Namespace, output: Path) -> list[Path]:
    """Return the folders of the tracks of a person whose files are in `output`."""
    own = argparse.Namespace(**{**vars(args), "output": output})
    return seed_folders(own, list_seeds(args, select_method(args)))


def _run(*words: str) -> None:
    """Run another command of this program with arguments as on a command line. Raises UserError."""
    parser = program_parser("apf", "", COMMANDS)
    args = with_settings(parser, parser.parse_args(words), words)
    args.run(args)
