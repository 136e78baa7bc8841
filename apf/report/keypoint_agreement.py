"""Measure the agreement of a track's poses with the keypoints of their frames."""

from __future__ import annotations

import numpy as np

from apf.body.kinematics import bone_matrices
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import locate_points
from apf.tracking.track import Track
from psfs.cameras.camera import CameraRig

#: Distance, m, at the point's depth beyond which the body does not explain a keypoint; the points
#: of people differ by less from their prior position on the body.
_FAR = 0.15
#: Least confidence of keypoints that count.
_CONFIDENCE = 0.3


def measure_keypoint_agreement(track: Track, keypoints: Keypoints, rig: CameraRig) -> np.ndarray:
    """Return the share (F,) of the keypoints that lie near their point on the body; NaN in frames
    without keypoints.

    keypoints: of the cameras of `rig` and all frames of the sequence.
    """
    points = locate_points(track.its_body, keypoints.names)
    rotations, origins = bone_matrices(track.its_body, track.poses)
    offsets = np.einsum("spij,pj->spi", rotations[:, points.bones], points.offsets)
    places = origins[:, points.bones] + offsets
    near, known = np.zeros(len(track)), np.zeros(len(track))
    for camera, seen in zip(rig, keypoints.points, strict=True):
        shown = seen[track.frames][:, points.columns].astype(np.float64)
        pixels = shown[..., :2].reshape(-1, 2)
        if camera.lens.any():
            pixels = camera.undistort(pixels)
        local = places @ camera.R.T + camera.t
        with np.errstate(divide="ignore", invalid="ignore"):
            expected = (local @ camera.K.T)[..., :2] / local[..., 2:]
            off = np.linalg.norm(expected - pixels.reshape(expected.shape), axis=-1)
            apart = off * local[..., 2] / camera.K[0, 0]
        sure = (np.nan_to_num(shown[..., 2]) >= _CONFIDENCE) & np.isfinite(off)
        near += (sure & (apart <= _FAR) & (local[..., 2] > 0)).sum(axis=1)
        known += sure.sum(axis=1)
    with np.errstate(invalid="ignore"):
        shares: np.ndarray = near / known
    return shares
