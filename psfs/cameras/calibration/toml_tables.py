"""Pose2Sim, anipose and FreeMoCap: TOML with one table per camera.

Keys: name, size [w, h], matrix 3x3, distortions k1 k2 p1 p2 (k3), rotation = Rodrigues vector
world -> camera, translation, fisheye.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cl import InputError
from psfs.cameras.calibration.common import (
    Sizes,
    array,
    in_metres,
    naming,
    rotation_matrix,
    sizes_for,
)
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import natural_key
from psfs.cameras.units import Unit
from psfs.common.toml import read_toml

_NOT_CAMERAS = {"metadata", "capture_volume", "charuco", "checkerboard"}
_NEEDED = ("matrix", "distortions", "rotation", "translation")


def read_toml_tables(path: Path, unit: Unit | None = None, sizes: Sizes = None) -> CameraRig:
    """Read the cameras in natural order of their names. Metres unless `unit` says otherwise.

    FreeMoCap files (they have world_position) come in any unit and say none, so they need
    `unit`. Raises InputError naming file, camera and key.
    """
    tables = {
        name: table
        for name, table in read_toml(path).items()
        if isinstance(table, dict) and name.lower() not in _NOT_CAMERAS
    }
    with naming(path):
        if not tables:
            raise InputError("no camera tables; expected [name] with matrix, rotation, ...")
        if unit is None and any("world_position" in table for table in tables.values()):
            raise InputError("a FreeMoCap file does not say its unit; state it (usually unit mm)")
        by_name = {str(table.get("name", key)): table for key, table in tables.items()}
        if len(by_name) < len(tables):
            raise InputError(f"camera names must differ; found {len(by_name)} in {len(tables)}")
        names = sorted(by_name, key=natural_key)
        if any("size" not in table for table in tables.values()):
            for name, size in zip(names, sizes_for(names, sizes), strict=True):
                by_name[name].setdefault("size", size)
        cameras = [_camera(name, by_name[name]) for name in names]
        return in_metres(CameraRig(tuple(cameras)), unit, default="m")


def _camera(name: str, table: dict[str, Any]) -> Camera:
    if table.get("fisheye", False):
        raise InputError(f"camera {name}: fisheye = true; expected a pinhole camera")
    missing = [key for key in _NEEDED if key not in table]
    if missing:
        raise InputError(f"camera {name}: no {', '.join(missing)}")
    width, height = array(table["size"], 2, f"camera {name}: size")
    return Camera(
        name=name,
        K=array(table["matrix"], 9, f"camera {name}: matrix"),
        distortion=array(table["distortions"], None, f"camera {name}: distortions"),
        R=rotation_matrix(table["rotation"], f"camera {name}: rotation"),
        t=array(table["translation"], 3, f"camera {name}: translation"),
        size=(int(width), int(height)),
    )
