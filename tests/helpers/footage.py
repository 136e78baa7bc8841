"""Write tiny sequences for the tests: calibrations, videos and images."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import av
import cv2
import ezc3d
import numpy as np
import numpy.typing as npt
import tomli_w

from helpers import scenes
from psfs.cameras.camera import CameraRig

SIZE = (64, 48)
#: How many grey levels the videos' compression may change.
LOSS = 5


def rig(views: int = 3) -> CameraRig:
    """Return cameras of one size, as videos require."""
    cameras = []
    for k in range(views):
        angle = 2 * np.pi * k / views + 0.3
        centre = np.array([3 * np.cos(angle), 3 * np.sin(angle), 1.5])
        target = np.array([0.0, 0.0, 0.9])
        cameras.append(scenes.looking_at(f"cam{k + 1:02d}", centre, target, SIZE, 60.0))
    return CameraRig(tuple(cameras))


def grey(frame: int, view: int) -> int:
    """Return the grey level of a frame in a view; neighbouring frames differ by more than
    `LOSS`."""
    return 20 + 12 * (frame % 16) + 3 * view


def tables(cameras: CameraRig) -> dict:
    """Return the rig as Pose2Sim's TOML tables."""
    return {
        camera.name: {
            "name": camera.name,
            "size": [float(n) for n in camera.size],
            "matrix": camera.K.tolist(),
            "distortions": camera.distortion.tolist(),
            "rotation": cv2.Rodrigues(camera.R)[0].ravel().tolist(),
            "translation": camera.t.tolist(),
            "fisheye": False,
        }
        for camera in cameras
    }


def words(values: npt.ArrayLike) -> str:
    """Return numbers as words of a text, without loss."""
    return " ".join(repr(float(value)) for value in np.asarray(values).ravel())


def cut(path: Path, share: float) -> None:
    """Shorten a file to a share of its bytes."""
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])


def write_toml(path: Path, values: dict) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(tomli_w.dumps(values))


def write_video(
    path: Path,
    levels: Iterable[int],
    fps: float = 25.0,
    size: tuple[int, int] = SIZE,
    codec: str = "mp4v",
) -> None:
    """Write frames of one grey level each."""
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), fps, size)
    assert writer.isOpened()
    for level in levels:
        writer.write(np.full((size[1], size[0], 3), level, np.uint8))
    writer.release()


def write_film(
    path: Path,
    levels: Iterable[int],
    fps: int = 30,
    sound: tuple[np.ndarray, int] | None = None,
    **metadata: str,
) -> Path:
    """Write frames of one grey level each, with sound (N,) at a rate, Hz, and metadata, by PyAV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as container:
        container.metadata.update(metadata)
        video = container.add_stream("mpeg4", rate=fps)
        video.width, video.height, video.pix_fmt = *SIZE, "yuv420p"
        audio = sound and container.add_stream("aac", rate=sound[1], layout="mono")
        for level in levels:
            picture = np.full((*SIZE[::-1], 3), level, np.uint8)
            container.mux(video.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        container.mux(video.encode())
        if audio and sound:
            frame = av.AudioFrame.from_ndarray(sound[0].astype(np.float32)[None], "fltp", "mono")
            frame.sample_rate = sound[1]
            container.mux(audio.encode(frame))
            container.mux(audio.encode())
    return path


def write_picture(path: Path, picture: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), picture)


def write_image(path: Path, level: int, size: tuple[int, int] = SIZE) -> None:
    write_picture(path, np.full((size[1], size[0]), level, np.uint8))


def write_take(
    folder: Path,
    cameras: CameraRig,
    views: Iterable[Iterable[np.ndarray]],
    kind: str = "masks",
) -> Path:
    """Write a calibration and each camera's masks or images (h, w, ...) uint8, which may be padded
    to the size of the largest ones."""
    write_toml(folder / "calibration.toml", tables(cameras))
    for camera, pictures in zip(cameras, views, strict=True):
        width, height = camera.size
        for frame, picture in enumerate(pictures):
            path = folder / kind / camera.name / f"{frame:04d}.png"
            write_picture(path, picture[:height, :width])
    return folder


def native(folder: Path, views: int = 3, frames: int = 12) -> Path:
    """Write a native folder with videos and background videos."""
    cameras = rig(views)
    write_toml(folder / "calibration.toml", tables(cameras))
    for view, camera in enumerate(cameras):
        levels = [grey(frame, view) for frame in range(frames)]
        write_video(folder / "videos" / f"{camera.name}.mp4", levels)
        write_video(folder / "background" / f"{camera.name}.mp4", [100 + view] * 6)
    return folder


def write_c3d(
    path: Path, points: np.ndarray, labels: tuple[str, ...], rate: float, **said: Any
) -> None:
    """Write points (F, P, 3) in the file's unit and axes, NaN where missing, by ezc3d."""
    file: Any = ezc3d.c3d()
    file["header"]["points"]["first_frame"] = said.get("first", 0)
    point = file["parameters"]["POINT"]
    point["RATE"]["value"], point["UNITS"]["value"] = [rate], [said.get("unit", "mm")]
    point["LABELS"]["value"] = list(labels)
    if "up" in said:
        file.add_parameter("POINT", "Y_SCREEN", said["up"])
    data = np.ones((4, len(labels), len(points)))
    data[:3] = points.transpose(2, 1, 0)
    file["data"]["points"] = data
    missing = np.isnan(data[:3]).any(0)
    file["data"]["meta_points"]["residuals"] = np.where(missing, -1.0, 0.0)[None]
    file.write(str(path))
