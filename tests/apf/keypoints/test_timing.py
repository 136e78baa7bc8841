"""Late keypoints, and exchanged sides, are found though the keypoints fit each other."""

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


@pytest.fixture(scope="module")
def seen(rig: CameraRig) -> Keypoints:
    """Joints, nose, ears and toes of a walker as four cameras see them, with an error of 1 px."""
    track = tracks.walker(FRAMES)
    joints = dict(zip(track.joint_names, track.joints.swapaxes(0, 1), strict=True))
    across = joints["l_shoulder"] - joints["r_shoulder"]
    forward = np.cross(across, [0.0, 0.0, 1.0]) / np.linalg.norm(across, axis=1, keepdims=True)
    head = joints["head_top"] - [0.0, 0.0, 0.12]
    joints |= {"nose": head + 0.1 * forward}
    for side, sign in (("l", 0.2), ("r", -0.2)):
        joints[f"{side}_ear"] = head + sign * across
        joints[f"{side}_big_toe"] = joints[f"{side}_ankle"] + 0.2 * forward
    places = np.stack(list(joints.values()), axis=1)
    pixels = np.stack([camera.project(places)[0] for camera in rig])
    pixels += np.random.default_rng(4).normal(0, 1, pixels.shape)
    points = np.concatenate([pixels, np.full((*pixels.shape[:3], 1), 0.9)], -1)
    return Keypoints(points, tuple(joints), tuple(rig.names))


@pytest.mark.parametrize("late", [0, 3, -6])
def test_a_late_camera(seen: Keypoints, rig: CameraRig, late: int) -> None:
    points = seen.points.copy()
    points[2] = np.roll(points[2], late, axis=0)
    spoilt = replace(seen, points=points)
    assert find_late_cameras(spoilt, rig) == ({"c2": late} if late else {})
    said = find_disagreements(spoilt, rig, RATE)
    assert [f"c2 come about {abs(late)} frames" in text for text in said] == [True] * bool(late)
    mended = shift_cameras(spoilt, {"c2": late}).points[:, 10:-10]
    np.testing.assert_array_equal(mended, seen.points[:, 10:-10])


def test_sides_exchanged_in_all_cameras(seen: Keypoints, rig: CameraRig) -> None:
    assert not faces_backward(seen, rig)
    other = {"l": "r", "r": "l"}
    sides = [other[n[0]] + n[1:] if n[1] == "_" else n for n in seen.names]
    columns = [seen.names.index(name) for name in sides]
    spoilt = replace(seen, points=seen.points[:, :, columns])
    (said,) = find_disagreements(spoilt, rig, RATE)
    assert "exchanged in the keypoints of all cameras" in said
    faceless = [
        k for k, name in enumerate(seen.names) if name not in ("nose", "l_big_toe", "r_big_toe")
    ]
    names = tuple(seen.names[k] for k in faceless)
    bare = replace(spoilt, points=spoilt.points[:, :, faceless], names=names)
    assert find_disagreements(bare, rig, RATE) == []


@pytest.mark.parametrize("late", [0, 4, -7])
def test_keypoints_late_against_the_silhouettes(seen: Keypoints, rig: CameraRig, late: int) -> None:
    spoilt = replace(seen, points=np.roll(seen.points, late, axis=1))
    assert find_lag_to_footage(spoilt, rig, _views(seen, rig)) == late


def _views(seen: Keypoints, rig: CameraRig) -> SmallViews:
    """Return boxes around the keypoints, wider by 3 px, as outlines in small pictures."""
    small, outlines = rig.scaled(0.5), []
    for frame in range(FRAMES):
        row = []
        for view in range(len(rig)):
            mask = np.zeros((120, 160), bool)
            low, high = (of(seen.points[view, frame, :, :2] / 2, axis=0) for of in (np.min, np.max))
            (left, top), (right, bottom) = (
                np.maximum(low - 3, 0).astype(int),
                (high + 3).astype(int),
            )
            mask[top:bottom, left:right] = True
            row.append(extract_outline(mask))
        outlines.append(row)
    unknown = np.zeros((FRAMES, len(rig)))
    masks = np.zeros((1, len(rig), 120, 160), bool)
    return SmallViews(
        small, range(FRAMES), outlines, unknown, unknown, unknown, None, np.arange(1), masks, None
    )
