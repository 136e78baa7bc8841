"""The folder of Utrecht's INFOMCV course: camN/config.xml, camN/video.avi, camN/background.avi."""

from __future__ import annotations

from pathlib import Path

from psfs.cameras.calibration import read_calibration
from psfs.cameras.calibration.filestorage import read_filestorage
from psfs.cameras.names import natural_key
from psfs.footage.layouts.common import (
    Footage,
    Found,
    Layout,
    assign_pictures,
    choose_cameras,
    make_size_lookup,
)
from psfs.footage.settings import SequenceSettings

_UNIT = "0.76mm"


def _matches(folder: Path, settings: SequenceSettings) -> bool:
    return any(folder.glob("cam*/config.xml"))


def _list_videos(folder: Path, stem: str) -> Found:
    paths = sorted(folder.glob(f"cam*/{stem}.avi"), key=lambda path: natural_key(str(path)))
    return {path.parent.name: [path] for path in paths}


def _read(folder: Path, settings: SequenceSettings) -> Footage:
    videos, empty = _list_videos(folder, "video"), _list_videos(folder, "background")
    where = folder / "cam*" / "video.avi"
    sizes = make_size_lookup(videos, where, settings)
    if settings.calibration is None:
        files = sorted(folder.glob("cam*/config.xml"), key=lambda path: natural_key(str(path)))
        names = [path.parent.name for path in files]
        rig = read_filestorage(files, settings.unit, sizes, names)
    else:
        rig = read_calibration(folder / settings.calibration, settings.unit, sizes)
    images, notes = assign_pictures(rig, videos, where, settings)
    if settings.unit == _UNIT:
        notes = [
            *notes,
            f"the unit {_UNIT} comes from a board of 115 mm that measures 151: uncertain",
        ]
    background = None
    if empty:
        background, remarks = assign_pictures(
            rig, empty, folder / "cam*" / "background.avi", settings, extras=True
        )
        notes = notes + remarks
    return Footage(
        choose_cameras(rig, settings), rig.unit, images=images, background=background, notes=notes
    )


#: Z points into the floor. The unit is uncertain: checkerboard.xml says squares of 115 mm, but the
#: boards in the pictures fit about 151 units, so that one unit is 115 mm / 151 = 0.76 mm.
UTRECHT = Layout("utrecht", _matches, _read, SequenceSettings(unit=_UNIT, up="-z"))
