"""`psfs info FOLDER`: facts of a sequence, and warnings of likely errors."""

from __future__ import annotations

import numpy as np
from rich.table import Table

from cl import select_device
from psfs.cli.commandline import make_table, progress_bar, remark, stdout, warn
from psfs.common.files import check_picture_name, write_picture
from psfs.diagnostics.examination import diagnose, examine
from psfs.diagnostics.sequence_info import UNIT_ASKED, SequenceInfo
from psfs.diagnostics.small_views import draw_contact_sheet
from psfs.opening import open_sequence
from psfs.people.people import count_people
from psfs.request import InfoRequest
from psfs.sequence import Sequence
from psfs.session import Session


def run(request: InfoRequest) -> None:
    if not request.pictures:
        request.refuse(["masks"], "shows pictures; expected none with --no-pictures")
    sequence = open_sequence(request)
    if request.masks is not None:
        check_picture_name(request.masks, sequence.inputs[1:])
    info = SequenceInfo(sequence)
    stdout.print(_cameras(sequence, info))
    stdout.print(_facts(sequence, info))
    for note in sequence.notes:
        remark("note", "cyan", note)
    if info.keypoints is not None:
        unasked = "not used unless asked for, with apf track --keypoints"
        remark("note", "cyan", f"keypoints of a pose network: {info.keypoints}; {unasked}")
    if request.pictures:
        session = Session(sequence, select_device(request.device))
        _say_faults(session, info.warnings)
        if request.masks is not None:
            write_picture(request.masks, draw_contact_sheet(diagnose(session).views))
            stdout.print(f"wrote {request.masks}")
    else:
        for warning in info.warnings:
            warn(warning, stdout)


def _say_faults(session: Session, warnings: list[str]) -> None:
    """Print `warnings` and the faults found in the pictures, one line each."""
    with progress_bar() as bar:
        bar.add_task("examining", total=None)
        found = examine(session)
    if session.sequence.settings.sync == "auto":
        for note in found.session.sequence.timing_notes:
            remark("note", "cyan", note)
    if any(fault.kind in ("unit", "calibration") for fault in found.faults):  # which know better
        warnings = [text for text in warnings if UNIT_ASKED not in text]
    for fault in found.faults:
        if not fault.serious:
            remark("note", "cyan", str(fault))
    left_out = found.left_out
    for text in (*warnings, *map(str, left_out), *found.warnings[len(left_out) :]):
        warn(text, stdout)
    blind = len(diagnose(session).blind_cameras)
    if session.sequence.subject == "person" and len(session.rig) - blind > 1:
        remark("note", "cyan", count_people(found.session).describe())


def _cameras(sequence: Sequence, info: SequenceInfo) -> Table:
    columns = ("size px", "focal px", "distance m", "height m", "frames")
    table = make_table("cameras", ["camera"], columns)
    media = sequence.footage.images or sequence.footage.masks or ()
    for camera, distance, item in zip(sequence.rig, info.distances, media, strict=True):
        table.add_row(
            camera.name,
            f"{camera.size[0]} x {camera.size[1]}",
            f"{(camera.K[0, 0] + camera.K[1, 1]) / 2:.0f}",
            f"{distance:.2f}",
            f"{camera.centre[2]:.2f}",
            str(item.count),
        )
    return table


def _facts(sequence: Sequence, info: SequenceInfo) -> Table:
    shared = "nothing"
    if info.shared:
        low, high = info.shared
        shared = f"{_point(low)} to {_point(high)} m"
    facts = {
        "folder": f"{sequence.folder} ({sequence.layout})",
        "frames": f"{len(sequence)} at {sequence.fps:g} per second",
        "background": sequence.background_kind,
        "unit, up axis": f"{sequence.unit}, {sequence.settings.up or 'z'} (of the calibration; "
        "here metres, Z up)",
        "axes meet at": f"{_point(info.centre)} m",
        "rig": f"{info.extent:.2f} m across",
        f"{info.needed} cameras see": shared,
    }
    if sequence.volume is not None:
        facts["volume"] = f"{_point(sequence.volume[0])} to {_point(sequence.volume[1])} m"
    table = Table.grid("fact", "value", padding=(0, 2))
    for fact, value in facts.items():
        table.add_row(fact, value)
    return table


def _point(point: np.ndarray) -> str:
    return "(" + ", ".join(f"{round(float(value), 2) + 0.0:.2f}" for value in point) + ")"
