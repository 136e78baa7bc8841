"""Keypoints that are swapped, rotated or of other pictures are reported in one line."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import scenes, tracks

from apf.keypoints.agreement import find_disagreements
from apf.keypoints.keypoints import Keypoints
from psfs.cameras.camera import CameraRig


@pytest.fixture(scope="module")
def rig() -> CameraRig:
    return scenes.ring(4, size=(320, 240))


@pytest.fixture(scope="module")
def seen(rig: CameraRig) -> Keypoints:
    """Return a walker's joints as four cameras see them, with an error of 1 px."""
    truth = tracks.truth_of(tracks.walker(12))
    pixels = np.stack([camera.project(truth.joints)[0] for camera in rig])
    pixels += np.random.default_rng(4).normal(0, 1, pixels.shape)
    points = np.concatenate([pixels, np.full((*pixels.shape[:3], 1), 0.9)], -1)
    names = tuple(f"{'left' if n[0] == 'l' else 'right'}_{n[2:]}" if n[1] == "_" else n
                  for n in truth.joint_names)  # fmt: skip
    return Keypoints(points, names, tuple(rig.names))


def spoilt(seen: Keypoints, rig: CameraRig, how: str) -> np.ndarray:
    points, last = seen.points.copy(), np.array(rig[2].size, np.float32) - 1
    sides = [n.replace("left", "*").replace("right", "left").replace("*", "right")
             for n in seen.names]  # fmt: skip
    if how == "exchanged":
        points[[0, 1]] = points[[1, 0]]
    elif how == "mirrored":
        points[2, ..., 0] = last[0] - points[2, ..., 0]
    elif how == "turned":
        points[2, ..., :2] = last - points[2, ..., :2]
    elif how == "left and right":
        points[2] = points[2][:, [seen.names.index(name) for name in sides]]
    elif how == "x and y":
        points = points[..., [1, 0, 2]]
    elif how == "upward":
        points[..., 1] = last[1] - points[..., 1]
    elif how == "large":
        points[..., :2] *= 2
    elif how == "elsewhere":
        points[2, ..., :2] += 40
    elif how == "anywhere":
        points[..., :2] = np.random.default_rng(5).uniform(0, 200, points[..., :2].shape)
    return points


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("exchanged", "the keypoints of c0 and c1 look exchanged"),
        ("mirrored", "camera c2 look mirrored"),
        ("turned", "camera c2 look turned by 180 degrees"),
        ("left and right", "left and right look exchanged in the keypoints of camera c2"),
        ("x and y", "x and y of the keypoints look exchanged"),
        ("upward", "seems to go up"),
        ("large", "pictures 2 times as large; expected pixels of c0's 3"),
        ("elsewhere", "camera c2 lie 57 px from where the others see them"),
        ("anywhere", "the cameras' keypoints do not fit each other"),
    ],
)
def test_what_is_wrong_is_said(seen: Keypoints, rig: CameraRig, how: str, said: str) -> None:
    found = find_disagreements(replace(seen, points=spoilt(seen, rig, how)), rig, 30.0)
    assert len(found) == 1 and said in found[0], found


def test_sound_keypoints_are_not_spoken_of(seen: Keypoints, rig: CameraRig) -> None:
    assert find_disagreements(seen, rig, 30.0) == []
    missing = seen.points.copy()
    missing[1], missing[0, ..., 2] = np.nan, 0.1
    assert find_disagreements(replace(seen, points=missing), rig, 30.0) == []
    pair = CameraRig(tuple(rig)[:2])
    assert find_disagreements(seen.select_cameras(pair.names), pair, 30.0) == []
