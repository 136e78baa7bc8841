"""Read and write the TOML of Pose2Sim, anipose, FreeMoCap and Caliscope, one table per camera.

Keys: name, size [w, h], matrix 3x3, distortions k1 k2 p1 p2 (k3), rotation (Rodrigues vector, world
to camera), translation, fisheye; and our own tsai_kappa, see `Camera.kappa`. Caliscope's
camera_array.toml has tables [cameras.0], rotations as matrices, `ignore`, and videos cam_0.mp4.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from cl import InputError
from psfs.cameras.calibration.common import (
    Calibration,
    Size,
    Sizes,
    check_whole_size,
    convert_to_metres,
    find_sizes,
    name_file_in_errors,
    parse_rotation,
)
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import natural_key
from psfs.cameras.units import Unit
from psfs.common.schema import Name, Number, Table, Vector, flat, parse_values
from psfs.common.toml import read_toml, write_toml

_NOT_CAMERAS = {"metadata", "capture_volume", "charuco", "checkerboard"}


class CameraTable(Table):
    """The keys of one camera."""

    matrix: Annotated[list[float], flat(9)]
    distortions: Annotated[list[Number], Field(max_length=14)]
    rotation: Annotated[list[float], flat(3, 9)]
    translation: Vector
    size: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = None
    name: Name | None = None
    fisheye: bool = False
    tsai_kappa: float = 0.0


def read_toml_tables(path: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read the cameras in natural order of their names. Metres unless `unit` says otherwise.

    FreeMoCap files (recognised by world_position) may be in any unit without stating it, so they
    need `unit`. Raises InputError naming file, camera and key.
    """
    content = _name_caliscope_cameras(read_toml(path))
    found = {
        name: table
        for name, table in content.items()
        if isinstance(table, dict) and name.lower() not in _NOT_CAMERAS
    }
    with name_file_in_errors(path):
        if not found:
            raise InputError("no camera tables; expected [name] with matrix, rotation, ...")
        if unit is None and any("world_position" in table for table in found.values()):
            raise InputError("a FreeMoCap file does not say its unit; state it (usually unit mm)")
        tables = {key: parse_values(CameraTable, found[key], f"camera {key}") for key in found}
        by_name = {table.name or key: table for key, table in tables.items()}
        if len(by_name) < len(tables):
            raise InputError(f"camera names must differ; found {len(by_name)} in {len(tables)}")
        names = sorted(by_name, key=natural_key)
        measured: dict[str, Size] = {}
        if any(table.size is None for table in tables.values()):
            measured = dict(zip(names, find_sizes(names, sizes), strict=True))
        cameras = [_camera(name, by_name[name], measured.get(name)) for name in names]
        return convert_to_metres(CameraRig(tuple(cameras)), unit, default="m")


def _name_caliscope_cameras(content: dict[str, object]) -> dict[str, object]:
    """Return the tables under `cameras` of Caliscope's file, named as its videos; those of other
    programs unchanged. Cameras that it ignores, or could not place, are left out."""
    cameras = content.get("cameras")
    if not isinstance(cameras, dict) or not all(isinstance(of, dict) for of in cameras.values()):
        return content
    return {
        f"cam_{number}": table
        for number, table in cameras.items()
        if not table.get("ignore") and {"rotation", "translation"} <= table.keys()
    }


def write_toml_tables(path: Path, rig: CameraRig) -> None:
    """Write a rig in Pose2Sim's convention: metres, Rodrigues vectors world -> camera."""
    tables: dict[str, object] = {}
    for camera in rig:
        used = 5 if camera.distortion[4] else 4
        tables[camera.name] = {
            "name": camera.name,
            "size": [float(n) for n in camera.size],
            "matrix": camera.K.tolist(),
            "distortions": camera.distortion[:used].tolist(),
            "rotation": cv2.Rodrigues(camera.R)[0].ravel().tolist(),
            "translation": camera.t.tolist(),
            "fisheye": camera.fisheye,
            **({"tsai_kappa": camera.kappa} if camera.kappa else {}),
        }
    tables["metadata"] = {"adjusted": False, "error": 0.0}
    write_toml(path, tables)


def _camera(name: str, table: CameraTable, measured: Size | None) -> Camera:
    size = measured
    if table.size is not None:
        width, height = table.size
        size = check_whole_size(width, height, f"camera {name}: size")
    assert size is not None  # `measured` has it if any table lacks it
    return Camera(
        name=name,
        K=np.array(table.matrix).reshape(3, 3),
        distortion=np.array(table.distortions),
        R=parse_rotation(table.rotation, f"camera {name}: rotation"),
        t=np.array(table.translation),
        size=size,
        kappa=table.tsai_kappa,
        fisheye=table.fisheye,
    )
