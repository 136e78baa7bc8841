"""One rig in the files of every program whose calibrations are read."""

import json
import math
import struct
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import numpy as np
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from helpers.footage import words
from psfs.cameras.camera import Camera, CameraRig

Files = dict[str, str | bytes]


def write_files(folder: Path, files: Files) -> list[Path]:
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return [folder / name for name in files]


def assert_same(found: CameraRig, expected: CameraRig, n_lens: int = 5) -> None:
    """Assert that cameras are the same, in all but names, with so many numbers of their lenses."""
    for a, b in zip(found, expected, strict=True):
        assert a.size == b.size
        for field in ("K", "R", "t"):
            np.testing.assert_allclose(getattr(a, field), getattr(b, field), atol=1e-8)
        np.testing.assert_allclose(a.distortion, b.distortion * (np.arange(5) < n_lens), atol=1e-9)


def middlebury(rig: CameraRig) -> str:
    lines = [f"{c.name}.png {words(c.K)} {words(c.R)} {words(c.t)}" for c in rig]
    return "\n".join([str(len(rig)), *lines])


def surrey(rig: CameraRig) -> str:
    text = f"{len(rig)} 1\n"
    for c in rig:
        lens = words([c.K[0, 0], c.K[1, 1], c.K[0, 2], c.K[1, 2], c.distortion[0]])
        text += f"0 {c.size[1] - 1} 0 {c.size[0] - 1}\n{lens}\n{words(c.R)}\n{words(c.t)}\n"
    return text


def humaneva(camera: Camera) -> str:
    """Positions in mm, skew relative to the focal length."""
    K = camera.K
    lens = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], K[0, 1] / K[0, 0], *camera.distortion]
    return words(np.array([*lens, *camera.R.ravel(), *(1000 * camera.t), 0.1, 0.2, 0.3]))


def projection(camera: Camera) -> np.ndarray:
    return camera.K @ np.column_stack([camera.R, camera.t])


def projections(rig: CameraRig) -> str:
    return "\n".join(f"{c.name} {words(projection(c))}" for c in rig)


def nerf(rig: CameraRig, angle: bool = True) -> str:
    """The lens by its angle of view, or in pixels, whose first one's corner is 0."""
    frames = []
    for camera in rig:
        pose = np.eye(4)
        pose[:3, :3] = camera.R.T @ np.diag([1.0, -1, -1])
        pose[:3, 3] = camera.centre
        frames.append({"file_path": f"./{camera.name}", "transform_matrix": pose.tolist()})
    K, (width, height) = rig[0].K, rig[0].size
    lens = {"camera_angle_x": 2 * math.atan(width / 2 / K[0, 0])}
    if not angle:
        lens = {"fl_x": K[0, 0], "cx": K[0, 2] + 0.5, "cy": K[1, 2] + 0.5, "w": width, "h": height}
    return json.dumps({**lens, "frames": frames})


def rows(matrix: np.ndarray) -> str:
    return "\n".join(words(row) for row in matrix)


def krt(rig: CameraRig) -> Files:
    parts = {c.name: [rows(c.K), rows(c.R), words(c.t), words(c.distortion)] for c in rig}
    return {f"calib/{name}.krtd": "\n\n".join(texts) + "\n" for name, texts in parts.items()}


def k_and_rt(rig: CameraRig) -> Files:
    files: Files = {
        f"calib/{c.name}.txt": f"# K\n{rows(c.K)}\n# [R | t]\n{rows(np.column_stack([c.R, c.t]))}\n"
        for c in rig
    }
    return files | {"calib/readme.txt": "K, then [R | t]"}


def matlab(name: str, **values: np.ndarray) -> Files:
    content = BytesIO()
    savemat(content, values)
    return {name: content.getvalue()}


def matlab_cells(rig: CameraRig) -> Files:
    cells = np.empty((1, len(rig)), object)
    for view, camera in enumerate(rig):
        cells[0, view] = -2 * projection(camera)
    return matlab("dino_Ps.mat", P=cells)


def matlab_stacks(rig: CameraRig) -> Files:
    stacks = {key: np.stack([getattr(c, key) for c in rig], -1) for key in ("K", "R")}
    t = np.stack([camera.t[:, None] for camera in rig], -1)
    return matlab("calib.mat", **stacks, t=t, names=np.array(rig.names, object))


def colmap(rig: CameraRig) -> Files:
    cameras, images = "# cameras\n", "# images\n"
    for index, c in enumerate(rig, 1):
        K, (width, height) = c.K, c.size
        lens = [K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5, *c.distortion[:4]]
        cameras += f"{index} OPENCV {width} {height} {words(lens)}\n"
        x, y, z, w = Rotation.from_matrix(c.R).as_quat()
        images += f"{index} {words([w, x, y, z, *c.t])} {index} {c.name}/0001.png\n"
        images += "1.0 2.0 -1\n" if index % 2 else "\n"
    return {"sparse/0/cameras.txt": cameras, "sparse/0/images.txt": images}


def colmap_binary(rig: CameraRig) -> Files:
    """COLMAP's default, with two points in every image."""
    cameras = images = struct.pack("<Q", len(rig))
    for index, c in enumerate(rig, 1):
        lens = [c.K[0, 0], c.K[1, 1], c.K[0, 2] + 0.5, c.K[1, 2] + 0.5, *c.distortion[:4]]
        cameras += struct.pack("<iiQQ8d", index, 4, *c.size, *lens)
        x, y, z, w = Rotation.from_matrix(c.R).as_quat()
        images += struct.pack("<i7di", index, w, x, y, z, *c.t, index) + f"{c.name}.png\0".encode()
        images += struct.pack("<Q", 2) + 2 * struct.pack("<ddq", 1, 2, -1)
    return {"cameras.bin": cameras, "images.bin": images}


def columns(rig: CameraRig) -> str:
    return "\n".join(f"{c.name} {words(projection(c).T)}" for c in rig)


def tags(parts: dict[str, dict[str, float]]) -> str:
    """Elements of XML with nothing but numbers."""
    return "".join(
        f"<{tag} {' '.join(f'{key}={str(float(v))!r}' for key, v in values.items())}/>"
        for tag, values in parts.items()
    )


def qualisys(rig: CameraRig) -> Files:
    """XML with camera axes x right, y up, z backward, positions in mm, 64 units to a pixel."""
    elements = []
    for c in rig:
        turn = np.diag([1.0, -1, -1]) @ c.R
        position = 1e3 * np.linalg.inv(turn) @ (np.diag([1.0, -1, -1]) @ -c.t)
        names = [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
        transform = dict(zip([*names, *"xyz"], [*turn.ravel(), *position], strict=True))
        intrinsic = {
            "focalLengthU": 64 * c.K[0, 0],
            "focalLengthV": 64 * c.K[1, 1],
            "centerPointU": 64 * (c.K[0, 2] + 8),
            "centerPointV": 64 * c.K[1, 2],
            **dict.fromkeys(("radialDistortion1", "radialDistortion2"), 0.0),
            **dict.fromkeys(("tangentalDistortion1", "tangentalDistortion2"), 0.0),
        }
        field = {"left": 8, "top": 0, "right": c.size[0] + 7, "bottom": c.size[1] - 1}
        parts = {"fov_video": field, "transform": transform, "intrinsic": intrinsic}
        elements.append(f'<camera serial="{c.name}" viewrotation="0">{tags(parts)}</camera>')
    text = "<?xml version='1.0'?>\n<calibration><cameras>" + "\n".join(elements)
    return {"calibration/Calib.qca.txt": text + "</cameras></calibration>"}


def panoptic(rig: CameraRig) -> Files:
    cameras = [
        {
            "name": c.name, "type": "hd", "resolution": list(c.size), "panel": 0, "node": 1,
            "K": c.K.tolist(), "distCoef": c.distortion.tolist(), "R": c.R.tolist(),
            "t": (100 * c.t[:, None]).tolist(),
        }
        for c in rig
    ]  # fmt: skip
    content = {"calibDataSource": "160224_calib_norm", "cameras": cameras}
    return {"calibration_160224.json": json.dumps(content)}


def vicon(rig: CameraRig) -> Files:
    """Vicon's XML as in its published files: key frames with quaternions x y z w and positions, mm,
    and a camera for markers beside them."""
    elements = [
        '<Camera DEVICEID="9" TYPE="MX" SENSOR_SIZE="2 2"><KeyFrames><KeyFrame/></KeyFrames>'
    ]
    for c in reversed(list(rig)):
        centre = -1000 * np.linalg.inv(c.R) @ c.t
        elements.append(
            f'<Camera DEVICEID="{c.name}" TYPE="VideoInputDevice:Blackfly" PIXEL_ASPECT_RATIO="1" '
            f'SENSOR_SIZE="{c.size[0]} {c.size[1]}"><KeyFrames><KeyFrame FRAME="0" '
            f'FOCAL_LENGTH="{c.K[0, 0]}" PRINCIPAL_POINT="{words(c.K[:2, 2])}" '
            f'ORIENTATION="{words(Rotation.from_matrix(c.R).as_quat())}" '
            f'POSITION="{words(centre)}" VICON_RADIAL2="ViconRadial2 0 0 0 0 0"/></KeyFrames>'
        )
    text = "".join(f"{element}</Camera>" for element in elements)
    return {"take.xcp": f'<?xml version="1.0"?><Cameras>{text}</Cameras>'}


def optitrack(rig: CameraRig) -> Files:
    """Motive's XML, in UTF-16: camera to world, camera axes x right, y up, z backward, metres; a
    camera for markers beside those for colour."""
    elements = ['<Camera Serial="M7"><Attributes ImagerPixelWidth="9" ImagerPixelHeight="9"/>']
    poses = [np.linalg.inv(np.diag([1.0, -1, -1]) @ c.R) for c in rig]
    for c, turn in zip(rig, poses, strict=True):
        number = dict(zip([f"OrientMatrix{k}" for k in range(9)], turn.ravel(), strict=True))
        place = dict(zip("XYZ", -np.linalg.inv(c.R) @ c.t, strict=True))
        lens = {
            "LensCenterX": c.K[0, 2], "LensCenterY": c.K[1, 2], "k1": 0, "k2": 0, "k3": 0,
            "HorizontalFocalLength": c.K[0, 0], "VerticalFocalLength": c.K[1, 1],
            "TangentialX": 0, "TangentialY": 0,
        }  # fmt: skip
        size = {"ImagerPixelWidth": c.size[0], "ImagerPixelHeight": c.size[1]}
        parts = {
            "Attributes": size, "Intrinsic": {"k1": 1}, "IntrinsicStandardCameraModel": lens,
            "Extrinsic": number | place,
        }  # fmt: skip
        elements.append(f'<Camera Serial="{c.name}">{tags(parts)}')
    elements[0] += elements[1].split(">", 2)[-1]  # a camera for markers, with a lens of its own
    text = "".join(f"{element}</Camera>" for element in elements)
    head = '<?xml version="1.0" encoding="UTF-16LE"?><calibrationProfile><Calibration><Cameras>'
    whole = f"{head}{text}</Cameras></Calibration></calibrationProfile>"
    return {"take.mcal": whole.encode("utf-16-le")}


#: With lenses without distortion, in the files by which a folder is found to hold them.
FORMATS: dict[str, Callable[[CameraRig], Files]] = {
    "optitrack": optitrack,
    "vicon": vicon,
    "panoptic": panoptic,
    "middlebury": lambda rig: {"calib.txt": middlebury(rig)},
    "surrey": lambda rig: {"calibration.txt": surrey(rig)},
    "qualisys": qualisys,
    "krt": krt,
    "krt_in_a_line": lambda rig: {
        f"calib/{c.name}.krt": f"{words(c.K)} {words(c.R)} {words(c.t)}" for c in rig
    },
    "k_and_rt": k_and_rt,
    "pa": lambda rig: {f"{camera.name}.pa": rows(3 * projection(camera)) for camera in rig},
    "matlab_cells": matlab_cells,
    "matlab_stacks": matlab_stacks,
    "colmap": colmap,
    "colmap_binary": colmap_binary,
    "nerf": lambda rig: {"transforms.json": nerf(rig)},
    "nerf_lens": lambda rig: {"transforms.json": nerf(rig, angle=False)},
    "projections": lambda rig: {"projections.txt": projections(rig)},
    "by_columns": lambda rig: {"projections.txt": "# layout: columns\n" + columns(rig)},
    "unsaid_columns": lambda rig: {"projections.txt": columns(rig)},
    "transposed": lambda rig: {"projections.txt": "\n".join(rows(projection(c).T) for c in rig)},
}
