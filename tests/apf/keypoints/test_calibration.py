"""Cameras in metres, Z up, from the keypoints of a body that walks."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers import footage
from helpers import keypoints as made
from helpers.calibration import ring, unplaced
from helpers.commands import fail, succeed
from helpers.striders import strider

from apf.body.stature import stature
from apf.keypoints.calibration import calibrate_by_keypoints
from apf.keypoints.keypoints import Keypoints
from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.cameras.camera import CameraRig
from psfs.self_calibration.config import PersonConfig

RIG = CameraRig(tuple(ring()[:4]))


@pytest.fixture(scope="module")
def walk() -> tuple[Keypoints, float]:
    """Keypoints of a walker who turns about, and the walker's stature, m."""
    track = strider(36)
    poses = np.array(track.poses)
    poses[:, :2] -= poses[:, :2].mean(axis=0)
    return made.of_poses(RIG, track.body, poses, noise=0.5), stature(track.body)


def test_the_world_has_z_up_and_metres(walk: tuple[Keypoints, float]) -> None:
    keypoints, height = walk
    config = PersonConfig(stature=height, longest_lag=0)
    found = calibrate_by_keypoints(unplaced(list(RIG)), keypoints, 60.0, config)
    own, true = found.rig.centres, RIG.centres
    apart = [np.linalg.norm(of[:, None] - of[None], axis=-1) for of in (own, true)]
    np.testing.assert_allclose(apart[0], apart[1], rtol=0.06)
    np.testing.assert_allclose(own[:, 2], true[:, 2], atol=0.3)
    ups = [a.R.T @ b.R[:, 2] for a, b in zip(found.rig, RIG, strict=True)]
    assert np.degrees(np.arccos(np.mean(ups, axis=0)[2])) < 4


def test_the_command_writes_cameras(walk: tuple[Keypoints, float], tmp_path: Path) -> None:
    keypoints, _ = walk
    for camera in RIG:
        path = tmp_path / "videos" / f"{camera.name}.mp4"
        footage.write_video(path, [0] * keypoints.n_frames, 60, camera.size)
    names = {"keypoint_names": keypoints.names, "camera_names": keypoints.camera_names}
    np.savez(tmp_path / "keypoints.npz", keypoints=keypoints.points, **names)
    lens, settings, out = (tmp_path / name for name in ("lens.toml", "settings.toml", "out"))
    write_toml_tables(lens, CameraRig(tuple(unplaced(list(RIG)))))
    settings.write_text("[person]\nlongest_lag = 0\n")
    flags = ["calibrate", tmp_path, "--keypoints", tmp_path / "keypoints.npz", "-o", out]
    assert "--intrinsics PATH" in fail("apf", *flags)
    flags += ["--config", settings, "--intrinsics", lens]
    said = " ".join(fail("apf", *flags).split())
    assert "do not confirm" in said and "the whole person is in 0" in said
    succeed("apf", *flags, "--no-silhouettes")
    found = read_calibration(out / "calibration.toml")
    apart = [np.linalg.norm(of[0] - of[2]) for of in (found.centres, RIG.centres)]
    assert abs(apart[0] / apart[1] - 1) < 0.12
    report = json.loads((out / "calibration.json").read_text())
    assert report["verdict"].startswith("keypoints are") and report["up_from"] == "person"


def test_keypoints_without_limbs_are_refused() -> None:
    empty = Keypoints(np.full((4, 9, 2, 3), np.nan), ("nose", "left_eye"), tuple(RIG.names))
    with pytest.raises(InputError, match="have 0 of the points that are used"):
        calibrate_by_keypoints(list(RIG), empty, 30.0, PersonConfig())
