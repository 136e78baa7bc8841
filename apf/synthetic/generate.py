"""Writes a synthetic sequence as a native folder: calibration, videos, background, truth."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import cv2
import numpy as np
import tomli_w

from apf.formats.trc import JointSeries, write_trc
from apf.synthetic.render import SyntheticScene
from apf.synthetic.scene import SceneConfig
from cl import Device, InputError, NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.common.files import write_picture

BACKGROUND_FRAMES = 30
#: The true silhouettes of every so many frames are kept.
MASK_STEP = 10
#: A folder with this file was written by us and may be replaced.
MARK = "synthetic.toml"


def generate(
    folder: str | Path,
    config: SceneConfig,
    device: Device | NumpyDevice,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write the sequence that `config` describes to `folder`, whole or not at all.

    `progress(done, frames)` is called after every frame. Raises InputError when `folder` holds
    something that this function did not write, or a video cannot be written.
    """
    folder = Path(folder)
    with _folder_written_whole(folder) as temporary:
        scene = SyntheticScene(config, device)
        write_calibration(temporary / "calibration.toml", scene.rig)
        with _videos(temporary / "background", scene) as write:
            for i in range(BACKGROUND_FRAMES):
                write(scene.background_frame(i))
        (temporary / "truth_masks").mkdir()
        with _videos(temporary / "videos", scene) as write:
            for i in range(config.frames):
                images, masks, _ = scene.frame(i)
                write(images)
                if i % MASK_STEP == 0:
                    for camera, mask in zip(scene.rig, masks, strict=True):
                        name = temporary / "truth_masks" / f"{camera.name}_{i:06d}.png"
                        write_picture(name, mask)
                if progress is not None:
                    progress(i + 1, config.frames)
        write_truth(temporary, scene)
        _write_toml(temporary / MARK, {"synthetic": dict(config.__dict__)})


def write_calibration(path: Path, rig: CameraRig) -> None:
    """The rig in Pose2Sim's convention (metres, Rodrigues vectors world -> camera)."""
    tables: dict[str, object] = {}
    for camera in rig:
        tables[camera.name] = {
            "name": camera.name,
            "size": [float(n) for n in camera.size],
            "matrix": camera.K.tolist(),
            "distortions": camera.distortion[:4].tolist(),
            "rotation": cv2.Rodrigues(camera.R)[0].ravel().tolist(),
            "translation": camera.t.tolist(),
            "fisheye": False,
        }
    tables["metadata"] = {"adjusted": False, "error": 0.0}
    _write_toml(path, tables)


def write_truth(folder: Path, scene: SyntheticScene) -> None:
    """truth.npz (metres, Z up) and truth.trc (see `apf.formats.trc`)."""
    fps, names, joints = scene.config.fps, scene.joint_names, scene.joints
    np.savez(folder / "truth.npz", joint_names=np.array(names), joints=joints, fps=np.float64(fps))
    write_trc(folder / "truth.trc", JointSeries(tuple(names), joints, fps, np.arange(len(joints))))


def _write_toml(path: Path, tables: dict[str, object]) -> None:
    with path.open("wb") as file:
        tomli_w.dump(tables, file)


@contextmanager
def _videos(folder: Path, scene: SyntheticScene) -> Iterator[Callable[[np.ndarray], None]]:
    """One video per camera; yields a function that takes images (V, H, W, 3) uint8 BGR."""
    folder.mkdir()
    with ExitStack() as stack:
        writers = []
        for camera in scene.rig:
            path = folder / f"{camera.name}.mp4"
            writer = cv2.VideoWriter(
                str(path), cv2.VideoWriter.fourcc(*"mp4v"), scene.config.fps, camera.size
            )
            stack.callback(writer.release)
            if not writer.isOpened():
                raise InputError(f"{path}: OpenCV could not open it for writing mp4v")
            writers.append(writer)

        def write(images: np.ndarray) -> None:
            for writer, image in zip(writers, images, strict=True):
                writer.write(image)

        yield write


@contextmanager
def _folder_written_whole(folder: Path) -> Iterator[Path]:
    """A temporary folder beside `folder`, moved to its place on success, else removed."""
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; expected a folder to write to")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / MARK).is_file():
        raise InputError(
            f"{folder}: holds files that `apf synth` did not write; expected a new or empty folder"
        )
    temporary = folder.with_name(f".{folder.resolve().name}.{os.getpid()}")
    try:
        temporary.mkdir(parents=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from error
    try:
        yield temporary
        if folder.is_dir():
            shutil.rmtree(folder)
        temporary.replace(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
