"""Cameras for live tracking, from their calibration and their captures' names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from apf.live_sources import Cameras
from psfs.background import Background, background_from_plates
from psfs.calibration import read_calibration
from psfs.camera import CameraRig
from psfs.layouts.common import assigned, chosen
from psfs.layouts.native import calibration_of
from psfs.media import media_in
from psfs.settings import Settings
from psfs.units import turned_rig, z_up_from


def cameras_of(folder: Path, said: dict[str, Any], names: list[str], empty: float) -> Cameras:
    """The captures `names` as the cameras, in this order, of the calibration in `folder`.

    `folder` may be the calibration file itself. said: keys of `sequence.toml`, which they win
    over. Where `folder/background` shows the empty scene it is the background. Raises UserError.
    """
    settings = Settings.of(said)
    if folder.is_file():
        calibration, plates = folder, None
    else:
        settings = settings.over(Settings.read(folder / "sequence.toml"))
        calibration, plates = calibration_of(folder, settings), folder / "background"
    rig = read_calibration(calibration, settings.unit)
    rig = chosen(turned_rig(rig, z_up_from(settings.up or "z")), settings)
    return Cameras(rig, names, _background(rig, plates, settings), empty)


def _background(rig: CameraRig, plates: Path | None, settings: Settings) -> Background | None:
    if plates is None or not plates.is_dir():
        return None
    media, _ = assigned(rig, media_in(plates), plates, settings, extras=True)
    return background_from_plates(rig, media)
