"""Positions of keypoints on the body, and the error of the network that finds them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from apf.likelihood.observations import PointObservations


@dataclass(frozen=True, eq=False)
class KeypointModel:
    """Model of P body points among the K keypoints that a network finds in each of V cameras.

    columns: (P,) int, index of each point among the K keypoints. bone: (P,) int, bone of each
    point. position: (P, 3) m in the bone's frame. partner: (P,) int, the same point on the other
    side of the body, -1 on the midline. confidence, error: (B,) ascending confidences, and the
    error of a coordinate there, px; linear in between. factor: (P,) multiplies the error, as some
    points are harder to find. usual: usual number of points in a frame, summed over all cameras; 0
    if unknown.
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
        """Return the error of a coordinate (..., P), px, at confidences (..., P)."""
        return np.interp(confidence, self.confidence, self.error) * self.factor

    def observations(self, keypoints: np.ndarray) -> PointObservations:
        """Convert the keypoints of one frame to observed points of the body.

        keypoints: (V, K, 3) undistorted px and confidence; NaN where missing."""
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
