"""Keypoints in the likelihood. Twin of apf/likelihood/keypoints.py and keypoints.cl."""

from __future__ import annotations

import numpy as np

from apf.body.kinematics import bone_matrices
from apf.body.model import BodyModel
from apf.likelihood.config import EXCHANGE_COST, KeypointConfig
from apf.likelihood.observations import (
    POINT_REACH,
    Observation,
    PointObservations,
    make_empty_observations,
    split_observation,
)
from apf.reference.likelihood.base import NumpyLikelihood
from apf.reference.likelihood.voxel import posture_errors
from apf.scene import Scene
from psfs.cameras.camera import CameraRig


def observed_positions(
    body: BodyModel, poses: np.ndarray, observations: PointObservations
) -> np.ndarray:
    """Return (M, P, 3) m of the body's points in the world, in poses (M, D)."""
    rotations, origins = bone_matrices(body, poses)
    bone = observations.bone
    turned = np.einsum("mpij,pj->mpi", rotations[:, bone], observations.position)
    return origins[:, bone] + turned


def distances(
    rig: CameraRig, points: np.ndarray, which: np.ndarray, observations: PointObservations
) -> np.ndarray:
    """Return (M, N, 2), in deviations, from where they were seen to the points numbered `which`
    (N,) of points (M, P, 3) m; infinite behind the camera."""
    out = np.full((len(points), len(observations), 2), np.inf)
    for view, camera in enumerate(rig):
        rows = observations.camera == view
        seen = points[:, which[rows]] @ camera.R.T + camera.t
        in_front = seen[..., 2:] > 1e-6
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = (seen / seen[..., 2:]) @ camera.K[:2].T
        off = (pixels - observations.pixel[rows]) * observations.inverse_scale[rows, None]
        out[:, rows] = np.where(in_front, off, np.inf)
    return out


def match_points(
    rig: CameraRig, points: np.ndarray, observations: PointObservations, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for every sighting of points (M, P, 3) m its distance (M, N, 2) in deviations, the
    point's number (M, N), and the share d^2 / (d^2 + reach^2) of the distance d (M, N) (Geman &
    McClure 1987): as its own point or, at `EXCHANGE_COST` and the rest's share, as its partner,
    whichever has less."""
    matches = []
    for which in (observations.point, observations.partner):
        off = distances(rig, points, which, observations)
        with np.errstate(invalid="ignore"):
            square = np.sum((off / reach) ** 2, -1)
            matches.append((off, np.where(np.isfinite(square), square / (1 + square), 1.0)))
    (off, share), (other_off, other_share) = matches
    other_share = EXCHANGE_COST + (1 - EXCHANGE_COST) * other_share
    other = (observations.partner >= 0) & (other_share < share)
    point = np.where(other, observations.partner, observations.point)
    return np.where(other[..., None], other_off, off), point, np.where(other, other_share, share)


def missed_shares(
    body: BodyModel, rig: CameraRig, poses: np.ndarray, observations: PointObservations
) -> np.ndarray:
    """Return the shares (M, N) of `match_points` in poses (M, D)."""
    points = observed_positions(body, poses, observations)
    return match_points(rig, points, observations, POINT_REACH)[2]


class NumpyKeypointLikelihood(NumpyLikelihood):
    """The same as `KeypointLikelihood`, in float64."""

    def __init__(
        self,
        scene: Scene,
        config: KeypointConfig,
        posture_prior_weight: float,
        base: NumpyLikelihood | None = None,
    ) -> None:
        self._posture_weight = posture_prior_weight
        self.body, self.rig, self.config, self.base = scene.body, scene.rig, config, base
        self._seen = make_empty_observations()

    @property
    def observed(self) -> tuple[CameraRig, PointObservations] | None:  # type: ignore[override]
        """Points that estimates are refined on; None if the other likelihood does not refine."""
        refines = self.base is None or self.base.points is not None
        return (self.rig, self._seen) if refines else None

    @property
    def points(self) -> np.ndarray | None:  # type: ignore[override]
        """(K, 3) m of the other likelihood."""
        return self.base.points if self.base is not None else None

    @property
    def unit(self) -> float:  # type: ignore[override]
        """Contribution of a term with weight 1 to the errors."""
        return self.base.unit if self.base is not None else float(len(self.rig))

    def observe(self, observation: Observation) -> None:
        shown, points = split_observation(observation)
        if self.base is not None:
            self.base.observe(shown)
        self._seen = points or make_empty_observations()
        self._seen.check(self.body, self.rig)

    def __call__(self, poses: np.ndarray) -> np.ndarray:
        if self.base is None:
            return self._term(poses)
        self.base.turn = self.turn
        return self.base(poses) + self._term(poses)

    def rescore(self, poses: np.ndarray, stride: int, least_recall: float = 0.0) -> np.ndarray:
        if self.base is None:
            return self._term(poses)
        return self.base.rescore(poses, stride, least_recall) + self._term(poses)

    def misfit(self, pose: np.ndarray) -> float:
        """Return the other's misfit of a pose (D,); of the points alone the mean share missed, 1
        where none is seen."""
        if self.base is not None:
            return self.base.misfit(pose)
        shares = self._shares(pose[None])
        return float(shares.mean()) if shares.size else 1.0

    def learn(self, pose: np.ndarray) -> None:
        """Learn from a frame whose estimate is `pose` (D,)."""
        if self.base is not None:
            self.base.learn(pose)

    def forget(self) -> None:
        if self.base is not None:
            self.base.forget()

    def _shares(self, poses: np.ndarray) -> np.ndarray:
        return missed_shares(self.body, self.rig, poses, self._seen)

    def _term(self, poses: np.ndarray) -> np.ndarray:
        most = max(self._seen.most, 1.0)
        errors = self.config.weight * self._shares(poses).sum(1) / most
        if self.base is None:
            errors = errors + self._posture_weight * posture_errors(self.body, poses)
        return self.unit * errors
