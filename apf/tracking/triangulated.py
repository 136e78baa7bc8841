"""A track from keypoints alone, the usual way today: triangulated, gaps filled, low-pass filtered.

It is the baseline for tracking with body model, voxels and motion.
"""

from __future__ import annotations

import json
from importlib.metadata import version

import numpy as np

from apf.keypoints.keypoints import Keypoints, triangulate
from apf.keypoints.landmarks import find_landmarks, landmark_edges
from apf.keypoints.series import fill_gaps, low_pass
from apf.tracking.config import TriangulatedConfig
from apf.tracking.track import Track
from cl import InputError
from psfs.cameras.names import join_names
from psfs.cameras.triangulation import TriangulationConfig
from psfs.sequence import Sequence

#: The body name of such a track.
BODY_NAME = "triangulated"


def triangulate_track(
    sequence: Sequence,
    keypoints: Keypoints,
    config: TriangulatedConfig | None = None,
    selection: slice | None = None,
) -> Track:
    """Triangulate the landmarks of `keypoints` in the selected frames of `sequence`.

    The keypoints have the cameras and frames of the sequence. A point that cannot be triangulated
    or interpolated is NaN. The diagnostics are reprojection_error (F, J) px and cameras_used (F,
    J). Raises InputError if no keypoint is a landmark or if no point is seen twice.
    """
    config = config or TriangulatedConfig()
    frames = np.arange(keypoints.n_frames)[selection or slice(None)]
    landmarks = find_landmarks(keypoints.names)
    if not landmarks:
        raise InputError(
            f"none of the keypoints {join_names(keypoints.names)} is a point on the body; expected "
            "names such as left_shoulder or LShoulder"
        )
    straight = keypoints.undistort(sequence.rig).points[:, frames][:, :, list(landmarks)]
    joints = triangulate(sequence.rig, straight, config.triangulation)
    if not np.isfinite(joints.points).any():
        raise _no_points(sequence.name, straight[..., 2], config.triangulation)
    rate = sequence.fps / (abs(selection.step or 1) if selection else 1)
    longest = config.longest_gap
    points = fill_gaps(joints.points, None if longest is None else round(longest * rate))
    if config.low_pass:
        points = low_pass(points, rate, config.low_pass)
    names = tuple(landmark.name for landmark in landmarks.values())
    return Track(
        body_name=BODY_NAME,
        dof_names=(),
        joint_names=names,
        fps=sequence.fps,
        frames=frames,
        poses=np.zeros((len(frames), 0)),
        joints=points,
        edges=np.array(landmark_edges(names)),
        diagnostics={
            "reprojection_error": joints.errors,
            "cameras_used": joints.used.sum(0),
        },
        provenance=json.dumps(
            {
                "sequence": str(sequence.folder),
                "version": version("psfs-apf"),
                "method": "triangulate",
                "triangulated": config.to_dict(),
            }
        ),
    )


def _no_points(name: str, confidence: np.ndarray, limits: TriangulationConfig) -> InputError:
    """Return the error of a sequence without a point; confidence: of its keypoints (V, ...)."""
    sure = np.nan_to_num(confidence) >= limits.min_confidence
    several = (sure.sum(0) >= limits.min_cameras).sum()
    return InputError(
        f"no keypoint of {name} is seen by {limits.min_cameras} cameras that agree within "
        f"{limits.max_error:g} px; {several} of {sure[0].size} are seen by so many with a "
        f"confidence of {limits.min_confidence:g}"
    )
