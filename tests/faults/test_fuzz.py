"""Every reader given damaged files: one clear error, little memory, little time.

A few examples of each in the test run; PSFS_APF_FUZZ=10000 tries so many, other ones every time, as
the nightly workflow does.
"""

import contextlib
import shutil
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import cv2
import numpy as np
import pytest
import tomli_w
from helpers import faults, footage, opensim, tracks
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
from apf.tracking.settings import DEFAULT_BODY
from apf.tracking.track import Track
from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.common.files import read_json, read_toml
from psfs.common.pictures import read_picture
from psfs.common.ranges import LONGEST_NAME, check_name, escape_unprintable
from psfs.footage.timing import _read_times
from psfs.voxels.body_prior import TrackedBody
from psfs.voxels.clouds import read_cloud

#: Of pictures.
SUFFIXES = (".png", ".jpg", ".bmp", ".tiff", ".ppm")


def seeds(folder: Path) -> None:
    """Add small files of other kinds to a stock."""
    faults.stock_keypoints(folder)
    track, rig = tracks.walker(3), footage.rig(3)
    write_c3d(folder / "truth.c3d", tracks.truth_of(track))
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
    picture = np.random.default_rng(1).integers(0, 255, (24, 32, 3), np.uint8)
    for suffix in SUFFIXES:
        cv2.imwrite(str(folder / f"picture{suffix}"), picture)
    (folder / "dask.json").write_text('{"type": "Scheduler", "address": "tcp://127.0.0.1:1"}')
    matrices = [camera.K @ np.c_[camera.R, camera.t] for camera in rig]
    savemat(folder / "cameras.mat", {"P": np.stack(matrices, -1)})
    storage = cv2.FileStorage(str(folder / "camera.xml"), cv2.FILE_STORAGE_WRITE)
    for key, value in (("K", rig[0].K), ("R", rig[0].R), ("T", rig[0].t[:, None])):
        storage.write(key, value)
    storage.release()


READERS: dict[str, Callable[[Path], Any]] = {
    "track/track.npz": Track.open,
    "truth.trc": load_truth,
    "truth.c3d": load_truth,
    "truth.npz": load_truth,
    "track/body.toml": load_body,
    "pose.txt": lambda path: read_pose(path, load_body(DEFAULT_BODY)),
    "out/summary.json": lambda path: read_json(path, "a summary"),
    "k.npz": read_raw,
    "k.npy": read_raw,
    "pkl/cam01/x_rotated_pp.pkl": read_raw,
    "json/cam01_json/cam01_000000.json": lambda path: read_raw(path.parent),
    "csv/cam01DLC_resnet50_walkJan1shuffle1_100000.csv": read_raw,
    "walk/calibration.toml": read_calibration,
    "cameras.mat": lambda path: read_calibration(path, sizes=(64, 48)),
    "camera.xml": read_calibration,
    "walk/calibration.toml as TOML": lambda path: read_toml(path),
    "corrections.toml": read_corrections,
    "timestamps.csv": _read_times,
    "people/people.json": lambda path: PeopleTracks.open(path.parent),
    "track/track.npz as a prior": TrackedBody.open,
    "markers.toml": load_markers,
    "model.osim": read_model,
    "dask.json": _read_scheduler_file,
    "out/clouds/frame_000001.npz": read_cloud,
    **{f"picture{suffix}": read_picture for suffix in SUFFIXES},
}


@pytest.fixture(scope="module")
def whole(original: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = Path(shutil.copytree(original, tmp_path_factory.mktemp("seeds") / "stock"))
    seeds(folder)
    return folder


@pytest.mark.parametrize("name", READERS)
def test_whole_and_damaged_files(tmp_path: Path, whole: Path, name: str) -> None:
    path = tmp_path / name.split(" ")[0]
    path.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(whole / name.split(" ")[0], path)
    if name != "camera.xml":  # of one camera alone, without a size
        READERS[name](whole / name.split(" ")[0])
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
