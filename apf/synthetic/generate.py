"""Write a synthetic sequence as a native folder: calibration, videos, background, truth."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from apf.body.toml import save_body
from apf.formats.pose import write_pose
from apf.formats.trc import JointSeries, write_trc
from apf.synthetic.config import SceneConfig
from apf.synthetic.render import SyntheticScene
from cl import Device, InputError, NumpyDevice
from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.common.files import write_picture, write_toml
from psfs.common.outputs import claim, clear_leftovers, output_folder, temporary_name
from psfs.footage.threads import prefetch
from psfs.output.video import write_video

BACKGROUND_FRAMES = 30
#: Every n-th frame's true silhouettes are written.
MASK_STEP = 10
#: A folder with this file was written by us and may be replaced.
MARK = "synthetic.toml"
_RESULTS = (
    "calibration.toml",
    "videos/cam*",
    "background/cam*",
    "truth.*",
    "body.toml",
    "start.txt",
    "truth_person*",
    "truth_masks/cam*",
    "truth_masks_people/cam*",
    MARK,
)


def generate(
    folder: str | Path,
    config: SceneConfig,
    device: Device | NumpyDevice,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write the sequence that `config` describes to `folder`, completely or not at all.

    `progress(done, frames)` is called after every frame. Raises InputError if `folder` holds
    something that this function did not write, or a video cannot be written.
    """
    folder = Path(folder)
    with output_folder(folder, "apf synth", (), _RESULTS), _stage_folder(folder) as temporary:
        scene = SyntheticScene(config, device)
        write_toml_tables(temporary / "calibration.toml", scene.rig)
        with _open_videos(temporary / "background", scene) as write:
            empty = (scene.background_frame(i) for i in range(BACKGROUND_FRAMES))
            for images in prefetch(empty, depth=1):
                write(images)
        with _open_videos(temporary / "videos", scene) as write:
            frames = (scene.frame(i) for i in range(config.frames))
            for i, (images, numbers) in enumerate(prefetch(frames, depth=1)):
                write(images)
                if i % MASK_STEP == 0:
                    shown = {"truth_masks": np.where(numbers > 0, np.uint8(255), np.uint8(0))}
                    shown |= {"truth_masks_people": numbers} if config.people > 1 else {}
                    for kind, masks in shown.items():
                        for camera, mask in zip(scene.rig.names, masks, strict=True):
                            write_picture(temporary / kind / f"{camera}_{i:06d}.png", mask)
                if progress is not None:
                    progress(i + 1, config.frames)
        write_truth(temporary, scene)
        if (roamer := scene.roamer) is not None:
            save_body(temporary / "body.toml", roamer.body)
            write_pose(temporary / "start.txt", roamer.poses[0], roamer.body)
        stated = {name: of for name, of in config.to_dict().items() if of is not None}
        write_toml(temporary / MARK, {"synthetic": stated})


def write_truth(folder: Path, scene: SyntheticScene) -> None:
    """Write truth.npz (metres, Z up) and truth.trc (see `apf.formats.trc`); of several people
    truth.npz with joints (F, P, J, 3) and person_names, and truth_person1.trc and so on."""
    fps, names, everybody = scene.config.fps, scene.joint_names, scene.people_joints
    rest = {"joint_names": np.array(names), "fps": np.float64(fps)}
    joints, files = scene.joints, ["truth.trc"]
    if len(everybody) > 1:
        persons = [f"person{number}" for number in range(1, len(everybody) + 1)]
        joints, rest["person_names"] = np.moveaxis(everybody, 0, 1), np.array(persons)
        files = [f"truth_{person}.trc" for person in persons]
    np.savez(folder / "truth.npz", joints=joints, **rest)
    for file, joints in zip(files, everybody, strict=True):
        write_trc(folder / file, JointSeries(tuple(names), joints, fps, np.arange(len(joints))))


@contextmanager
def _open_videos(folder: Path, scene: SyntheticScene) -> Iterator[Callable[[np.ndarray], None]]:
    """Open one video per camera; yield a function that writes images (V, H, W, 3) uint8 BGR to
    them."""
    with ExitStack() as stack:
        paths = [folder / f"{camera.name}.mp4" for camera in scene.rig]
        videos = [  # at a quality that keeps the noise
            stack.enter_context(write_video(path, scene.config.fps, quality=12)) for path in paths
        ]

        def write(images: np.ndarray) -> None:
            for video, image in zip(videos, images, strict=True):
                video.write(image)

        yield write


@contextmanager
def _stage_folder(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `folder`; on success move its files into `folder`.

    The temporary folder is removed in any case.
    """
    temporary = temporary_name(Path(os.path.realpath(folder)))
    try:
        temporary.mkdir(parents=True)
        clear_leftovers(temporary.parent)
        yield temporary
        for path in sorted(temporary.rglob("*")):
            if path.is_file():
                target = folder / path.relative_to(temporary)
                claim(target)
                target.parent.mkdir(parents=True, exist_ok=True)
                path.replace(target)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
