"""Read and write the TOML of Pose2Sim, anipose, FreeMoCap and Caliscope, one table per camera.

Keys: name, size [w, h], matrix 3x3, distortions k1 k2 p1 p2 (k3), rotation (Rodrigues vector, world
to camera), translation, fisheye; and our own tsai_kappa, see `Camera.kappa`. Caliscope's
camera_array.toml has tables [cameras.0], rotations as matrices, `ignore`, and videos cam_0.mp4.
"""

from __future__ import annotations

from pathlib import Path

import cv2

from cl import InputError
from psfs.cameras.calibration.common import Calibration, Layout, Sizes, build, name_file_in_errors
from psfs.cameras.camera import CameraRig
from psfs.cameras.names import natural_key
from psfs.cameras.units import Unit
from psfs.common.files import read_toml, write_toml

_NOT_CAMERAS = {"metadata", "capture_volume", "charuco", "checkerboard"}
_LAYOUT = Layout(
    "Pose2Sim", "matrix", ("distortions",), "rotation", "translation", size=("size",),
    lens=("fisheye", (None, False), (True,)), kappa="tsai_kappa",
)  # fmt: skip


def read_toml_tables(path: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read the cameras in natural order of their names. Metres unless `unit` says otherwise.

    FreeMoCap files (recognised by world_position) may be in any unit without stating it, so they
    need `unit`. Raises InputError naming file, camera and key.
    """
    content = _name_caliscope_cameras(read_toml(path))
    tables = {
        name: table
        for name, table in content.items()
        if isinstance(table, dict) and name.lower() not in _NOT_CAMERAS
    }
    with name_file_in_errors(path):
        if not tables:
            raise InputError("no camera tables; expected [name] with matrix, rotation, ...")
        if unit is None and any("world_position" in table for table in tables.values()):
            raise InputError("a FreeMoCap file does not say its unit; state it (usually unit mm)")
        records = [(str(table.get("name") or key), table) for key, table in tables.items()]
        records.sort(key=lambda entry: natural_key(entry[0]))
        return build(_LAYOUT, records, unit, sizes)


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
