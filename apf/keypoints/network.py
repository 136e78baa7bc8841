"""MediaPipe Pose, a network whose package contains its model: the extra `keypoints`.

The last releases with a model are 0.10.x up to 0.10.21 (`mediapipe.solutions.pose`,
`pose_landmark_full.tflite`); later ones expect a model file from the user.
"""

from __future__ import annotations

import importlib
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from typing import Any

import numpy as np

from cl import InputError
from cl.errors import pip_command

_EXTRA = pip_command("keypoints")


def check_network() -> None:
    """Raise InputError unless MediaPipe is installed with its model."""
    if find_spec("mediapipe") is None:
        raise InputError(
            f"keypoints are made by MediaPipe, which is not installed: {_EXTRA}; keypoints of any "
            "other network are read as they are"
        )
    try:
        importlib.import_module("mediapipe.python.solutions.pose")
    except ImportError as error:
        raise InputError(
            f"MediaPipe {_version()} carries no pose model ({error}); expected one of 0.10.9 to "
            f"0.10.21: {_EXTRA}"
        ) from None


def _version() -> str:
    try:
        return version("mediapipe")
    except PackageNotFoundError:
        return "of unknown version"


class PoseNetwork:
    """Detector that follows one person through the pictures of a video."""

    def __init__(self) -> None:
        pose = importlib.import_module("mediapipe.python.solutions.pose")
        self._pose: Any = pose.Pose(static_image_mode=False, model_complexity=1)

    def __call__(self, picture: np.ndarray) -> np.ndarray | None:
        """Return the keypoints (33, 3), px and visibility 0..1, in a picture (h, w, 3) uint8 BGR.

        None if it finds nobody.
        """
        rgb = np.ascontiguousarray(picture[..., ::-1])
        joints = self._pose.process(rgb).pose_landmarks
        if joints is None:
            return None
        height, width = picture.shape[:2]
        points = np.array([(p.x, p.y, p.visibility) for p in joints.landmark])
        points[:, :2] = points[:, :2] * (width, height) - 0.5  # pixel centres are at integers
        points[:, 2] = points[:, 2].clip(0, 1)
        return points

    def forget(self) -> None:
        """Forget the person, and detect one again in the next picture."""
        self._pose.reset()

    def close(self) -> None:
        """Release the network."""
        self._pose.close()
