"""Every reader given damaged files: one clear error, little memory, little time.

A few examples of each in the test run; PSFS_APF_FUZZ=10000 tries so many, other ones every time, as
the nightly workflow does.
"""

import contextlib
import json
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np
import pytest
import tomli_w
from helpers import bodies, footage, opensim, scenes, tracks
from helpers.fuzz import check_reader, draw_examples
from scipy.io import savemat

from apf.body.toml import load_body
from apf.cluster.connection import _read_scheduler_file
from apf.evaluation.marker_truth import load_markers
from apf.evaluation.truth import load_truth
from apf.formats.c3d import write_c3d
from apf.formats.opensim.model import read_model
from apf.formats.pose import read_pose
from apf.keypoints.opening import read_raw
from apf.tracking.people import PeopleTracks
from apf.tracking.retracking import Correction, Corrections, read_corrections, write_corrections
from apf.tracking.track import Track
from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.common.files import read_json, read_toml
from psfs.common.pictures import read_picture
from psfs.common.ranges import LONGEST_NAME, check_name, escape_unprintable
from psfs.footage.timing import _read_times
from psfs.voxels.body_prior import TrackedBody
from psfs.voxels.clouds import read_cloud, write_npz
from psfs.voxels.grid import VoxelCloud, VoxelGrid

#: Of pictures.
SUFFIXES = (".png", ".jpg", ".bmp", ".tiff", ".ppm")


def seeds(folder: Path) -> None:
    """Write a small file of each kind."""
    keypoints_and_cameras(folder)
    track = tracks.walker(3)
    write_corrections(
        folder / "corrections.toml",
        Corrections(Path("track"), (Correction(1, "l_wrist", (0.1, 0.2, 1.0)),), ((0, 1),)),
    )
    rows = [f"{camera},{frame},{frame / 30:.3f}" for camera in "ab" for frame in range(3)]
    (folder / "timestamps.csv").write_text("\n".join(["cam_id,frame_index,frame_time", *rows]))
    PeopleTracks((track, track), track.frames, (track.frames,) * 2).save(folder / "people")
    marker = {"name": "knee", "joint": "l_knee", "offset": [0.1, 0.0, 0.0]}
    (folder / "markers.toml").write_text(tomli_w.dumps({"stature": 1.8, "marker": [marker]}))
    opensim.write_model(folder / "model.osim")
    cloud = VoxelCloud(
        VoxelGrid(np.zeros(3), 0.1, (5, 5, 5)), np.arange(9, dtype=np.int32), np.ones(9, np.float32)
    )
    write_npz(cloud, folder / "cloud.npz")
    picture = np.random.default_rng(1).integers(0, 255, (24, 32, 3), np.uint8)
    for suffix in SUFFIXES:
        cv2.imwrite(str(folder / f"picture{suffix}"), picture)
    (folder / "dask.json").write_text('{"type": "Scheduler", "address": "tcp://127.0.0.1:1"}')


def keypoints_and_cameras(folder: Path) -> None:
    track, rig = tracks.walker(3), scenes.ring(3, size=(64, 48))
    track.save(folder / "track.npz")
    truth = tracks.truth_of(track)
    track.save(folder / "truth.trc")
    write_c3d(folder / "truth.c3d", truth)
    np.savez(folder / "truth.npz", joint_names=np.array(truth.joint_names), joints=truth.joints,
             fps=truth.fps, frames=truth.frames)  # fmt: skip
    (folder / "body.toml").write_text(bodies.STICK)
    (folder / "pose.txt").write_text("0.1 " * 31)
    (folder / "summary.json").write_text(json.dumps({"frames": [{"index": 1, "a": [1.5, None]}]}))
    points = np.random.default_rng(1).uniform(0, 60, (3, 4, 17, 3)) % (64, 48, 1)
    np.savez(folder / "keypoints.npz", keypoints=points, camera_names=["a", "b", "c"])
    np.save(folder / "keypoints.npy", points)
    people = [[{"pose_keypoints_2d": points[0, frame].ravel().tolist()}] for frame in range(4)]
    (folder / "a_keypoints.pkl").write_bytes(pickle.dumps(people))
    (folder / "json").mkdir()
    (folder / "json/a_000000.json").write_text(json.dumps({"people": people[0]}))
    names = [f"p{n}" for n in range(3) for _ in range(3)]
    table = (
        ["scorer"] + ["DLC"] * 9,
        ["bodyparts", *names],
        ["coords", *["x", "y", "likelihood"] * 3],
    )
    lines = [*(",".join(row) for row in table), *(f"{n},{','.join(['1.5'] * 9)}" for n in range(3))]
    (folder / "dlc.csv").write_text("\n".join(lines))
    (folder / "calibration.toml").write_text(tomli_w.dumps(footage.tables(rig)))
    matrices = [camera.K @ np.c_[camera.R, camera.t] for camera in rig]
    text = "\n".join(" ".join(map(repr, row)) for matrix in matrices for row in matrix.tolist())
    (folder / "projections.txt").write_text(text)
    savemat(folder / "cameras.mat", {"P": np.stack(matrices, -1)})
    for suffix in ("yml", "xml"):
        storage = cv2.FileStorage(str(folder / f"camera.{suffix}"), cv2.FILE_STORAGE_WRITE)
        for key, value in (("K", rig[0].K), ("R", rig[0].R), ("T", rig[0].t[:, None])):
            storage.write(key, value)
        storage.release()
    frames = [{"file_path": f"{n}.png", "transform_matrix": np.eye(4).tolist()} for n in range(3)]
    lens = {"fl_x": 60.0, "fl_y": 60.0, "cx": 32.0, "cy": 24.0, "w": 64, "h": 48}
    (folder / "transforms.json").write_text(json.dumps({**lens, "frames": frames}))


READERS: dict[str, Callable[[Path], Any]] = {
    "track.npz": Track.open,
    "truth.trc": load_truth,
    "truth.c3d": load_truth,
    "truth.npz": load_truth,
    "body.toml": load_body,
    "pose.txt": lambda path: read_pose(path, load_body("song31")),
    "summary.json": lambda path: read_json(path, "a summary"),
    "keypoints.npz": read_raw,
    "keypoints.npy": read_raw,
    "a_keypoints.pkl": read_raw,
    "json/a_000000.json": lambda path: read_raw(path.parent),
    "dlc.csv": read_raw,
    "calibration.toml": read_calibration,
    "projections.txt": lambda path: read_calibration(path, sizes=(64, 48)),
    "cameras.mat": lambda path: read_calibration(path, sizes=(64, 48)),
    "camera.yml": read_calibration,
    "camera.xml": read_calibration,
    "transforms.json": read_calibration,
    "calibration.toml as TOML": lambda path: read_toml(path),
    "corrections.toml": read_corrections,
    "timestamps.csv": _read_times,
    "people/people.json": lambda path: PeopleTracks.open(path.parent),
    "track.npz as a prior": TrackedBody.open,
    "markers.toml": load_markers,
    "model.osim": read_model,
    "dask.json": _read_scheduler_file,
    "cloud.npz": read_cloud,
    **{f"picture{suffix}": read_picture for suffix in SUFFIXES},
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("seeds")
    seeds(folder)
    return folder


@pytest.mark.parametrize("name", READERS)
def test_seeds_are_read(whole: Path, name: str) -> None:
    if name.startswith(("camera.", "summary")):  # of one camera alone; read_json checks nothing
        return
    READERS[name](whole / name.split(" ")[0])


@pytest.mark.parametrize("name", READERS)
def test_damaged_files(tmp_path: Path, whole: Path, name: str) -> None:
    path = tmp_path / name.split(" ")[0]
    path.parent.mkdir(exist_ok=True)
    shutil.copy(whole / name.split(" ")[0], path)
    named = Path(path.name)
    check_reader(lambda: READERS[name](path), [path], named, path.parent)


def draw_text(random: Random) -> str:
    """Return a text of characters of all kinds, none of them half of a pair."""
    ranges = ((0, 0x20), (0x20, 0x7F), (0x7F, 0x3000), (0x3000, 0xD800), (0xE000, 0x110000))
    chosen = random.choices(ranges, k=random.choice((0, 1, 2, 12, 120)))
    return "".join(chr(random.randrange(*of)) for of in chosen)


def test_names_and_what_is_printed() -> None:
    """A name that passes is a file's inside a folder, and prints as it is; all that is printed is
    one line."""
    for random in draw_examples():
        name = draw_text(random)
        assert escape_unprintable(name).isprintable()
        with contextlib.suppress(InputError):
            check_name(name, "a camera")
            assert 0 < len(name) <= LONGEST_NAME and escape_unprintable(name) == name
            assert Path("folder", name).parent == Path("folder") and name not in ("", ".", "..")
