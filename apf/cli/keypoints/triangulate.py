"""`apf track --method triangulate`: a track from keypoints alone, as a baseline."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from apf.cli.flags.shared import TRIANGULATE
from apf.cli.keypoints.flags import find_seen_frames, open_people_keypoints, read_keypoints
from apf.cli.method_flags import METHOD_FLAGS
from apf.cli.people_flag import people_number
from apf.keypoints import Keypoints
from apf.report.drawing import write_overlay
from apf.tracking.config import TriangulatedConfig
from apf.tracking.people import PeopleTracks, person_folder
from apf.tracking.track import PEOPLE, Track
from apf.tracking.triangulated import triangulate_track
from cl import InputError, UserError
from psfs.cameras.names import join_names
from psfs.cli.commandline import progress_bar, stdout
from psfs.cli.sequence_flags import open_sequence, select_common_frames
from psfs.cli.setting_flags import with_flags
from psfs.cli.settings import FILE, refuse_unused, write_settings
from psfs.common.outputs import output_folder
from psfs.sequence import Sequence

#: Flags that have no effect without a body.
_OF_BODIES = (
    *("init", "convention", "body", "height", "seeds", "voxel_size", "all_cameras", "preset"),
    *(flag for flag in METHOD_FLAGS if flag != "method"),
)
#: The files that are written.
RESULTS = ("track.npz", "joints.trc", "joints.csv", "overlay.mp4", FILE)


def run_triangulate(args: argparse.Namespace, names: list[str]) -> None:
    """Triangulate the keypoints of every folder: of one into OUT, of several into OUT/NAME. A take
    that fails does not stop the others. Raises InputError."""
    if args.keypoints is None:
        raise InputError(f"--method {TRIANGULATE} has nothing to triangulate; expected --keypoints")
    refuse_unused(
        args, _OF_BODIES, f"applies only to bodies, which --method {TRIANGULATE} does without"
    )
    if len(args.folders) == 1:
        _triangulate_person(args, args.folders[0], args.output)
        return
    failed: dict[str, UserError] = {}
    with output_folder(args.output, args.parser.prog, map(Path, args.folders)) as outer:
        outer.begin()  # remove the results of an earlier single take
        for folder, name in zip(args.folders, names, strict=True):
            try:
                _triangulate_person(args, folder, args.output / name)
            except UserError as error:
                failed[name] = error
    for name, why in failed.items():
        stdout.print(f"{name} failed: {why}", soft_wrap=True)
    if failed:
        raise InputError(f"{len(failed)} of {len(names)} takes failed: {join_names(failed)}")


def _triangulate_person(args: argparse.Namespace, folder: str, output: Path) -> None:
    """Triangulate one take, and write track.npz, joints.trc, joints.csv and overlay.mp4."""
    config = with_flags(TriangulatedConfig(), args)
    job = argparse.Namespace(**{**vars(args), "folder": folder, "output": output})
    sequence = open_sequence(job)
    frames = select_common_frames(job, sequence)
    selection = slice(frames.start, frames.stop, frames.step)
    if args.people != "1":
        number = None if args.people == "auto" else people_number(args.people)
        people = open_people_keypoints(job, sequence, number)
        if people:
            _triangulate_people(job, sequence, people, config, selection)
            return
    keypoints = read_keypoints(job, sequence)
    assert keypoints is not None
    with output_folder(output, args.parser.prog, sequence.inputs, RESULTS):
        track = triangulate_track(sequence, keypoints, config, selection)
        _write(args, output, sequence, track)
    stdout.print(f"{len(track)} frames triangulated: {output}", soft_wrap=True)
    stdout.print(_describe(track), soft_wrap=True)


def _triangulate_people(
    job: argparse.Namespace,
    sequence: Sequence,
    people: list[Keypoints],
    config: TriangulatedConfig,
    selection: slice,
) -> None:
    """Triangulate the keypoints of several people, and write each one's files and people.json."""
    frames = np.arange(len(sequence))[selection]
    with output_folder(job.output, job.parser.prog, sequence.inputs, (*RESULTS, PEOPLE)):
        tracks, seen = [], []
        for own in people:
            tracks.append(triangulate_track(sequence, own, config, selection))
            seen.append(find_seen_frames(own, frames))
        found = PeopleTracks(tuple(tracks), frames, tuple(seen))
        for number, track in enumerate(tracks, start=1):
            folder = person_folder(job.output, number)
            folder.mkdir(parents=True, exist_ok=True)
            for name in RESULTS[:3]:
                track.save(folder / name)
        found.save_list(job.output)
        write_settings(job.output, job)
        if not job.no_overlay:
            with progress_bar() as bar:
                task = bar.add_task("overlay", total=len(frames))
                write_overlay(
                    job.output / "overlay.mp4", sequence, found, lambda: bar.advance(task)
                )
    who = f"{len(tracks)} people" if len(tracks) > 1 else "one person"
    stdout.print(f"{len(frames)} frames of {who} triangulated: {job.output}", soft_wrap=True)
    for number, track in enumerate(tracks, start=1):
        stdout.print(f"person{number}: {_describe(track)}", soft_wrap=True)


def _write(args: argparse.Namespace, output: Path, sequence: Sequence, track: Track) -> None:
    for name in RESULTS[:3]:
        track.save(output / name)
    write_settings(output, args)
    if not args.no_overlay:
        with progress_bar() as bar:
            task = bar.add_task("overlay", total=len(track))
            write_overlay(output / "overlay.mp4", sequence, track, lambda: bar.advance(task))


def _describe(track: Track) -> str:
    """Return a line on the agreement of the cameras and on missing points."""
    errors = track.diagnostics["reprojection_error"]
    missing = float(np.isnan(track.joints).any(-1).mean())
    cameras = track.diagnostics["cameras_used"]
    return (
        f"{len(track.joint_names)} points of {cameras[cameras > 0].mean():.1f} cameras on average, "
        f"reprojection error {np.nanmean(errors):.1f} px, {100 * missing:.1f} % missing"
    )
