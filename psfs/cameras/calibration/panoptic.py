"""Read the JSON of CMU's Panoptic Studio: `calibration_*.json`, a list `cameras`.

Each has name, type, resolution [w, h], K 3x3, distCoef k1 k2 p1 p2 k3, R 3x3 and t 3, world to
camera, in centimetres, Y down.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from cl import InputError
from psfs.cameras.calibration.common import (
    Calibration,
    Size,
    build_rig,
    check_whole_size,
    name_file_in_errors,
    parse_rotation,
    read_text,
)
from psfs.cameras.camera import MOST_CAMERAS, Camera
from psfs.cameras.names import natural_key
from psfs.cameras.units import Unit
from psfs.common.files import read_json
from psfs.common.schema import Name, Number, Table, flat, parse_values


class PanopticCamera(Table):
    """The keys of one camera."""

    name: Name
    resolution: Annotated[list[Number], Field(min_length=2, max_length=2)]
    K: Annotated[list[float], flat(9)]
    distCoef: Annotated[list[Number], Field(max_length=14)]
    R: Annotated[list[float], flat(9)]
    t: Annotated[list[float], flat(3)]


class PanopticFile(Table):
    """The whole file."""

    cameras: Annotated[list[PanopticCamera], Field(min_length=1, max_length=MOST_CAMERAS)]


def looks_like_panoptic(path: Path) -> bool:
    """Return whether a JSON file lists cameras with a distCoef, as Panoptic's do."""
    text = read_text(path)
    return '"distCoef"' in text and '"cameras"' in text


def read_panoptic(path: Path, unit: Unit | None) -> Calibration:
    """Read the cameras in natural order of their names. Centimetres unless `unit` says otherwise.

    Raises InputError naming file, camera and key.
    """
    with name_file_in_errors(path):
        file = parse_values(PanopticFile, read_json(path, "a calibration"), "the file")
        by_name = {own.name: own for own in file.cameras}
        if len(by_name) < len(file.cameras):
            raise InputError("camera names must differ; found the same name twice")
        measured = {name: _size(own) for name, own in by_name.items()}
        names = sorted(by_name, key=natural_key)
        return build_rig(names, measured, lambda name, _: _camera(by_name[name]), unit, "cm")


def _size(own: PanopticCamera) -> Size:
    width, height = own.resolution
    return check_whole_size(width, height, f"camera {own.name}: resolution")


def _camera(own: PanopticCamera) -> Camera:
    return Camera(
        name=own.name,
        K=np.array(own.K).reshape(3, 3),
        distortion=np.array(own.distCoef),
        R=parse_rotation(own.R, f"camera {own.name}: R"),
        t=np.array(own.t),
        size=_size(own),
    )
