"""Estimate a person's body, poses and points on the body from the keypoints of many frames."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from apf.body.model import BodyModel
from apf.body.schema import TALLEST
from apf.body.stature import stature
from apf.initialisation.body_fit import Fitted, PointEvidence, fit_body
from apf.initialisation.from_joints import stand_at_points
from apf.initialisation.shape_model import ShapeModel
from apf.initialisation.start import StartError
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import BodyPoints, locate_points
from apf.likelihood.observations import KeypointModel, PointObservations
from psfs.cameras.camera import CameraRig
from psfs.cameras.triangulation import TriangulationConfig, triangulate
from psfs.common.numbers import pick_evenly

#: Frames to which body and points are fitted, evenly spread, and points that each must show.
_FRAMES, _LEAST_POINTS = 40, 6
#: Initial and least error of a keypoint, as shares of the pictures' height: 8 and 1 px of 480.
_ERROR, _LEAST_ERROR = 1 / 60, 1 / 480
#: Reprojection error, in initial errors, from which on a camera is excluded from a point.
_OUTLIER = 2.5
#: Levels of confidence for which the error is estimated, each with as many keypoints.
_LEVELS = 5
#: Steps from the rest pose to the triangulated points.
_STEPS = 40


@dataclass(frozen=True, eq=False)
class KeypointStart:
    """Body, poses and points of a person, fitted to keypoints.

    body: the template in the person's lengths. frames: (M,) that were fitted. poses: (M, D).
    anchor: the first of them with about the usual number of keypoints and about the usual error.
    model: positions of the keypoints on the body, and their errors. keypoints: of all frames,
    undistorted.
    """

    body: BodyModel
    frames: np.ndarray
    poses: np.ndarray
    anchor: int
    model: KeypointModel
    keypoints: Keypoints

    def observations(self, frame: int) -> PointObservations:
        """Return the observed points of a frame."""
        return self.model.observations(self.keypoints.points[:, frame])

    @property
    def anchored(self) -> tuple[int, np.ndarray]:
        """The anchor's frame number and pose (D,)."""
        return int(self.frames[self.anchor]), self.poses[self.anchor]


def start_from_keypoints(
    rig: CameraRig,
    keypoints: Keypoints,
    template: BodyModel,
    frames: range,
    *,
    height: float | None = None,
    keep_shape: bool = False,
) -> KeypointStart:
    """Fit a person's body, poses and points on it to the `keypoints` of `frames`.

    The first frame with enough keypoints is among those that are fitted. height: known stature, m.
    keep_shape: the template is the person's own body. Raises StartError if too few points can be
    triangulated.
    """
    keypoints = keypoints.undistort(rig)
    points = locate_points(template, keypoints.names)
    seen = keypoints.points[:, frames][:, :, points.columns].astype(np.float64)
    error = _ERROR * rig.height
    places = _triangulate(rig, seen)
    enough = np.flatnonzero(np.isfinite(places).all(-1).sum(1) >= _LEAST_POINTS)
    if not enough.size:
        raise StartError(
            f"no frame has {_LEAST_POINTS} keypoints that two cameras see at one place; "
            "expected a person there, and the cameras' calibration to be that of the keypoints"
        )
    chosen = enough[pick_evenly(len(enough), _FRAMES)]
    seen, places = seen[:, chosen], places[chosen]
    seen = correct_swapped_sides(rig, seen, places, points, _OUTLIER * error)
    known = np.isfinite(seen).all(-1) & (np.nan_to_num(seen[..., 2]) > 0)
    confidence = np.nan_to_num(seen[..., 2])
    # without an error model, a low confidence counts as a large error
    first = error / np.sqrt(np.maximum(confidence, 1e-3))
    evidence = PointEvidence(
        points.bones, points.offsets, points.partners, points.spreads, places, rig=rig,
        errors=np.where(known, first, np.inf),
    )  # fmt: skip
    model = ShapeModel(template)
    free = model.moves_points & (not keep_shape)
    fit = stand_at_points(model, evidence, scaled=not keep_shape)
    fit = fit_body(model, evidence, fit, free=free & False, steps=_STEPS)
    evidence = replace(evidence, pixels=np.nan_to_num(seen[..., :2]))
    height = None if keep_shape else height
    for _ in range(2):  # the second time with the errors that the first fit shows
        fit = fit_body(model, evidence, fit, free=free, height=height)
        keypoint_model = _calibrate_errors(model, evidence, fit, confidence, points)
        errors = np.where(known, keypoint_model.scale(confidence), np.inf)
        evidence = replace(evidence, errors=errors)
    body = model.body(fit.shape)
    if (tall := stature(body)) > TALLEST:
        raise StartError(
            f"the keypoints show somebody {tall:.3g} m high; expected at most {TALLEST:g} m: in "
            f"what unit is the calibration? State it as --unit; about {1.7 / tall:.2g} times what "
            "it is now would fit"
        )
    return KeypointStart(
        body, np.array(frames)[chosen], fit.poses,
        _choose_anchor(model, evidence, fit), keypoint_model, keypoints,
    )  # fmt: skip


def fit_pose_to_points(
    body: BodyModel, rig: CameraRig, observations: PointObservations
) -> np.ndarray | None:
    """Return the pose (D,) of `body` that best fits the points observed in one frame, without an
    initial pose; None if too few can be triangulated."""
    n_points = len(observations.bone)
    seen = np.full((len(rig), 1, n_points, 3), np.nan)
    errors = np.full(seen.shape[:3], np.inf)
    where = observations.camera, 0, observations.point
    seen[where] = np.column_stack([observations.pixel, np.ones(len(observations))])
    errors[where] = 1 / np.maximum(observations.inverse_scale, 1e-9)
    places = _triangulate(rig, seen)
    if np.isfinite(places).all(-1).sum() < _LEAST_POINTS:
        return None
    model, held = ShapeModel(body), np.arange(n_points)
    evidence = PointEvidence(
        observations.bone, observations.position, held, np.full(n_points, 1e-3), places, rig=rig,
        errors=errors,
    )  # fmt: skip
    fit, free = stand_at_points(model, evidence, scaled=False), np.zeros(len(model.deviation), bool)
    fit = fit_body(model, evidence, fit, free=free, steps=_STEPS)
    evidence = replace(evidence, pixels=np.nan_to_num(seen[..., :2]))
    return fit_body(model, evidence, fit, free=free).poses[0]


def _triangulate(rig: CameraRig, seen: np.ndarray) -> np.ndarray:
    """Return the places (M, P, 3) m of keypoints (V, M, P, 3)."""
    farthest = _OUTLIER * _ERROR * rig.height
    return triangulate(rig, seen, TriangulationConfig(max_error=farthest)).points


def correct_swapped_sides(
    rig: CameraRig, seen: np.ndarray, found: np.ndarray, points: BodyPoints, near: float
) -> np.ndarray:
    """Return keypoints (V, M, P, 3) with exchanged left and right corrected.

    A pair counts as exchanged if both lie within `near` px of each other's triangulated point (M,
    P, 3) and farther from their own.
    """
    other = points.partners
    off = np.full((2, *seen.shape[:3]), np.inf)
    for view, camera in enumerate(rig):
        local = found @ camera.R.T + camera.t
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = np.where(local[..., 2:] > 0, (local / local[..., 2:]) @ camera.K[:2].T, np.inf)
            for kind, which in enumerate((np.arange(len(other)), other)):
                off[kind, view] = np.linalg.norm(pixels[:, which] - seen[view, ..., :2], axis=-1)
    with np.errstate(invalid="ignore"):
        wrong = (off[1] < near) & (off[1] < 0.5 * off[0])
    swapped = (wrong & wrong[:, :, other])[..., None]
    return np.where(swapped, seen[:, :, other], seen)


def _choose_anchor(model: ShapeModel, evidence: PointEvidence, fit: Fitted) -> int:
    """Return the first frame with at least three quarters of the usual number of keypoints whose
    pose misses no more of them than usual."""
    lengths, missed = evidence.missed_shares(model, fit)
    count = np.isfinite(lengths).sum((0, 2))
    sound = (count >= 0.75 * np.median(count)) & (missed <= np.median(missed))
    return int(np.argmax(sound)) if sound.any() else int(np.argmin(missed))


def _calibrate_errors(
    model: ShapeModel,
    evidence: PointEvidence,
    fit: Fitted,
    confidence: np.ndarray,
    points: BodyPoints,
) -> KeypointModel:
    """Return the model of the keypoints whose errors by confidence (V, M, P) and point are those
    of a fit."""
    off, _ = evidence.missed_shares(model, fit)
    off /= np.sqrt(scipy.special.chdtri(2, 0.5))  # the median length for errors of 1
    known = np.isfinite(off)
    # The fit uses up three coordinates of each point.
    n_views = np.maximum(known.sum(0), 2)
    off *= np.sqrt(2 * n_views / np.maximum(2 * n_views - 3, 1))
    order = np.argsort(confidence[known])
    parts = np.array_split(order, min(_LEVELS, len(order)))
    levels = np.array([np.median(confidence[known][part]) for part in parts])
    errors = np.array([np.median(off[known][part]) for part in parts])
    # the error must not rise with the confidence
    errors = np.maximum.accumulate(errors[::-1])[::-1]
    errors = np.maximum(errors, _LEAST_ERROR * evidence.rig.height if evidence.rig else 0.0)
    ratio = off / np.interp(confidence, levels, errors)
    factor = np.array([np.median(of[k]) if k.any() else 1.0
                       for of, k in zip(np.moveaxis(ratio, -1, 0), np.moveaxis(known, -1, 0),
                                        strict=True)])  # fmt: skip
    return KeypointModel(
        columns=points.columns,
        bone=points.bones,
        position=evidence.positions(model, fit),
        partner=np.where(points.partners == np.arange(len(points)), -1, points.partners),
        confidence=levels,
        error=errors,
        factor=np.clip(factor, 0.3, 4.0),
        usual=float(np.median(known.sum((0, 2)))),
    )
