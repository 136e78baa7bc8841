"""`apf calibrate FOLDER --keypoints PATH -o OUT`: cameras and times from a person's keypoints, then
from the silhouettes."""

from __future__ import annotations

import numpy as np

from apf.keypoints.calibration import calibrate_by_keypoints
from apf.keypoints.keypoints import Keypoints
from apf.request import CalibrateRequest
from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.rig_geometry import transfer_poses
from psfs.cli.commandline import remark
from psfs.cli.person import (
    open_person_footage,
    outline_footage,
    write_person_calibration,
)
from psfs.common.outputs import output_folder
from psfs.common.requests import SETTINGS
from psfs.request import CALIBRATION, REPORT
from psfs.self_calibration.calibrator import PersonCalibration, adjust_calibration
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.points.calibrator import PointCalibration
from psfs.self_calibration.world import measure_path
from psfs.sequence import Sequence


def run(request: CalibrateRequest) -> None:
    if request.keypoints is None:
        raise InputError(
            "no --keypoints PATH; expected those of a pose network, as apf keypoints finds them; "
            "without any: psfs calibrate FOLDER --person"
        )
    inputs = [p for p in (request.folder, request.intrinsics) if p is not None]
    with output_folder(request.output, request.COMMAND, inputs, (CALIBRATION, REPORT, SETTINGS)):
        _calibrate(request)


def _calibrate(request: CalibrateRequest) -> None:
    views, large, config = open_person_footage(request)
    keypoints = Keypoints.open(request.keypoints or "", views)
    for note in keypoints.notes:
        remark("note", "cyan", note)
    found = calibrate_by_keypoints(large, keypoints, views.fps, config)
    middle = np.nanmedian(found.points, axis=1)[:, :2]
    path = measure_path(middle[np.isfinite(middle).all(axis=1)])
    count, residual = np.isfinite(found.points).all(axis=-1).sum(), np.median(found.errors)
    rig, calibration = found.rig, PersonCalibration(
        found.rig, found.lags, float(residual), int(count), found.errors, path, levelled=False
    )  # fmt: skip
    verdict = f"keypoints are {found.errors.max():.2f} px off at most (median of a camera)"
    if request.silhouettes:
        try:
            rig, calibration = _adjust(request, views, large, found, config)
            verdict += f"; silhouettes differ by at most {calibration.misfits.max():.2f} px"
        except InputError as error:
            raise InputError(
                f"the silhouettes do not confirm what the keypoints say: {error}; or "
                "--no-silhouettes, which keeps it unconfirmed"
            ) from None
    write_person_calibration(request, views, rig, calibration, config, verdict)


def _adjust(
    request: CalibrateRequest, views: Sequence, large: list[Camera], found: PointCalibration,
    config: PersonConfig,
) -> tuple[CameraRig, PersonCalibration]:  # fmt: skip
    """Return the cameras, adjusted to the silhouettes. Raises InputError if these do not fit."""
    small, outlines, edges = outline_footage(request, views, large, config)
    start = transfer_poses(small, large, found.rig)
    calibration = adjust_calibration(start, found.lags, outlines, edges, views.fps, config)
    return transfer_poses(large, small, calibration.rig), calibration
