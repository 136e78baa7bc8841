"""Where a person's keypoints lie on the body, and how far a network errs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from apf.likelihood.observations import PointObservations


@dataclass(frozen=True, eq=False)
class KeypointModel:
    """What keypoints, K in each of V cameras, say of a body: P of them are points on it.

    columns: (P,) int, their numbers among the K. bone: (P,) int, that each is on. position: (P, 3)
    m in its frame. partner: (P,) int, the same point of the other side, -1 in the middle.
    confidence, error: (B,) ascending confidences, and px by which a coordinate errs there; between
    them it is interpolated. factor: (P,) of that, some points are harder than others. usual: how
    many of them all cameras see in a frame together; 0 where that is not known.
    """

    columns: np.ndarray
    bone: np.ndarray
    position: np.ndarray
    partner: np.ndarray
    confidence: np.ndarray
    error: np.ndarray
    factor: np.ndarray
    usual: float = 0.0

    def scale(self, confidence: np.ndarray) -> np.ndarray:
        """Return (..., P) px by which a coordinate errs at these confidences (..., P)."""
        error: np.ndarray = np.interp(confidence, self.confidence, self.error) * self.factor
        return error

    def observations(self, keypoints: np.ndarray) -> PointObservations:
        """Return what keypoints (V, K, 3) of one frame, undistorted px and confidence, NaN where
        missing, say of the body."""
        seen = np.asarray(keypoints, np.float64)[:, self.columns]
        camera, point = np.nonzero(np.isfinite(seen).all(-1) & (seen[..., 2] > 0))
        scale = self.scale(np.nan_to_num(seen[..., 2]))
        return PointObservations(
            bone=self.bone,
            position=self.position,
            point=point,
            partner=self.partner[point],
            camera=camera,
            pixel=seen[camera, point, :2],
            inverse_scale=1 / scale[camera, point],
            most=seen.shape[0] * seen.shape[1],
            usual=self.usual,
        )
