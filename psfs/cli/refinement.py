"""`psfs calibrate FOLDER --refine -o OUT`: corrections of a take's cameras and times from the
take."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.table import Table

from cl import InputError, select_device
from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.cameras.camera import CameraRig
from psfs.cli.commandline import make_table, stdout
from psfs.common.files import write_json
from psfs.common.requests import write_settings
from psfs.common.system import versions
from psfs.diagnostics.alignment import Alignment, align_rig
from psfs.diagnostics.examination import synchronise
from psfs.diagnostics.occluders import find_hidden_pixels
from psfs.opening import stated_keys
from psfs.request import CALIBRATION, REPORT, CalibrateRequest
from psfs.sequence import Sequence
from psfs.session import Session


def refine(request: CalibrateRequest) -> None:
    """Correct the cameras of a take, or keep them if held-out frames fit no better."""
    sequence = Sequence.open(request.folder or Path(), **stated_keys(request.capture))
    session = Session(sequence, select_device(request.device))
    session = synchronise(session)
    if len(session.rig) < 3:
        raise InputError(
            f"{request.folder}: {len(session.rig)} cameras; expected three or more, because two "
            "silhouettes do not show which camera is wrong"
        )
    hidden = find_hidden_pixels(session)
    rig = session.rig if hidden is None else session.rig.with_hidden(hidden)
    alignment = align_rig(session, rig)
    if alignment is None:
        raise InputError(
            f"{request.folder}: too few tips of limbs are seen by two cameras at once; expected "
            "somebody who moves arms and legs, in pictures that show the whole person"
        )
    accepted = alignment.is_accepted()
    rig = CameraRig(tuple(alignment.rig if accepted else session.rig))
    out = request.output or Path()
    verdict = str(alignment) if accepted else (
        f"the given cameras are kept: with corrected ones the silhouettes of held-out frames "
        f"differ by {alignment.after:.2f} px instead of {alignment.before:.2f}, in pictures of "
        f"{alignment.side} px"
    )  # fmt: skip
    write_toml_tables(out / CALIBRATION, rig)
    write_json(out / REPORT, _summary(request, rig, alignment, accepted, verdict))
    write_settings(out, request)
    stdout.print(_table(rig, alignment, accepted))
    stdout.print(f"{verdict}; wrote {out}")


def _figures(alignment: Alignment, view: int) -> dict[str, list[float]]:
    """Return each correction of a camera with its standard deviation."""
    values, sigmas = alignment.corrections.values[view], alignment.corrections.sigmas[view]
    return {
        "turned_degrees": [
            float(np.degrees(np.linalg.norm(values[:3]))),
            float(np.degrees(np.sqrt(np.mean(sigmas[:3] ** 2)))),
        ],
        "shifted_mm": [
            1000 * float(np.linalg.norm(values[3:6])),
            1000 * float(np.sqrt(np.mean(sigmas[3:6] ** 2))),
        ],
        "focal_percent": [100 * float(values[6]), 100 * float(sigmas[6])],
        "late_frames": [float(values[7]), float(sigmas[7])],
    }


def _summary(
    request: CalibrateRequest, rig: CameraRig, alignment: Alignment, accepted: bool, verdict: str
) -> dict[str, object]:
    figures = [_figures(alignment, view) for view in range(len(rig))]
    return {
        "verdict": verdict,
        "folder": str(request.folder),
        "corrected": accepted,
        "held_out_px": {
            "given": round(alignment.before, 4),
            "corrected": round(alignment.after, 4),
        },
        "pictures_px": alignment.side,
        "frontier_points": alignment.corrections.count,
        "cameras": {
            camera.name: {
                key: {"value": round(value, 4), "standard_deviation": round(sigma, 4)}
                for key, (value, sigma) in own.items()
            }
            | {"moved_px": round(float(moved), 3)}
            for camera, own, moved in zip(rig, figures, alignment.moved, strict=True)
        },
        "versions": versions(),
    }


def _table(rig: CameraRig, alignment: Alignment, accepted: bool) -> Table:
    title = "Corrections" if accepted else "Corrections, not applied"
    columns = ("turned, degrees", "shifted, mm", "focal length, %", "late, frames", "px")
    table = make_table(title, ["camera"], columns)
    formats = ("{:.2f} ± {:.2f}", "{:.0f} ± {:.0f}", "{:+.2f} ± {:.2f}", "{:+.2f} ± {:.2f}")
    for view, camera in enumerate(rig):
        figures = _figures(alignment, view).values()
        texts = [form.format(*pair) for form, pair in zip(formats, figures, strict=True)]
        table.add_row(camera.name, *texts, f"{alignment.moved[view]:.1f}")
    return table
