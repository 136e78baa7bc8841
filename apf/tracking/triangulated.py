"""A track from keypoints alone, the usual way today: triangulated, gaps filled, low-pass filtered.

It is the baseline for tracking with body model, voxels and motion.
"""

from __future__ import annotations

import json
from importlib.metadata import version

import numpy as np

from apf.keypoints.keypoints import Keypoints, triangulate
from apf.keypoints.landmarks import find_landmarks, landmark_edges
from apf.tracking.config import TriangulatedConfig
from apf.tracking.track import Track
from cl import InputError
from psfs.cameras.names import join_names
from psfs.cameras.triangulation import TriangulationConfig
from psfs.common.numbers import find_true_runs
from psfs.sequence import Sequence

#: Order of the filter; running forwards and backwards doubles it.
_ORDER = 2


def fill_gaps(points: np.ndarray, longest: int | None = None) -> np.ndarray:
    """Fill gaps (NaN) of points (F, K, 3) by linear interpolation, at the ends with the nearest
    point.

    longest: longest gap to fill, frames; None: all. Points that are never known stay NaN.
    """
    filled, frames = points.copy(), np.arange(len(points))
    for k in range(points.shape[1]):
        known = np.all(np.isfinite(points[:, k]), axis=-1)
        for gap in find_true_runs(~known) if known.any() else ():
            if longest is None or gap.stop - gap.start <= longest:
                axes = [np.interp(frames[gap], frames[known], axis) for axis in points[known, k].T]
                filled[gap, k] = np.stack(axes, -1)
    return filled


def low_pass(points: np.ndarray, rate: float, cutoff: float) -> np.ndarray:
    """Smooth points (F, K, 3) at `rate` per second with a low-pass filter at `cutoff` Hz.

    A Butterworth filter of order 2, forwards and backwards (order 4 in effect, no delay; half of
    the amplitude is left at the cut-off). Stretches between gaps are filtered separately; those too
    short for the filter are unchanged. Raises InputError.
    """
    if not 0 < cutoff < rate / 2:
        raise InputError(
            f"the low-pass is at {cutoff:g} Hz; expected between 0 and {rate / 2:g}, half of the "
            "frame rate"
        )
    from scipy.signal import butter, sosfiltfilt  # takes a while to load

    sections = butter(_ORDER, cutoff, fs=rate, output="sos")
    shortest = 3 * (2 * len(sections) + 1)  # SciPy's own padding
    out = points.copy()
    for k in range(points.shape[1]):
        for run in find_true_runs(np.all(np.isfinite(points[:, k]), axis=-1)):
            piece = points[run, k]
            if len(piece) > shortest:
                # Padded by all of itself: the filter has settled then.
                out[run, k] = sosfiltfilt(sections, piece, axis=0, padlen=len(piece) - 1)
    return out


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
