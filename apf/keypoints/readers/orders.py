"""The orders in which networks list their keypoints, by name and by number."""

from __future__ import annotations

import numpy as np

from cl import InputError

#: MediaPipe Pose, also BlazePose.
MEDIAPIPE = (
    "nose", "left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye",
    "right_eye_outer", "left_ear", "right_ear", "mouth_left", "mouth_right",
    "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
    "left_pinky", "right_pinky", "left_index", "right_index", "left_thumb", "right_thumb",
    "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    "left_heel", "right_heel", "left_foot_index", "right_foot_index",
)  # fmt: skip
COCO_17 = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear",
    "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
    "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
)  # fmt: skip
#: OpenPose's model of 18, not in COCO's order.
COCO_18 = (
    "Nose", "Neck", "RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist",
    "RHip", "RKnee", "RAnkle", "LHip", "LKnee", "LAnkle", "REye", "LEye", "REar", "LEar",
)  # fmt: skip
BODY_25 = (
    "Nose", "Neck", "RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist", "MidHip",
    "RHip", "RKnee", "RAnkle", "LHip", "LKnee", "LAnkle", "REye", "LEye", "REar", "LEar",
    "LBigToe", "LSmallToe", "LHeel", "RBigToe", "RSmallToe", "RHeel",
)  # fmt: skip
BODY_25B = (
    "Nose", "LEye", "REye", "LEar", "REar", "LShoulder", "RShoulder", "LElbow", "RElbow",
    "LWrist", "RWrist", "LHip", "RHip", "LKnee", "RKnee", "LAnkle", "RAnkle",
    "UpperNeck", "HeadTop", "LBigToe", "LSmallToe", "LHeel", "RBigToe", "RSmallToe", "RHeel",
)  # fmt: skip
HALPE_26 = (
    *COCO_17, "head", "neck", "hip", "left_big_toe", "right_big_toe",
    "left_small_toe", "right_small_toe", "left_heel", "right_heel",
)  # fmt: skip
_WHOLE_BODY = (
    *COCO_17, "left_big_toe", "left_small_toe", "left_heel",
    "right_big_toe", "right_small_toe", "right_heel",
)  # fmt: skip

#: Orders by the number of keypoints; in the longer ones the body comes first, hands and face follow
#: and are dropped.
_BY_COUNT = {
    17: COCO_17,
    18: COCO_18,
    25: BODY_25,
    26: HALPE_26,
    33: MEDIAPIPE,
    75: MEDIAPIPE,  # with hands
    136: HALPE_26,  # Halpe's whole body
    133: _WHOLE_BODY,  # COCO-WholeBody
    543: MEDIAPIPE,  # MediaPipe Holistic, as FreeMoCap writes it: with hands and a face of 468
    553: MEDIAPIPE,  # ... of 478
}
_KNOWN = (
    "17 (COCO), 18 (OpenPose COCO), 25 (BODY_25, BODY_25B), 26 (Halpe), 33 (MediaPipe), "
    "133 (COCO-WholeBody), 136 (Halpe), 543 or 553 (MediaPipe Holistic)"
)


def find_order(where: str, points: np.ndarray) -> tuple[str, ...]:
    """Return the names of the first keypoints of `points` (..., K, 3), by their number.

    Of the two orders of 25, BODY_25B is recognised by its second point, an eye, near the nose.
    Raises InputError, naming `where`, for a number that no network has.
    """
    count = points.shape[-2]
    if count not in _BY_COUNT:
        raise InputError(f"{where}: {count} keypoints without names; expected {_KNOWN}")
    if count == len(BODY_25) and _distance_from_nose(points, 1) < _distance_from_nose(points, 15):
        return BODY_25B
    return _BY_COUNT[count]


def _distance_from_nose(points: np.ndarray, index: int) -> float:
    """Return the median distance, px, of a keypoint from the first; infinite if never seen."""
    away = np.hypot(*np.moveaxis(points[..., index, :2] - points[..., 0, :2], -1, 0))
    away = away[np.isfinite(away)]
    return float(np.median(away)) if away.size else np.inf
