"""The results of a take: the files of its tracks, and their judgements."""

from __future__ import annotations

from collections.abc import Sequence as Items
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from apf.body.model import BodyModel
from apf.body.toml import save_body
from apf.formats.pose import write_pose
from apf.report import FILES, OVERLAY, PAGE
from apf.report.summary import SUMMARY
from apf.takes.job import TrackJob
from apf.tracking.people import PeopleTracks, person_folder
from apf.tracking.take import Take
from apf.tracking.track import PARTS, PEOPLE, Track, part_name
from cl import InputError
from psfs.common.requests import write_settings
from psfs.common.system import versions
from psfs.diagnostics.examination import Examination
from psfs.opening import stated_keys
from psfs.output.reconstruction_folder import device_facts, sequence_facts
from psfs.sequence import Sequence

if TYPE_CHECKING:
    from apf.report.quality import Quality

#: The files and folders of a take's results.
RESULTS = (*FILES, SUMMARY, PAGE, PARTS, PEOPLE)


@dataclass(frozen=True, eq=False)
class Judgement:
    """The judgement of one seed's track: its folder, its quality and the names of its files."""

    folder: Path
    quality: Quality
    files: list[str]


@dataclass(frozen=True, eq=False)
class FinishedTake:
    """A tracked take of one person. n_frames: that were to be tracked. folder: of its files, None
    if nothing was written. judgements: of each seed's track. everybody: the tracks of all, if
    several people were looked for."""

    take: Take
    n_frames: int
    folder: Path | None
    judgements: list[Judgement]
    everybody: PeopleTracks | None = None

    @property
    def interrupted(self) -> bool:
        """Whether an interrupt ended it."""
        return was_interrupted(self.take.tracks[0], self.n_frames)

    def raise_error(self) -> None:
        """Raise the error that ended the tracks early, if there is one."""
        error, n_done = self.take.error, len(self.take.tracks[0])
        if error is None:
            return
        if self.folder is None:
            raise error
        where = f"{n_done} of {self.n_frames} frames are in {self.folder}"
        raise InputError(f"{error}; {where}") from error


def was_interrupted(track: Track, n_frames: int) -> bool:
    """Return whether an interrupt ended a track of `n_frames`, in the forward or in the backward
    pass."""
    return len(track) < n_frames or track.interrupted


class Keeper:
    """Writes the chunks of each seed's track into its folder while the rest is tracked, in case the
    process is killed; see `apf.tracking.take.Keep`."""

    def __init__(self, folders: Items[Path]) -> None:
        self._folders, self._begun = folders, False

    def __call__(self, body: BodyModel, pose: np.ndarray, parts: Items[Track]) -> list[Path]:
        written = []
        for folder, part in zip(self._folders, parts, strict=True):
            if not self._begun:
                write_pose(folder / "start.txt", pose, body)
                save_body(folder / "body.toml", body)
            written.append(part_name(folder, part))
            part.save(written[-1])
        self._begun = True
        return written


def remove_parts(folder: Path) -> None:
    """Remove the chunks after the whole track is written."""
    for part in folder.glob(PARTS):
        part.unlink()
    with suppress(OSError):  # the folder may not exist
        (folder / PARTS).parent.rmdir()


def write_files(folder: Path, track: Track, body: BodyModel) -> None:
    """Write track.npz, joints.trc, joints.csv and body.toml into `folder`."""
    for name in ("track.npz", "joints.trc", "joints.csv"):
        track.save(folder / name)
    save_body(folder / "body.toml", body)


def write_people(folder: Path, tracks: PeopleTracks) -> list[Path]:
    """Write the files of each track, see `write_files`: of one into `folder`, of several into a
    folder for each in it, beside people.json. Return the folders."""
    several, numbers = len(tracks) > 1, range(1, len(tracks) + 1)
    folders = [person_folder(folder, number) for number in numbers] if several else [folder]
    for track, into in zip(tracks, folders, strict=True):
        write_files(into, track, track.its_body)
    if several:
        tracks.save_list(folder)
    return folders


def write_tracks(job: TrackJob, take: Take) -> None:
    """Write the settings of all tracks, and the files of each seed's, except those of
    `finish_take`."""
    assert job.request.output is not None
    write_settings(job.request.output, job.request, ["method", "reconstruction"])
    for track, folder in zip(take.tracks, job.folders, strict=True):
        pose = take.pose if track.lost[0] else track.poses[0]
        write_pose(folder / "start.txt", pose, take.body)
        write_files(folder, track, take.body)
        remove_parts(folder)


def finish_take(job: TrackJob, examination: Examination, take: Take) -> list[Judgement]:
    """Write overlay.mp4, summary.json and report.html for every seed, as the request says. An
    interrupted track gets only a summary, and is not compared with the silhouettes."""
    from apf.report.drawing import write_overlay  # reports take a while to load
    from apf.report.judged import judge_track, paint_surface, write_report

    request, line, session = job.request, job.progress, examination.session
    n_done, n_frames = len(take.tracks[0]), line.n_frames
    whole = not was_interrupted(take.tracks[0], n_frames)
    if whole and request.video:
        for track, folder in zip(take.tracks, job.folders, strict=True):
            line.begin("overlay")
            report = partial(line, "overlay")
            write_overlay(folder / OVERLAY, take.sequence, track, report)
    reasons = {fault.cameras[0]: str(fault) for fault in examination.left_out}
    of_start = take.start.doubts if take.start is not None else []
    warnings = [*job.remarks, *job.doubts, *of_start]
    doubts = (*examination.remaining, *job.doubts, *of_start)
    overrides = stated_keys(request.capture)
    sequence = sequence_facts(take.sequence, job.folders[0], overrides, reasons)
    facts = {
        "complete": whole,
        "frames": n_done,
        "frames_wanted": n_frames,
        "sequence": sequence,
        "config": session.reconstruction.to_dict(),
        "device": device_facts(job.device),
        "versions": versions(),
        "seconds": round(take.seconds, 2),
        "warnings": warnings,
        **job.of_people,
    }
    judgements, compared = [], whole and request.report
    for track, folder in zip(take.tracks, job.folders, strict=True):
        if compared:
            line.begin("checking")
        quality = judge_track(
            session, track, partial(line, "checking"), keypoints=job.keypoints, doubts=doubts,
            silhouettes=compared,
        )  # fmt: skip
        quality = replace(quality, seen=job.seen)
        if (painted := paint_surface(quality)) is not track:
            painted.save(folder / "track.npz")
        files = write_report(folder, job.title(take.sequence.name), quality, facts, page=compared)
        judgements.append(Judgement(folder, quality, files))
    return judgements


def write_together(job: TrackJob, tracks: PeopleTracks, sequence: Sequence, whole: bool) -> None:
    """Write people.json; and, as the request says, the overlay and the page of all people, if the
    tracks are `whole`. With several seeds nothing: each person's folders hold a track per seed."""
    folder, line = job.request.output, job.progress
    if len(job.folders) > 1 or folder is None:
        return
    from apf.report.drawing import write_overlay
    from apf.report.page import write_page

    tracks.save_list(folder)
    if whole and job.request.video:
        line.n_frames = len(tracks.frames)
        line.begin("overlay")
        write_overlay(folder / OVERLAY, sequence, tracks, lambda: line("overlay"))
    if whole and job.request.report:
        write_page(folder / PAGE, sequence.name, tracks, folder / OVERLAY)
