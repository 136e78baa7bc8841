"""`apf export`: write motion files that other programs read."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from apf.body.limbs import limb_names
from apf.cli.opened_track import open_given_tracks
from apf.formats.opensim.setup import ANGLES, INVERSE_KINEMATICS, SCALING
from apf.request import ExportRequest
from apf.tracking.config import EXPORTS, MESH_FOLDER, MESHES, OPENSIM, USD
from apf.tracking.motion_files import Export, export
from apf.tracking.people import holds_people, person_folder
from apf.tracking.track import spans
from psfs.cli.commandline import stdout
from psfs.common.outputs import output_folder
from psfs.common.ranges import NAMED


def run(request: ExportRequest) -> None:
    if request.raw:
        request.refuse(["cutoff"], "applies only to the smoothing; expected none with --raw")
    if request.to is not None and "trc" not in request.to:
        request.refuse(["axes"], "applies only to the TRC; expected --to trc with it")
    if request.to is None or OPENSIM not in request.to:
        request.refuse(["osim_model"], f"applies only to OpenSim; expected --to {OPENSIM} with it")
    folder = request.output or (request.track if request.track.is_dir() else request.track.parent)
    with output_folder(folder, request.COMMAND, addition=True):
        tracks = open_given_tracks(request)
        several = holds_people(request.track)
        for number, (track, seen) in enumerate(zip(tracks, tracks.seen, strict=True), start=1):
            into = person_folder(folder, number) if several else folder
            if several:
                stdout.print(f"{into.name}:")
            written = export(
                track, into, request.to, axes=request.axes, smoothing=request.smoothing,
                raw=request.raw, osim_model=request.osim_model,
            )  # fmt: skip
            print_export(written, request.to or EXPORTS, seen)


def print_export(written: Export, wanted: Collection[str], seen: np.ndarray) -> None:
    """Print what the files contain, what is missing from them, and where they are; wanted: formats.
    seen: frames (F,) that show the person."""
    track = written.track
    there = track.present & np.isin(track.frames, seen)
    if track.smoothing is None:
        stdout.print(f"{len(track)} frames as they were tracked, not smoothed")
    else:
        shown = f"{len(track)} frames, smoothed at {track.smoothing['cutoff_hz']:g} Hz"
        held = " and feet held where they stand" if track.standing.any() else ""
        stdout.print(f"{shown}{held}; track.npz and joints.trc keep them as they were tracked")
    for what, rows in (("was lost", track.lost & there), ("was not there", track.lost & ~there)):
        if rows.any():
            frames = spans(track.frames[rows].tolist(), NAMED)
            stdout.print(
                f"the person {what} in frames {frames}: missing values there, in BVH and GLB the "
                "pose before, in MOT bridged"
            )
    if track.body is not None and track.lost_limbs.any():
        columns = zip(limb_names(track.body), track.lost_limbs.T, strict=True)
        limbs = [f"{n} in {spans(track.frames[c].tolist(), NAMED)}" for n, c in columns if c.any()]
        stdout.print(
            f"limbs were lost, by frames: {'; '.join(limbs)}: missing values there, in BVH, GLB "
            "and MOT bridged"
        )
    if written.gait is not None:
        gait = written.gait
        stdout.print(
            f"gait: {gait.n_steps} steps, {gait.cadence:.0f} steps/min, {gait.step_length:.2f} m "
            f"each, {gait.speed:.2f} m/s"
        )
    elif "gait" in wanted:
        stdout.print("gait: no walk of two steps in this track")
    if {"person", USD, *MESHES} & {*wanted} and track.surface is None and track.dof_names:
        stdout.print("the track holds no surface of the person; apf track measures it")
    names = {path.name for path in written.files}
    if INVERSE_KINEMATICS in names and ANGLES not in names:
        stdout.print(
            "OpenSim is not installed in this Python: its set-up alone was written; run "
            f"`opensim-cmd run-tool` with {SCALING}, then with {INVERSE_KINEMATICS}"
        )
    meshes = [path for path in written.files if path.parent.name == MESH_FOLDER]
    alone = [str(path) for path in written.files if path not in meshes]
    several = [f"{len(meshes)} meshes in {meshes[0].parent}"] if meshes else []
    stdout.print("wrote " + ", ".join(alone + several))
