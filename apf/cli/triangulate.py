"""`apf track --method triangulate`: a track from keypoints alone, as a baseline."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from apf.cli.take_report import TakeLine
from apf.keypoints import Keypoints
from apf.report.drawing import write_overlay
from apf.request import TRIANGULATE, TrackRequest
from apf.takes.keypoints import (
    find_seen_frames,
    open_people_keypoints,
    people_number,
    read_keypoints,
)
from apf.tracking.config import TriangulatedConfig
from apf.tracking.people import PeopleTracks, person_folder
from apf.tracking.track import PEOPLE, Track
from apf.tracking.triangulated import triangulate_track
from cl import InputError, UserError
from psfs.cameras.names import join_names
from psfs.cli.commandline import progress_bar, stdout, warn
from psfs.common.outputs import output_folder
from psfs.common.requests import SETTINGS, list_options, write_settings
from psfs.opening import open_sequence, select_common_frames
from psfs.sequence import Sequence

#: Flags that have no effect without a body.
_OF_BODIES = {
    *("init", "convention", "body", "height", "seeds", "voxel_size", "all_cameras", "preset"),
    *(option.dest for option in list_options(TrackRequest) if option.part == "method"),
} - {"method"}
#: The files that are written.
RESULTS = ("track.npz", "joints.trc", "joints.csv", "overlay.mp4", SETTINGS)


def run_triangulate(request: TrackRequest, names: list[str]) -> None:
    """Triangulate the keypoints of every folder: of one into OUT, of several into OUT/NAME. A take
    that fails does not stop the others. Raises InputError."""
    if request.keypoints is None:
        raise InputError(f"--method {TRIANGULATE} has nothing to triangulate; expected --keypoints")
    request.refuse(_OF_BODIES, f"applies only to bodies, which --method {TRIANGULATE} does without")
    output = request.output
    assert output is not None
    if len(request.folders) == 1:
        _triangulate_person(request, request.folders[0], output)
        return
    failed: dict[str, UserError] = {}
    with output_folder(output, request.COMMAND, request.folders) as outer:
        outer.begin()  # remove the results of an earlier single take
        for folder, name in zip(request.folders, names, strict=True):
            try:
                _triangulate_person(request, folder, output / name)
            except UserError as error:
                failed[name] = error
    for name, why in failed.items():
        stdout.print(f"{name} failed: {why}", soft_wrap=True)
    if failed:
        raise InputError(f"{len(failed)} of {len(names)} takes failed: {join_names(failed)}")


def _triangulate_person(request: TrackRequest, folder: Path, output: Path) -> None:
    """Triangulate one take, and write track.npz, joints.trc, joints.csv and overlay.mp4."""
    config = request.triangulated
    request = request.replace(folders=(folder,), output=output)
    line = TakeLine(progress_bar())
    sequence = open_sequence(request)
    frames = select_common_frames(request.frames, sequence, warn)
    selection = slice(frames.start, frames.stop, frames.step)
    if request.people != 1:
        number = None if request.people == "auto" else people_number(request.people)
        people = open_people_keypoints(request.keypoints, sequence, number, warn)
        if people:
            _triangulate_people(request, output, sequence, people, config, selection)
            return
    keypoints = read_keypoints(request.keypoints, sequence, line).keypoints
    assert keypoints is not None
    with output_folder(output, request.COMMAND, sequence.inputs, RESULTS):
        track = triangulate_track(sequence, keypoints, config, selection)
        _write(request, output, sequence, track)
    stdout.print(f"{len(track)} frames triangulated: {output}", soft_wrap=True)
    stdout.print(_describe(track), soft_wrap=True)


def _triangulate_people(
    request: TrackRequest,
    output: Path,
    sequence: Sequence,
    people: list[Keypoints],
    config: TriangulatedConfig,
    selection: slice,
) -> None:
    """Triangulate the keypoints of several people, and write each one's files and people.json."""
    frames = np.arange(len(sequence))[selection]
    with output_folder(output, request.COMMAND, sequence.inputs, (*RESULTS, PEOPLE)):
        tracks, seen = [], []
        for own in people:
            tracks.append(triangulate_track(sequence, own, config, selection))
            seen.append(find_seen_frames(own, frames))
        found = PeopleTracks(tuple(tracks), frames, tuple(seen))
        for number, track in enumerate(tracks, start=1):
            folder = person_folder(output, number)
            folder.mkdir(parents=True, exist_ok=True)
            for name in RESULTS[:3]:
                track.save(folder / name)
        found.save_list(output)
        write_settings(output, request)
        if request.video:
            with progress_bar() as bar:
                task = bar.add_task("overlay", total=len(frames))
                write_overlay(output / "overlay.mp4", sequence, found, lambda: bar.advance(task))
    who = f"{len(tracks)} people" if len(tracks) > 1 else "one person"
    stdout.print(f"{len(frames)} frames of {who} triangulated: {output}", soft_wrap=True)
    for number, track in enumerate(tracks, start=1):
        stdout.print(f"person{number}: {_describe(track)}", soft_wrap=True)


def _write(request: TrackRequest, output: Path, sequence: Sequence, track: Track) -> None:
    for name in RESULTS[:3]:
        track.save(output / name)
    write_settings(output, request)
    if request.video:
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
