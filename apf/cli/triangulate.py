"""`apf track --method triangulate`: a track from keypoints alone, as a baseline."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from apf.keypoints.keypoints import Keypoints
from apf.report.drawing import write_overlay
from apf.request import TRIANGULATE, TrackRequest
from apf.takes.job import take_names
from apf.takes.keypoints import (
    find_seen_frames,
    open_people_keypoints,
    people_number,
    read_keypoints,
)
from apf.tracking.people import PeopleTracks, person_folder
from apf.tracking.progress import StageProgress
from apf.tracking.track import PEOPLE, Track
from apf.tracking.triangulated import triangulate_track
from cl import InputError, UserError
from psfs.cameras.names import join_names
from psfs.cli.commandline import progress_bar, stdout, warn
from psfs.common.outputs import output_folder
from psfs.common.requests import SETTINGS, list_options, write_settings
from psfs.opening import open_sequence, select_common_frames

#: Flags that have no effect without a body.
_OF_BODIES = {
    *("init", "convention", "body", "height", "seeds", "voxel_size", "all_cameras", "preset"),
    *(option.dest for option in list_options(TrackRequest) if option.part == "method"),
} - {"method"}
#: The files that are written.
RESULTS = ("track.npz", "joints.trc", "joints.csv", "overlay.mp4", SETTINGS)


def run_triangulate(request: TrackRequest, line: StageProgress) -> None:
    """Triangulate the keypoints of every folder: of one into OUT, of several into OUT/NAME. A take
    that fails does not stop the others. line: tells what there is to tell. Raises InputError."""
    if request.keypoints is None:
        raise InputError(f"--method {TRIANGULATE} has nothing to triangulate; expected --keypoints")
    request.refuse(_OF_BODIES, f"applies only to bodies, which --method {TRIANGULATE} does without")
    output, names = request.output, take_names(request.folders)
    assert output is not None
    if len(request.folders) == 1:
        _triangulate(request, output, line)
        return
    failed: dict[str, UserError] = {}
    with output_folder(output, request.COMMAND, request.folders) as outer:
        outer.begin()  # remove the results of an earlier single take
        for folder, name in zip(request.folders, names, strict=True):
            try:
                _triangulate(request.replace(folders=(folder,)), output / name, line)
            except UserError as error:
                failed[name] = error
    for name, why in failed.items():
        stdout.print(f"{name} failed: {why}")
    if failed:
        raise InputError(f"{len(failed)} of {len(names)} takes failed: {join_names(failed)}")


def _triangulate(request: TrackRequest, output: Path, line: StageProgress) -> None:
    """Triangulate one take, and write track.npz, joints.trc, joints.csv of each person, and the
    overlay; of several people also people.json."""
    sequence = open_sequence(request)
    chosen = select_common_frames(request.frames, sequence, warn)
    selection = slice(chosen.start, chosen.stop, chosen.step)
    people: list[Keypoints] = []
    if request.people != 1:
        number = people_number(request.people)
        people = open_people_keypoints(request.keypoints, sequence, number, warn)
    several = bool(people)
    if not several:
        keypoints, _ = read_keypoints(request.keypoints, sequence, line)
        assert keypoints is not None
        people = [keypoints]
    frames = np.arange(len(sequence))[selection]
    expected = (*RESULTS, PEOPLE) if several else RESULTS
    with output_folder(output, request.COMMAND, sequence.inputs, expected):
        tracks = [triangulate_track(sequence, p, request.triangulated, selection) for p in people]
        for number, track in enumerate(tracks, start=1):
            folder = person_folder(output, number) if several else output
            for name in RESULTS[:3]:
                track.save(folder / name)
        seen = tuple(find_seen_frames(keypoints, frames) for keypoints in people)
        together = PeopleTracks(tuple(tracks), frames, seen)
        if several:
            together.save_list(output)
        write_settings(output, request)
        if request.video:
            with progress_bar() as bar:
                task = bar.add_task("overlay", total=len(frames))
                shown = together if several else tracks[0]
                write_overlay(output / "overlay.mp4", sequence, shown, lambda: bar.advance(task))
    who = (
        "" if not several else f" of {len(tracks)} people" if len(tracks) > 1 else " of one person"
    )
    stdout.print(f"{len(frames)} frames{who} triangulated: {output}")
    for number, track in enumerate(tracks, start=1):
        whose = f"person{number}: " if several else ""
        stdout.print(f"{whose}{_describe(track)}")


def _describe(track: Track) -> str:
    """Return a line on the agreement of the cameras and on missing points."""
    errors = track.diagnostics["reprojection_error"]
    missing = float(np.isnan(track.joints).any(-1).mean())
    cameras = track.diagnostics["cameras_used"]
    return (
        f"{len(track.joint_names)} points of {cameras[cameras > 0].mean():.1f} cameras on average, "
        f"reprojection error {np.nanmean(errors):.1f} px, {100 * missing:.1f} % missing"
    )
