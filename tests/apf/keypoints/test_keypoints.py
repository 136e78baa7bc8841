"""Keypoints of npz and arrays: shapes, cameras, frames, distortion, and bad ones."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from helpers import footage, scenes
from helpers.keypoints import of_poses

import apf
import psfs
from apf.body.toml import load_body
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.readers.orders import BODY_25B, COCO_17, HALPE_26, MEDIAPIPE

RIG = footage.rig(3)
NAMES = tuple(RIG.names)


def keypoints(frames: int = 4, names: tuple[str, ...] = MEDIAPIPE) -> Keypoints:
    body = load_body("song31")
    poses = np.tile(body.rest_pose, (frames, 1))
    poses[:, 0] += np.linspace(0, 0.3, frames)
    return of_poses(RIG, body, poses, names)


def save(path: Path, points: np.ndarray, **names: object) -> Path:
    np.savez(path, keypoints=points, **names)
    return path


def save_each(folder: Path, views: Iterable[np.ndarray]) -> Path:
    """Write an array of each camera into a new folder."""
    (folder / "each").mkdir()
    for camera, view in zip(NAMES, views, strict=True):
        np.save(folder / "each" / f"{camera}_points.npy", view)
    return folder / "each"


def same(a: Keypoints, b: Keypoints, atol: float = 0) -> None:
    assert (a.names, a.camera_names) == (b.names, b.camera_names)
    np.testing.assert_allclose(a.points, b.points, rtol=0, atol=atol)


def test_npz_reads_back_and_cameras_are_found_by_name(tmp_path: Path) -> None:
    written = keypoints()
    path = save(
        tmp_path / "keypoints.npz", written.points[::-1],
        keypoint_names=MEDIAPIPE, camera_names=["Cam_3", "Cam_2", "Cam_1"],
    )  # fmt: skip
    read = Keypoints.open(path, RIG)
    same(read, written)
    assert read.points.dtype == np.float32 and read.notes == ()
    same(Keypoints.open(tmp_path, RIG), written)  # the folder that holds it
    assert Keypoints.open(path).camera_names == ("Cam_3", "Cam_2", "Cam_1")
    two = Keypoints.open(path, NAMES[:2])  # others are left out
    np.testing.assert_array_equal(two.points, written.points[:2])
    last = written.select_cameras(NAMES[2:])
    same(read.select_cameras(NAMES[1:]).select_cameras(NAMES[2:]), last)


def test_cameras_without_names_or_keypoints_are_noted(tmp_path: Path) -> None:
    written = keypoints()
    read = Keypoints.open(save(tmp_path / "a.npz", written.points), RIG)
    same(read, written)
    assert "in order: 1 for cam01, 2 for cam02, 3 for cam03" in read.notes[0]
    named = save(tmp_path / "b.npz", written.points, camera_names=["x", "y", "z"])
    assert "x for cam01" in Keypoints.open(named, RIG).notes[0]
    path = save(tmp_path / "a.npz", written.points[1:], camera_names=NAMES[1:])
    read = Keypoints.open(path, RIG)
    assert np.isnan(read.points[0]).all() and "no keypoints of camera cam01" in read.notes[0]
    np.testing.assert_array_equal(read.points[1:], written.points[1:])


def test_missing_points_are_nan_throughout() -> None:
    points = keypoints().points.copy()
    points[0, 0, 0, 0] = np.nan
    points[0, 0, 1, 2] = 0  # as OpenPose writes what it has not found
    points[0, 0, 2, 2] = 1.2
    made = Keypoints(points, MEDIAPIPE, NAMES)
    assert np.isnan(made.points[0, 0, :2]).all() and made.points[0, 0, 2, 2] == 1
    assert np.isfinite(made.points[0, 0, 3:]).all()


@pytest.mark.parametrize(
    ("count", "names"),
    [(33, MEDIAPIPE), (17, COCO_17), (26, HALPE_26), (25, BODY_25B), (553, MEDIAPIPE)],
)
def test_arrays_are_known_by_their_size(tmp_path: Path, count: int, names: tuple[str, ...]) -> None:
    written = keypoints(names=names)
    points = np.full((3, 4, count, 3), 5.0)  # hands and face, somewhere
    points[:, :, : len(names)] = written.points
    np.save(tmp_path / "all.npy", points)
    same(Keypoints.open(tmp_path / "all.npy", RIG), written)
    same(Keypoints.open(save_each(tmp_path, points), RIG), written)


def test_freemocaps_third_number_is_no_confidence(tmp_path: Path) -> None:
    written = keypoints()
    raw = tmp_path / "session" / "output_data" / "raw_data"
    raw.mkdir(parents=True)
    points = np.full((3, 4, 553, 3), 7.0)
    points[:, :, :33, :2] = written.points[..., :2]
    points[0, 0, 3] = np.nan
    np.save(raw / "mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy", points)
    np.save(raw / "mediapipe_3dData_numFrames_numTrackedPoints_spatialXYZ.npy", points[0])
    read = Keypoints.open(tmp_path / "session", RIG)
    np.testing.assert_array_equal(read.points[..., :2][1:], written.points[..., :2][1:])
    assert (read.points[1:, ..., 2] == 1).all() and np.isnan(read.points[0, 0, 3]).all()


def test_shares_of_the_picture_become_pixels(tmp_path: Path) -> None:
    written = keypoints()
    shares = written.points.astype(float)
    shares[..., :2] = (shares[..., :2] + 0.5) / footage.SIZE
    np.save(tmp_path / "shares.npy", shares)
    read = Keypoints.open(tmp_path / "shares.npy", RIG)
    same(read, written, atol=1e-4)
    assert "shares of the picture" in read.notes[-1]
    with pytest.raises(apf.InputError, match="cameras with known picture sizes"):
        Keypoints.open(tmp_path / "shares.npy", NAMES)


def test_frames_are_the_sequences(tmp_path: Path) -> None:
    sequence = psfs.open_sequence(footage.native(tmp_path / "walk", frames=4))
    path = tmp_path / "keypoints.npz"
    save(path, keypoints(4).points, camera_names=NAMES)
    assert Keypoints.open(path, sequence).n_frames == 4
    for frames in (3, 5):
        save(path, keypoints(frames).points, camera_names=NAMES)
        with pytest.raises(apf.InputError, match=rf"cam01 {frames} \(its video 4\).*expected 4"):
            Keypoints.open(path, sequence)
    footage.write_video(tmp_path / "walk" / "videos" / "cam02.mp4", [20] * 6)
    folder = save_each(tmp_path, [keypoints(n).points[view] for view, n in enumerate((4, 6, 4))])
    found = Keypoints.open(folder, psfs.open_sequence(tmp_path / "walk"))
    assert found.points.shape == (3, 4, 33, 3)
    with pytest.raises(apf.InputError, match=r"differ: cam01 4, cam02 6, cam03 4"):
        Keypoints.open(folder, RIG)


def test_undistorted_points_are_those_of_the_lens_without_distortion() -> None:
    rig = scenes.ring(3, size=(640, 480))
    body = load_body("song31")
    poses = body.rest_pose[None]
    seen = of_poses(rig, body, poses)
    straight = of_poses(scenes.without_distortion(rig), body, poses)
    found = seen.undistort(rig)
    np.testing.assert_allclose(found.points[..., :2], straight.points[..., :2], atol=2e-3)
    assert np.abs(found.points - seen.points)[..., :2].max() > 1
    far = seen.points.copy()
    far[0, 0, 0, :2] = 1e5  # no lens shows it
    lost = Keypoints(far, seen.names, seen.camera_names).undistort(rig)
    assert np.isnan(lost.points[0, 0, 0]).all() and np.isfinite(lost.points[0, 0, 1]).all()
    with pytest.raises(apf.InputError, match="expected those of the keypoints, c0, c1, c2"):
        seen.undistort(rig.subset(["c1", "c0", "c2"]))
