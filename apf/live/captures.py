"""Cameras for live tracking, from their calibration and their captures' names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from apf.live.sources import Cameras
from psfs.background.gaussian import Background, background_from_plates
from psfs.cameras.calibration import read_calibration
from psfs.cameras.camera import CameraRig
from psfs.cameras.units import turned_rig, z_up_from
from psfs.footage.layouts.common import assigned, chosen
from psfs.footage.layouts.native import calibration_of
from psfs.footage.media import media_in
from psfs.footage.settings import Settings


def cameras_of(folder: Path, said: dict[str, Any], names: list[str], empty: float) -> Cameras:
    """The captures `names` as the cameras, in this order, of the calibration in `folder`.

    `folder` may be the calibration file itself. said: keys of `sequence.toml`, which they win
    over. Where `folder/background` shows the empty scene it is the background. Raises InputError.
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
