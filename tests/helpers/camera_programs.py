"""One rig of bent lenses as programs of calibration write it, in the layouts that they document."""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import cv2
import numpy as np

from helpers.camera_texts import Files, humaneva, matlab, rows
from helpers.footage import words
from psfs.cameras.camera import Camera, CameraRig


def pose(camera: Camera, unit: float = 1.0) -> np.ndarray:
    """Return the matrix (4, 4) from world to camera, in a unit of so many to the metre."""
    return np.vstack([np.column_stack([camera.R, unit * camera.t]), [0, 0, 0, 1]])


def storage(content: Mapping[str, Any], suffix: str = ".yml") -> str:
    """Return a text of OpenCV's FileStorage."""
    file = cv2.FileStorage(f"x{suffix}", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for key, value in content.items():
        if isinstance(value, Mapping | list):
            named = isinstance(value, Mapping)
            file.startWriteStruct(key, cv2.FILE_NODE_MAP if named else cv2.FILE_NODE_SEQ)
            for inner in value:
                file.write(inner if named else "", value[inner] if named else inner)
            file.endWriteStruct()
        else:
            file.write(key, value)
    return str(file.releaseAndGetString())


def opencv(rig: CameraRig, keys: Sequence[str], suffix: str = ".xml") -> Files:
    """A file of each camera; keys: of the matrix, the lens, the rotation and the translation."""
    files: Files = {}
    for c in rig:
        turn = c.R if keys[2] == "R" else cv2.Rodrigues(c.R)[0]
        values = dict(zip(keys, (c.K, c.distortion[None], turn, c.t[:, None]), strict=True))
        files[c.name + suffix] = storage(values, suffix)
    return files


def easymocap(rig: CameraRig) -> Files:
    lenses: dict[str, Any] = {"names": list(rig.names)}
    places: dict[str, Any] = {"names": list(rig.names)}
    for c in rig:
        lenses |= {f"K_{c.name}": c.K, f"dist_{c.name}": c.distortion[None]}
        places |= {f"R_{c.name}": cv2.Rodrigues(c.R)[0], f"T_{c.name}": c.t[:, None]}
        if c.name != "cam01":  # either form of the rotation suffices
            places[f"Rot_{c.name}"] = c.R
    return {"intri.yml": storage(lenses), "extri.yml": storage(places)}


def aist(rig: CameraRig) -> Files:
    cameras = [
        {"name": c.name, "size": c.size, "matrix": c.K.tolist(),
         "distortions": c.distortion.tolist(), "translation": (100 * c.t).tolist(),
         "rotation": cv2.Rodrigues(c.R)[0].ravel().tolist()}
        for c in rig
    ]  # fmt: skip
    return {"aist.json": json.dumps(cameras)}


def caliscope(rig: CameraRig) -> Files:
    tables = [
        f"[cameras.{k}]\ncam_id = {k}\nignore = false\nsize = {list(c.size)}\n"
        f"matrix = {c.K.tolist()}\ndistortions = {c.distortion.tolist()}\n"
        f"translation = {c.t.tolist()}\nrotation = {c.R.tolist()}\n"
        for k, c in enumerate(rig, 1)
    ]
    return {"camera_array.toml": "".join([*tables, "[cameras.9]\ncam_id = 9\nignore = true\n"])}


def multical(rig: CameraRig) -> Files:
    lenses = {
        c.name: {"model": "standard", "image_size": c.size, "K": c.K.tolist(),
                 "dist": [c.distortion.tolist()]}
        for c in rig
    }  # fmt: skip
    steps = {
        c.name if k == 0 else f"{c.name}_to_{rig[0].name}": {"R": c.R.tolist(), "T": c.t.tolist()}
        for k, c in enumerate(rig)
    }
    return {"multical.json": json.dumps({"cameras": lenses, "camera_poses": steps})}


def mccalib(rig: CameraRig) -> Files:
    tables = {
        f"camera_{k}": {
            "camera_matrix": c.K, "distortion_vector": c.distortion[None], "distortion_type": 0,
            "img_width": c.size[0], "img_height": c.size[1],
            "camera_pose_matrix": np.linalg.inv(pose(c)),
        }
        for k, c in enumerate(rig)
    }  # fmt: skip
    return {"mccalib.yml": storage({"nb_camera": len(rig), **tables})}


def kalibr(rig: CameraRig) -> Files:
    """Each camera's pose from the one before it."""
    chain, before = "", np.eye(4)
    for k, c in enumerate(rig):
        lens = c.K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        matrix = "".join(f"  - {row}\n" for row in (pose(c) @ np.linalg.inv(before)).tolist())
        chain += (
            f"cam{k}:\n  T_cn_cnm1:\n{matrix}  camera_model: pinhole\n  distortion_model: radtan\n"
            f"  distortion_coeffs: {c.distortion.tolist()}\n  intrinsics: {lens}\n"
            f"  resolution: {list(c.size)}\n  rostopic: /{c.name}/image_raw\n"
        )
        before = pose(c)
    return {"camchain.yaml": chain}


def jarvis(rig: CameraRig) -> Files:
    return {
        f"Calib_{c.name}.yaml": storage({
            "intrinsicMatrix": c.K.T.copy(), "R": c.R.T.copy(), "T": 1000 * c.t,
            "distortionCoefficients": c.distortion[None],
        })
        for c in rig
    }  # fmt: skip


def dannce(rig: CameraRig) -> Files:
    files: Files = {}
    for c in rig:
        radial, tangential = c.distortion[[0, 1, 4]], c.distortion[2:4]
        lens = {"K": c.K.T, "RDistort": radial, "TDistort": tangential}
        files |= matlab(f"hires_{c.name}_params.mat", **lens, r=c.R.T, t=1000 * c.t[None])
    return files


def biocv(rig: CameraRig) -> Files:
    parts = {c.name: (rows(c.K), rows(pose(c, 1000.0)), words(c.distortion)) for c in rig}
    size = "\n".join(map(str, rig[0].size))
    return {f"{name}.mp4.calib": "\n".join([size, *parts[name]]) + "\n" for name in parts}


def skeletool(rig: CameraRig) -> Files:
    text = "Skeletool Camera Calibration File V1.0\n"
    for k, c in enumerate(rig):
        K = np.eye(4)
        K[:3, :3] = c.K
        text += (
            f"name {k}\n  size {c.size[0]} {c.size[1]}\n  intrinsic {words(K)}\n"
            f"  extrinsic {words(pose(c, 1000.0))}\n  radial 0\n"
        )
    return {"skeletool.calibration": text}


def numbered(rig: CameraRig) -> Files:
    parts = [f"{rows(c.K)}\n{words(c.distortion[:2])}\n{rows(pose(c)[:3])}\n\n" for c in rig]
    return {"3DOH_Parameters.txt": "".join(f"{k}\n{part}" for k, part in enumerate(parts))}


_RODRIGUES = ("CameraMatrix", "DistortionCoeffs", "rvec", "T")
PROGRAMS: dict[str, Callable[[CameraRig], Files]] = {
    function.__name__: function
    for function in (aist, caliscope, multical, mccalib, kalibr, jarvis, dannce, biocv, skeletool,
                     numbered, easymocap)
} | {
    "humaneva": lambda rig: {f"{c.name}.cal": humaneva(c) for c in rig},
    **{f"opencv{suffix}": partial(opencv, keys=_RODRIGUES, suffix=suffix)
       for suffix in (".xml", ".yml", ".json")},
    "opencv_matrices": partial(opencv, keys=("M1", "D1", "R", "T")),
    **{f"utrecht_{kind}": partial(opencv, keys=(*_RODRIGUES[:2], f"Rotation{kind}",
                                                f"Translation{kind}"))
       for kind in ("Values", "Vector")},
}  # fmt: skip
