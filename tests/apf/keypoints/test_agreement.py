"""Keypoints that are swapped, turned, late or of other pictures are reported in one line."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import scenes, tracks

from apf.keypoints.agreement import faces_backward, find_disagreements
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.timing import find_lag_to_footage, find_late_cameras, shift_cameras
from psfs.cameras.camera import CameraRig
from psfs.diagnostics.small_views import SmallViews, extract_outline

FRAMES, RATE = 60, 60.0


@pytest.fixture(scope="module")
def rig() -> CameraRig:
    return scenes.ring(4, size=(320, 240))


def show(rig: CameraRig, names: tuple[str, ...], places: np.ndarray) -> Keypoints:
    """Return points (F, K, 3) m as four cameras see them, with an error of 1 px."""
    pixels = np.stack([camera.project(places)[0] for camera in rig])
    pixels += np.random.default_rng(4).normal(0, 1, pixels.shape)
    points = np.concatenate([pixels, np.full((*pixels.shape[:3], 1), 0.9)], -1)
    return Keypoints(points, names, tuple(rig.names))


@pytest.fixture(scope="module")
def seen(rig: CameraRig) -> Keypoints:
    """The joints of a walker."""
    truth = tracks.truth_of(tracks.walker(12))
    names = tuple(f"{'left' if n[0] == 'l' else 'right'}_{n[2:]}" if n[1] == "_" else n
                  for n in truth.joint_names)  # fmt: skip
    return show(rig, names, truth.joints)


@pytest.fixture(scope="module")
def long(rig: CameraRig) -> Keypoints:
    """Joints, nose, ears and toes of a walker."""
    track = tracks.walker(FRAMES)
    joints = dict(zip(track.joint_names, track.joints.swapaxes(0, 1), strict=True))
    across = joints["l_shoulder"] - joints["r_shoulder"]
    forward = np.cross(across, [0.0, 0.0, 1.0]) / np.linalg.norm(across, axis=1, keepdims=True)
    head = joints["head_top"] - [0.0, 0.0, 0.12]
    joints |= {"nose": head + 0.1 * forward}
    for side, sign in (("l", 0.2), ("r", -0.2)):
        joints[f"{side}_ear"] = head + sign * across
        joints[f"{side}_big_toe"] = joints[f"{side}_ankle"] + 0.2 * forward
    return show(rig, tuple(joints), np.stack(list(joints.values()), axis=1))


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


@pytest.mark.parametrize("late", [0, 3, -6])
def test_a_late_camera(long: Keypoints, rig: CameraRig, late: int) -> None:
    points = long.points.copy()
    points[2] = np.roll(points[2], late, axis=0)
    spoilt = replace(long, points=points)
    assert find_late_cameras(spoilt, rig) == ({"c2": late} if late else {})
    said = find_disagreements(spoilt, rig, RATE)
    assert [f"c2 come about {abs(late)} frames" in text for text in said] == [True] * bool(late)
    mended = shift_cameras(spoilt, {"c2": late}).points[:, 10:-10]
    np.testing.assert_array_equal(mended, long.points[:, 10:-10])


def test_sides_exchanged_in_all_cameras(long: Keypoints, rig: CameraRig) -> None:
    assert not faces_backward(long, rig)
    other = {"l": "r", "r": "l"}
    sides = [other[n[0]] + n[1:] if n[1] == "_" else n for n in long.names]
    columns = [long.names.index(name) for name in sides]
    spoilt = replace(long, points=long.points[:, :, columns])
    (said,) = find_disagreements(spoilt, rig, RATE)
    assert "exchanged in the keypoints of all cameras" in said
    bare = replace(spoilt, points=spoilt.points.copy())
    bare.points[:, :, [name in ("nose", "l_big_toe", "r_big_toe") for name in long.names]] = np.nan
    assert find_disagreements(bare, rig, RATE) == []


@pytest.mark.parametrize("late", [0, 4, -7])
def test_keypoints_late_against_the_silhouettes(long: Keypoints, rig: CameraRig, late: int) -> None:
    spoilt = replace(long, points=np.roll(long.points, late, axis=1))
    assert find_lag_to_footage(spoilt, rig, _views(long, rig)) == late


def _views(long: Keypoints, rig: CameraRig) -> SmallViews:
    """Return boxes around the keypoints, wider by 3 px, as outlines in small pictures."""
    pixels = long.points[..., :2].swapaxes(0, 1) / 2
    lows = np.maximum(pixels.min(2) - 3, 0).astype(int)
    highs = (pixels.max(2) + 3).astype(int)
    masks = np.zeros((FRAMES, len(rig), 120, 160), bool)
    for at in np.ndindex(FRAMES, len(rig)):
        (left, top), (right, bottom) = lows[at], highs[at]
        masks[at][top:bottom, left:right] = True
    outlines = [[extract_outline(mask) for mask in row] for row in masks]
    unknown = np.zeros((FRAMES, len(rig)))
    return SmallViews(
        rig.scaled(0.5), range(FRAMES), outlines, unknown, unknown, unknown, None, np.arange(1),
        np.zeros_like(masks[:1]), None,
    )  # fmt: skip
