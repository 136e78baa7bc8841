"""`apf export`: write motion files that other programs read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from apf.body.limbs import limb_names
from apf.cli.opened_track import open_given_track, stated_cutoff
from apf.formats.opensim.setup import ANGLES, INVERSE_KINEMATICS, SCALING
from apf.request import ExportRequest
from apf.tracking.config import OPENSIM, SmoothingConfig
from apf.tracking.motion_files import Export, export
from apf.tracking.people import PeopleTracks, holds_people, person_folder
from apf.tracking.track import spans
from psfs.cli.commandline import stdout, warn
from psfs.common.outputs import output_folder


def run(request: ExportRequest) -> None:
    if request.raw:
        request.refuse(["cutoff"], "applies only to the smoothing; expected none with --raw")
    if request.to is not None and "trc" not in request.to:
        request.refuse(["axes"], "applies only to the TRC; expected --to trc with it")
    if request.to is None or OPENSIM not in request.to:
        request.refuse(["osim_model"], f"applies only to OpenSim; expected --to {OPENSIM} with it")
    config = request.smoothing
    folder = request.output or (request.track if request.track.is_dir() else request.track.parent)
    with output_folder(folder, request.COMMAND, addition=True):
        if not holds_people(request.track):
            _export(request, folder, config)
            return
        request.refuse(["body"], "applies only to one person; expected none with several")
        for number, seen in enumerate(PeopleTracks.open(request.track).seen, start=1):
            own, into = (person_folder(of, number) for of in (request.track, folder))
            into.mkdir(parents=True, exist_ok=True)
            stdout.print(f"{into.name}:")
            _export(request.replace(track=own), into, config, seen)


def _export(
    request: ExportRequest, folder: Path, config: SmoothingConfig, seen: np.ndarray | None = None
) -> None:
    """Write one person's files into `folder`, and print what they contain. seen: frames (F,) that
    show the person, None for all."""
    track = open_given_track(request.track, request.body, stated_cutoff(request))
    written = export(
        track, folder, request.to, axes=request.axes, smoothing=config, raw=request.raw,
        osim_model=request.osim_model,
    )  # fmt: skip
    print_export(written, request.to is None or "gait" in request.to, seen)


def print_export(written: Export, gait_wanted: bool, seen: np.ndarray | None = None) -> None:
    """Print what the files contain, what is missing from them, and where they are; seen: see
    `_export`."""
    track = written.track
    there = track.present if seen is None else track.present & np.isin(track.frames, seen)
    if track.smoothing is None:
        stdout.print(f"{len(track)} frames as they were tracked, not smoothed")
    else:
        shown = f"{len(track)} frames, smoothed at {track.smoothing['cutoff_hz']:g} Hz"
        held = " and feet held where they stand" if track.standing.any() else ""
        stdout.print(f"{shown}{held}; track.npz and joints.trc keep them as they were tracked")
    for what, rows in (("was lost", track.lost & there), ("was not there", track.lost & ~there)):
        if rows.any():
            stdout.print(
                f"the person {what} in frames {spans(track.frames[rows].tolist())}: missing values "
                "there, in BVH and GLB the pose before, in MOT bridged"
            )
    if track.body is not None and track.lost_limbs.any():
        columns = zip(limb_names(track.body), track.lost_limbs.T, strict=True)
        limbs = [f"{n} in {spans(track.frames[c].tolist())}" for n, c in columns if c.any()]
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
    elif gait_wanted:
        stdout.print("gait: no walk of two steps in this track")
    if written.left_out is not None:
        warn(f"{written.left_out}; the other files are written", stdout)
    names = {path.name for path in written.files}
    if INVERSE_KINEMATICS in names and ANGLES not in names:
        stdout.print(
            "OpenSim is not installed in this Python: its set-up alone was written; run "
            f"`opensim-cmd run-tool` with {SCALING}, then with {INVERSE_KINEMATICS}"
        )
    stdout.print("wrote " + ", ".join(str(path) for path in written.files))
