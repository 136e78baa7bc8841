"""The results of a take of `apf track`: its tracks, overlay, summary and page, and what is printed
about them."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from apf.body import BodyModel, save_body
from apf.cli.method_flags import METHOD_FLAGS
from apf.cli.takes.job import TrackJob, reconstruction_config
from apf.cli.takes.kept_parts import remove_parts
from apf.cli.takes.take_report import Judgement, was_interrupted
from apf.filters.method import Method
from apf.formats.pose import write_pose
from apf.report import OVERLAY, PAGE
from apf.report.drawing import write_overlay
from apf.report.judged import (
    FILES,
    compare_with_keypoints,
    judge_track,
    run_facts,
    write_report,
)
from apf.report.quality import Quality
from apf.report.summary import SUMMARY
from apf.tracking.progress import StageProgress
from apf.tracking.take import Take
from apf.tracking.track import PARTS, PEOPLE, Track, spans
from cl import InputError
from psfs.cli.commandline import stderr, stdout
from psfs.cli.sequence_flags import collect_overrides
from psfs.cli.settings import write_settings
from psfs.diagnostics.examination import Examination
from psfs.output.reconstruction_folder import sequence_facts

#: The files and folders of a take's results.
RESULTS = (*FILES, SUMMARY, PAGE, PARTS, PEOPLE)


@dataclass(frozen=True, eq=False)
class FinishedTake:
    """A tracked take of one person. n_frames: that were to be tracked. folder: of its files.
    judgements: of each seed's track."""

    take: Take
    n_frames: int
    folder: Path
    judgements: list[Judgement]

    @property
    def interrupted(self) -> bool:
        """Whether an interrupt ended it."""
        return was_interrupted(self.take.tracks[0], self.n_frames)

    def raise_error(self) -> None:
        """Raise the error that ended the tracks early, if there is one."""
        error, n_done = self.take.error, len(self.take.tracks[0])
        if error is not None:
            where = f"{n_done} of {self.n_frames} frames are in {self.folder}"
            raise InputError(f"{error}; {where}") from error


def write_files(folder: Path, track: Track, body: BodyModel) -> None:
    """Write track.npz, joints.trc, joints.csv and body.toml into `folder`."""
    for name in ("track.npz", "joints.trc", "joints.csv"):
        track.save(folder / name)
    save_body(folder / "body.toml", body)


def write_track_settings(args: argparse.Namespace, method: Method) -> None:
    """Write the settings of all tracks beside them."""
    configs = {"method": method, "reconstruction": reconstruction_config(args)}
    write_settings(args.output, args, configs, METHOD_FLAGS)


def write_tracks(job: TrackJob, take: Take) -> None:
    """Write the files of each seed's track, except those of `finish_take`."""
    write_track_settings(job.args, job.method)
    for track, folder in zip(take.tracks, job.folders, strict=True):
        write_pose(folder / "start.txt", take.pose, take.body)
        write_files(folder, track, take.body)
        remove_parts(folder)


def finish_take(
    job: TrackJob, examination: Examination, take: Take, line: StageProgress
) -> list[Judgement]:
    """Write overlay.mp4, summary.json and report.html for every seed, as the flags say. An
    interrupted track gets only a summary, and is not compared with the silhouettes."""
    args, n_done = job.args, len(take.tracks[0])
    whole = not was_interrupted(take.tracks[0], line.n_frames)
    if whole:
        _draw_overlays(job, take, line)
    reasons = {camera.camera: str(camera) for camera in examination.left_out}
    of_start = take.start.doubts if take.start is not None else []
    of_keypoints = getattr(args, "keypoint_doubts", ())
    warnings = [*getattr(args, "remarks", ()), *of_start]  # keypoints alone are not examined
    doubts = (*examination.remaining, *of_keypoints, *of_start)
    keypoints = getattr(args, "opened_keypoints", None)
    sequence = sequence_facts(take.sequence, job.folders[0], collect_overrides(args), reasons)
    config, n_frames = reconstruction_config(args), (n_done, line.n_frames)
    facts = run_facts(job.device, sequence, config, n_frames, warnings, take.seconds)
    facts |= dict(job.of_people)
    found = []
    for track, folder in zip(take.tracks, job.folders, strict=True):
        session, compared = examination.session, whole and not args.no_report
        if compared:
            line.begin("judging")
            report = partial(line, "judging")
            quality = judge_track(session, track, report, keypoints=keypoints, doubts=doubts)
        else:
            near = compare_with_keypoints(session, track, keypoints)
            quality = Quality(track, None, near, doubts)
        quality = replace(quality, seen=job.seen)
        files = write_report(folder, job.title(take.sequence.name), quality, facts, page=compared)
        found.append(Judgement(folder, quality, files))
    return found


def _draw_overlays(job: TrackJob, take: Take, line: StageProgress) -> None:
    """Write overlay.mp4 for every seed, unless the flags disable it."""
    if job.args.no_overlay:
        return
    for track, folder in zip(take.tracks, job.folders, strict=True):
        line.begin("overlay")
        write_overlay(folder / OVERLAY, take.sequence, track, partial(line, "overlay"))


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
