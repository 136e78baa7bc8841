"""One rig written in every format: `psfs info` reports the same for all."""

import json
import struct
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from helpers import camera_texts, footage
from helpers.camera_texts import projection
from helpers.commands import succeed
from helpers.footage import words
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from cl import InputError
from psfs.cameras.calibration import find_calibration, read_calibration
from psfs.cameras.calibration.writers import WRITERS, write_calibration
from psfs.cameras.camera import Camera, CameraRig
from psfs.diagnostics.sequence_info import SequenceInfo
from psfs.request import FORMATS as FORMATS_OF_CONVERT
from psfs.sequence import Sequence

MIRROR = np.diag([-1.0, 1, 1])
Files = dict[str, str | bytes]


def plain_rig() -> CameraRig:
    """Return pinhole cameras with square pixels and centred principal points, which every format
    can express."""
    width, height = footage.SIZE
    K = np.array([[60.0, 0, (width - 1) / 2], [0, 60.0, (height - 1) / 2], [0, 0, 1]])
    cameras = (replace(camera, K=K, distortion=np.zeros(5)) for camera in footage.rig(4))
    return CameraRig(tuple(cameras))


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


FORMATS: dict[str, Callable[[CameraRig], Files]] = {
    "optitrack": optitrack,
    "vicon": vicon,
    "panoptic": panoptic,
    "middlebury": lambda rig: {"calib.txt": camera_texts.middlebury(rig)},
    "surrey": lambda rig: {"calibration.txt": camera_texts.surrey(rig)},
    "qualisys": qualisys,
    "krt": krt,
    "k_and_rt": k_and_rt,
    "pa": lambda rig: {f"{camera.name}.pa": rows(3 * projection(camera)) for camera in rig},
    "matlab_cells": matlab_cells,
    "matlab_stacks": matlab_stacks,
    "colmap": colmap,
    "colmap_binary": colmap_binary,
    "nerf": lambda rig: {"transforms.json": camera_texts.nerf(rig)},
    "nerf_lens": lambda rig: {"transforms.json": camera_texts.nerf(rig, angle=False)},
    "projections": lambda rig: {"projections.txt": camera_texts.projections(rig)},
    "by_columns": lambda rig: {"projections.txt": "# layout: columns\n" + columns(rig)},
    "unsaid_columns": lambda rig: {"projections.txt": columns(rig)},
    "transposed": lambda rig: {"projections.txt": "\n".join(rows(projection(c).T) for c in rig)},
}


def poses(rig: CameraRig) -> list[np.ndarray]:
    return [np.vstack([np.column_stack([c.R, c.t]), [0, 0, 0, 1]]) for c in rig]


def opencv_files(folder: Path, values: dict[str, dict[str, Any]]) -> None:
    for name, content in values.items():
        storage = cv2.FileStorage("x.yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
        for key, value in content.items():
            if isinstance(value, dict):
                storage.startWriteStruct(key, cv2.FILE_NODE_MAP)
                for inner, number in value.items():
                    storage.write(inner, number)
                storage.endWriteStruct()
            else:
                storage.write(key, value)
        (folder / name).write_text(storage.releaseAndGetString())


def of_programs(folder: Path, rig: CameraRig) -> dict[str, Path]:
    """Write the rig as other programs do, in the layouts that they document."""
    for name in ("jarvis", "dannce", "biocv"):
        (folder / name).mkdir(parents=True)
    mm = [(1000 * c.t, np.vstack([np.column_stack([c.R, 1000 * c.t]), [0, 0, 0, 1]])) for c in rig]
    bend = [0.1, -0.02, 1e-3, 2e-3, 0.0]
    aist = [
        {"name": c.name, "size": c.size, "matrix": c.K.tolist(), "distortions": bend,
         "rotation": cv2.Rodrigues(c.R)[0].ravel().tolist(), "translation": (100 * c.t).tolist()}
        for c in rig
    ]  # fmt: skip
    (folder / "aist.json").write_text(json.dumps(aist))
    lenses = {
        c.name: {"model": "standard", "image_size": c.size, "K": c.K.tolist(), "dist": [bend]}
        for c in rig
    }
    first = rig[0].name
    tables = [
        f"[cameras.{k}]\ncam_id = {k}\nignore = false\nsize = {list(c.size)}\n"
        f"matrix = {c.K.tolist()}\ndistortions = {bend}\n"
        f"translation = {c.t.tolist()}\nrotation = {c.R.tolist()}\n"
        for k, c in enumerate(rig, 1)
    ]
    ignored = "[cameras.9]\ncam_id = 9\nignore = true\n"
    (folder / "camera_array.toml").write_text("".join([*tables, ignored]))
    steps = {
        c.name if k == 0 else f"{c.name}_to_{first}": {"R": c.R.tolist(), "T": c.t.tolist()}
        for k, c in enumerate(rig)
    }
    (folder / "multical.json").write_text(json.dumps({"cameras": lenses, "camera_poses": steps}))
    tables = {
        f"camera_{k}": {
            "camera_matrix": c.K, "distortion_vector": np.array([bend]), "distortion_type": 0,
            "img_width": c.size[0], "img_height": c.size[1],
            "camera_pose_matrix": np.linalg.inv(poses(rig)[k]),
        }
        for k, c in enumerate(rig)
    }  # fmt: skip
    opencv_files(folder, {"mccalib.yml": {"nb_camera": len(rig), **tables}})
    chain, before = [], np.eye(4)
    for k, (c, pose) in enumerate(zip(rig, poses(rig), strict=True)):
        lens = c.K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        matrix = "".join(f"  - {row}\n" for row in (pose @ np.linalg.inv(before)).tolist())
        chain.append(
            f"cam{k}:\n  T_cn_cnm1:\n{matrix}  camera_model: pinhole\n  distortion_coeffs: {bend}\n"
            f"  distortion_model: radtan\n  intrinsics: {lens}\n  resolution: {list(c.size)}\n"
            f"  rostopic: /{c.name}/image_raw\n"
        )
        before = pose
    (folder / "camchain.yaml").write_text("".join(chain))
    skeletool, numbered = "Skeletool Camera Calibration File V1.0\n", ""
    for k, (c, (t, pose)) in enumerate(zip(rig, mm, strict=True)):
        opencv_files(folder / "jarvis", {f"Calib_{c.name}.yaml": {
            "intrinsicMatrix": c.K.T.copy(), "R": c.R.T.copy(), "T": t,
            "distortionCoefficients": np.array([bend]),
        }})  # fmt: skip
        savemat(folder / "dannce" / f"hires_{c.name}_params.mat", {
            "K": c.K.T, "r": c.R.T, "t": t[None], "TDistort": bend[2:4],
            "RDistort": [*bend[:2], 3e-3],
        })  # fmt: skip
        text = f"{c.size[0]}\n{c.size[1]}\n{rows(c.K)}\n\n{rows(pose)}\n\n{words(np.array(bend))}\n"
        (folder / "biocv" / f"{c.name}.mp4.calib").write_text(text)
        K = np.eye(4)
        K[:3, :3] = c.K
        skeletool += (
            f"name {k}\n  size {c.size[0]} {c.size[1]}\n  intrinsic {words(K)}\n"
            f"  extrinsic {words(pose)}\n  radial 0\n"
        )
        numbered += f"{k}\n{rows(c.K)}\n0.1 -0.02\n{rows(poses(rig)[k][:3])}\n\n"
    (folder / "skeletool.calibration").write_text(skeletool)
    (folder / "numbered.txt").write_text(numbered)
    return {path.stem: path for path in folder.iterdir()}


@pytest.mark.parametrize(
    "program",
    [
        "aist",
        "camera_array",
        "multical",
        "mccalib",
        "camchain",
        "jarvis",
        "dannce",
        "biocv",
        "skeletool",
        "numbered",
    ],
)
def test_layouts_of_other_programs(tmp_path: Path, program: str) -> None:
    rig = plain_rig()
    found = read_calibration(of_programs(tmp_path / "a", rig)[program], sizes=footage.SIZE)
    named = dict.fromkeys(("mccalib", "skeletool", "numbered"), "camera_{}")
    named["camera_array"] = "cam_{1}"  # of Caliscope, as its videos
    assert found.names == [named.get(program, c.name).format(k, k + 1) for k, c in enumerate(rig)]
    bends = {"skeletool": [0.0] * 5, "numbered": [0.1, -0.02, 0, 0, 0]}
    bend = bends.get(program, [0.1, -0.02, 1e-3, 2e-3, 3e-3 if program == "dannce" else 0])
    for a, b in zip(found, rig, strict=True):
        assert a.size == b.size
        for field in ("K", "R", "t"):
            np.testing.assert_allclose(getattr(a, field), getattr(b, field), atol=1e-6)
        np.testing.assert_allclose(a.distortion, bend)


@pytest.mark.parametrize("program", ["toml", "nerf", "colmap", "kalibr"])
def test_fisheye_lenses_are_read(tmp_path: Path, program: str) -> None:
    """All say the same lens of OpenCV's."""
    bend, K = [-0.02, 0.01, -5e-3, 1e-3], plain_rig()[0].K
    frame = {"file_path": "a", "transform_matrix": np.diag([1.0, -1, -1, 1]).tolist()}
    lens = {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2] + 0.5, "cy": K[1, 2] + 0.5}
    stated = {"camera_model": "OPENCV_FISHEYE", "w": footage.SIZE[0], "h": footage.SIZE[1]}
    bends = dict(zip(("k1", "k2", "k3", "k4"), bend, strict=True))
    whole = K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    texts = {
        "toml": f"[a]\nsize = {list(footage.SIZE)}\nmatrix = {K.tolist()}\nfisheye = true\n"
        f"distortions = {bend}\nrotation = [0, 0, 0]\ntranslation = [0, 0, 0]\n",
        "nerf": json.dumps({**stated, **lens, **bends, "frames": [frame]}),
        "colmap": f"1 OPENCV_FISHEYE {words(np.array(footage.SIZE)).replace('.0', '')} "
        f"{words(np.array([*lens.values(), *bend]))}",
        "kalibr": f"a:\n  camera_model: pinhole\n  distortion_model: equidistant\n"
        f"  distortion_coeffs: {bend}\n  intrinsics: {whole}\n  resolution: {list(footage.SIZE)}\n",
    }
    names = {"toml": "c.toml", "nerf": "transforms.json", "colmap": "cameras.txt"}
    path = tmp_path / names.get(program, "camchain.yaml")
    path.write_text(texts[program])
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n")
    (camera,) = read_calibration(path)
    assert camera.fisheye and camera.size == footage.SIZE
    points = np.array([[1.5, 0.5, 1.0], [-0.4, 1.0, 2.0]])
    expected = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), K, np.array(bend)
    )[0][:, 0]
    np.testing.assert_allclose(camera.project(points)[0], expected, atol=1e-9)
    if program == "toml":
        path.write_text(texts["toml"].replace("[-0.02,", "[0.3, -0.02,"))
        with pytest.raises(InputError, match="5 distortion coefficients; expected at most 4"):
            read_calibration(path)


def test_a_folder_that_holds_a_calibration(tmp_path: Path) -> None:
    camera = plain_rig()[0]
    (tmp_path / "calib").mkdir()
    numbers = words(np.concatenate([camera.K.ravel(), camera.R.ravel(), camera.t]))
    (tmp_path / "calib" / "a.krt").write_text(numbers)
    (found,) = read_calibration(tmp_path, sizes=footage.SIZE)
    np.testing.assert_allclose(found.t, camera.t, atol=1e-6)


def sequence_in(folder: Path, files: Files, rig: CameraRig) -> Path:
    for camera in rig:
        footage.write_image(folder / "images" / camera.name / "0000.png", 90)
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder


def native(folder: Path, rig: CameraRig) -> Path:
    footage.write_toml(folder / "calibration.toml", footage.tables(rig))
    return sequence_in(folder, {}, rig)


@pytest.mark.parametrize("kind", FORMATS)
def test_info_says_the_same_of_all(tmp_path: Path, kind: str) -> None:
    one = Sequence.open(native(tmp_path / "toml", plain_rig()))
    other = Sequence.open(sequence_in(tmp_path / "other", FORMATS[kind](plain_rig()), plain_rig()))
    expected, found = SequenceInfo(one), SequenceInfo(other)
    for a, b in zip(other.rig, one.rig, strict=True):
        assert (a.name, a.size) == (b.name, b.size)
        np.testing.assert_allclose([a.K[0, 0], a.centre[2]], [b.K[0, 0], b.centre[2]], rtol=1e-6)
    np.testing.assert_allclose(found.distances, expected.distances, rtol=1e-6)
    np.testing.assert_allclose(found.centre, expected.centre, atol=1e-6)
    assert found.warnings == expected.warnings


@pytest.mark.parametrize("kind", sorted(FORMATS.keys() - {"colmap", "colmap_binary", "vicon"}))
def test_left_handed_worlds_are_mended(tmp_path: Path, kind: str) -> None:
    """The file's world is mirrored, as programs with other axes write it; the pictures are the
    same."""
    rig, mirrored = plain_rig(), []
    for camera in rig:
        fake = object.__new__(Camera)  # which would refuse such a rotation
        fake.__dict__.update({**vars(camera), "R": camera.R @ MIRROR})
        mirrored.append(fake)
    wrong = CameraRig(tuple(mirrored))
    sequence = Sequence.open(sequence_in(tmp_path / "a", FORMATS[kind](wrong), wrong))
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    for found, camera in zip(sequence.rig, rig, strict=True):
        np.testing.assert_allclose(found.project(points)[0], camera.project(points)[0], atol=1e-5)
    assert "left-handed" in " ".join(sequence.notes)


def test_worlds_of_both_hands_are_refused(tmp_path: Path) -> None:
    lines = [
        f"{c.name} {words(c.K)} {words(c.R @ (MIRROR if k else np.eye(3)))} {words(c.t)}"
        for k, c in enumerate(plain_rig())
    ]
    (tmp_path / "x_par.txt").write_text("\n".join(["4", *lines]))
    with pytest.raises(InputError, match=r"x_par\.txt: 3 of 4 rotations have determinant -1"):
        read_calibration(tmp_path / "x_par.txt", sizes=footage.SIZE)


#: A picture of NeRF's transforms.json.
_FRAME = b'{"file_path": "a", "transform_matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]}'


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.mat", b"nothing", "expected a MATLAB"),
        (
            "c.json",
            b'{"cameras": [{"name": "a", "distCoef": []}]}',
            "cameras a with distCoef, name",
        ),
        (
            "camchain.yaml",
            b"cam0:\n  camera_model: omni\n  distortion_model: radtan\n  intrinsics: [9, 9, 1, 1]\n"
            b"  distortion_coeffs: [0, 0, 0, 0]\n  resolution: [64, 48]\n",
            "camera cam0: lens is .omni-radtan.; expected pinhole-radtan",
        ),
        ("transforms.json", b'{"frames": []}', "frames"),
        ("transforms.json", b'{"frames": [{"file_path": "a"}]}', "transform_matrix"),
        (
            "transforms.json",
            b'{"camera_model": "FISHEYE624", "fl_x": 9, "frames": [%s]}' % _FRAME,
            "camera a: camera_model FISHEYE624; expected a pinhole or fisheye camera",
        ),
        (
            "transforms.json",
            b'{"fl_x": 9, "k4": 0.1, "frames": [%s]}' % _FRAME,
            "camera a: k4; expected a pinhole or fisheye camera",
        ),
        (
            "transforms.json",
            b'{"latlong": true, "fl_x": 9, "frames": [%s]}' % _FRAME,
            "camera a: latlong; expected",
        ),
        ("cameras.txt", b"1 FISHEYE 10 10 1 2 3", "camera model FISHEYE"),
        ("a.qca.txt", b"<calibration><cameras/></calibration>", "no elements cameras"),
        ("b.qca.txt", b"<calibration><cameras><camera></cameras>", "expected XML with"),
        ("c.qca.txt", b'<!DOCTYPE a [<!ENTITY b "c">]><calibration/>', "document type"),
        ("cameras.bin", b"\1\0\0\0\0\0\0\0\1\0", "ends in the middle"),
        ("cameras.bin", b"\xff" * 8, "expected at most 1000"),
        (
            "theia.txt",
            b"<calibration><cameras><camera><intrinsic/></camera></cameras></calibration>",
            "Theia3D is not read",
        ),
        ("a.mcal", b"<a/>", "no elements .*Camera"),
        ("b.mcal", b"<a><Camera Serial='M1'/></a>", "camera M1: .* Motive 3.2"),
        ("a.xcp", b"<Cameras><Camera/></Cameras>", "no elements Camera/KeyFrames"),
        (
            "b.xcp",
            b"<Cameras><Camera><KeyFrames><KeyFrame/></KeyFrames></Camera></Cameras>",
            "lacks FOCAL_LENGTH",
        ),
        ("calib.txt", b"1 0\n0 9 0 9 1 2 3 4 5 6 7 8 9 0 1 2 3 4 5", "expected 22 of Surrey"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    if name == "cameras.txt":
        (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.png\n\n")
    with pytest.raises(InputError, match=rf"{name}.*{message}"):
        read_calibration(tmp_path / name, sizes=(64, 48))


def test_picture_sizes_of_a_flat_folder_by_order(tmp_path: Path) -> None:
    """The pictures' names are not the cameras': they are assigned in order, with a note."""
    (tmp_path / "dino_Ps.mat").write_bytes(matlab_cells(plain_rig())["dino_Ps.mat"])
    for number in range(4):
        footage.write_image(tmp_path / f"viff.{number:03d}.png", 40 * number)
    sequence = Sequence.open(tmp_path)
    assert any("viff.002" in note and "order" in note for note in sequence.notes)
    images = sequence.read(0).images
    assert images is not None and [int(image.mean()) for image in images] == [0, 40, 80, 120]


def test_convert_writes_a_native_folder(tmp_path: Path) -> None:
    rig, out = plain_rig(), tmp_path / "native"
    folder = sequence_in(tmp_path / "a", colmap(rig), rig)
    flags = ["--unit", "cm", "--up", "y", "--cameras", "cam01,cam03", "--subject", "object"]
    box = ["--volume", "own:-1,1,-2,2,-3,3"]
    assert "2 cameras, 1 frames" in succeed("psfs", "convert", folder, "-o", out, *flags, *box).out
    given = {"unit": "cm", "up": "y", "cameras": ["cam01", "cam03"]}
    before, after = Sequence.open(folder, **given), Sequence.open(out)
    for a, b in zip(after.rig, before.rig, strict=True):
        assert a.name == b.name
        np.testing.assert_allclose(a.centre, b.centre, atol=1e-9)
        np.testing.assert_allclose(a.R, b.R, atol=1e-9)
    assert after.subject == "object" and after.unit == "m" and after.volume is not None
    np.testing.assert_allclose(after.volume, [[-0.03, -0.01, -0.02], [0.03, 0.01, 0.02]])
    np.testing.assert_array_equal(after.read(0).images, before.read(0).images)


@pytest.mark.parametrize("kind", FORMATS_OF_CONVERT)
def test_convert_writes_the_calibration_of_other_programs(tmp_path: Path, kind: str) -> None:
    assert tuple(WRITERS) == FORMATS_OF_CONVERT
    rig = CameraRig(
        tuple(replace(c, distortion=np.array([-0.1, 0.02, 0.001, -0.002, 0])) for c in plain_rig())
    )
    folder = native(tmp_path / "a", rig)
    succeed("psfs", "convert", str(folder), "-o", str(tmp_path / "b"), "--to", kind)
    path = find_calibration(tmp_path / "b") or tmp_path / "b" / "Calib.qca.txt"
    found = read_calibration(path)
    for a, b in zip(found, rig, strict=True):
        assert a.size == b.size and (a.name == b.name or kind == "caliscope")
        for field in ("K", "distortion", "R", "t"):
            np.testing.assert_allclose(getattr(a, field), getattr(b, field), atol=1e-6)
    bent = CameraRig(tuple(replace(c, distortion=np.array([0, 0, 0, 0, 0.1])) for c in rig))
    if kind == "qualisys":
        with pytest.raises(InputError, match="cam01 has k3"):
            write_calibration(tmp_path, bent, kind)
    else:
        write_calibration(tmp_path / "c", bent, kind)
    with pytest.raises(InputError, match="Tsai"):
        tsai = replace(rig[0], distortion=np.zeros(5), kappa=0.1)
        write_calibration(tmp_path, CameraRig((tsai,)), kind)
