"""Cameras for live tracking, from a calibration and the names of their captures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.live.config import CaptureConfig
from apf.live.sources import LiveCameras
from psfs.background.gaussian import Background, estimate_background
from psfs.cameras.calibration import read_calibration
from psfs.cameras.camera import CameraRig
from psfs.cameras.units import rotate_rig, rotation_to_z_up
from psfs.footage.layouts.common import assign_pictures, choose_cameras
from psfs.footage.layouts.native import find_settings_calibration
from psfs.footage.media import list_media
from psfs.footage.settings import SequenceSettings


def open_cameras(
    folder: Path, stated: dict[str, object], names: list[str], empty: float
) -> LiveCameras:
    """Open the captures `names` as the cameras, in this order, of the calibration in `folder`.

    `folder` may be the calibration file itself. stated: keys of `sequence.toml` that override those
    of the file. The background images are those in `folder/background`, if it exists. Raises
    InputError.
    """
    settings = SequenceSettings.from_dict(stated)
    if folder.is_file():
        calibration, backgrounds = folder, None
    else:
        settings = settings.fill_from(SequenceSettings.read(folder / "sequence.toml"))
        calibration, backgrounds = (
            find_settings_calibration(folder, settings),
            folder / "background",
        )
    rig = read_calibration(calibration, settings.unit)
    turned = rotate_rig(rig, rotation_to_z_up(settings.up or "z"))
    return LiveCameras(
        choose_cameras(turned, settings), names, _background(turned, backgrounds, settings), empty
    )


def box_around(
    body: BodyModel, pose: np.ndarray, config: CaptureConfig | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest corner (3,) m of a box that holds the person in `pose`
    (D,)."""
    config = config or CaptureConfig()
    joints, side = posed_joints(body, pose[None])[0], config.box_side
    low = np.append(joints[:, :2].mean(0) - side, joints[:, 2].min() - config.box_below)
    return low, low + np.array([2 * side, 2 * side, config.box_height])


def _background(
    rig: CameraRig, backgrounds: Path | None, settings: SequenceSettings
) -> Background | None:
    if backgrounds is None or not backgrounds.is_dir():
        return None
    media, _ = assign_pictures(rig, list_media(backgrounds), backgrounds, settings, extras=True)
    return estimate_background(choose_cameras(rig, settings), media)
