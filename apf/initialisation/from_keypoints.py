"""Estimate a person's body, poses and points on the body from the keypoints of many frames."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from apf.body.model import BodyModel
from apf.body.stature import stature
from apf.initialisation.fit_config import KeypointStartConfig
from apf.initialisation.point_fit import PointFit, PointFitter, PointViews
from apf.initialisation.start import StartError
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import BodyPoints, locate_points
from apf.likelihood.observations import KeypointModel, PointObservations
from psfs.cameras.camera import CameraRig
from psfs.cameras.triangulation import TriangulationConfig, triangulate
from psfs.common.numbers import pick_evenly

#: Median length of a 2-D vector with independent standard normal coordinates (Rayleigh).
_RAYLEIGH = 1.1774


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
    config: KeypointStartConfig | None = None,
) -> KeypointStart:
    """Fit a person's body, poses and points on it to the `keypoints` of `frames`.

    The first frame with enough keypoints is among those that are fitted. height: known stature, m.
    keep_shape: the template is the person's own body. Raises StartError if too few points can be
    triangulated.
    """
    config = config or KeypointStartConfig()
    keypoints = keypoints.undistort(rig)
    points = locate_points(template, keypoints.names)
    seen = keypoints.points[:, frames][:, :, points.columns].astype(np.float64)
    pixel = rig.height / 480
    found = triangulate(rig, seen, TriangulationConfig(max_error=config.outlier * pixel)).points
    enough = np.flatnonzero(np.isfinite(found).all(-1).sum(1) >= config.least_points)
    if not enough.size:
        raise StartError(
            f"no frame has {config.least_points} keypoints that two cameras see at one place; "
            "expected a person there, and the cameras' calibration to be that of the keypoints"
        )
    chosen = enough[pick_evenly(len(enough), config.n_frames)]
    seen, found = seen[:, chosen], found[chosen]
    seen = correct_swapped_sides(rig, seen, found, points, config.outlier * pixel)
    views = _make_views(seen, found, points, config.error * pixel)
    fitter = PointFitter(template, rig, views, config.fit, keep_shape)
    fit = fitter.refine(fitter.start_fit())
    views, model = _calibrate_errors(fitter, fit, seen, points, config, pixel)
    fitter = PointFitter(template, rig, views, config.fit, keep_shape)
    fit = fitter.refine(fitter.refit_suspect_frames(fit))
    if height is not None and not keep_shape:
        fit, fitter = _scale_to_height(fitter, fit, height, rig)
    views, model = _calibrate_errors(fitter, fit, seen, points, config, pixel)
    body = fitter.body(fit.log_lengths)
    return KeypointStart(
        body, np.array(frames)[chosen], fit.poses, _choose_anchor(fitter, fit), model, keypoints
    )


def fit_pose_to_points(
    body: BodyModel,
    rig: CameraRig,
    observations: PointObservations,
    config: KeypointStartConfig | None = None,
) -> np.ndarray | None:
    """Return the pose (D,) of `body` that best fits the points observed in one frame, without an
    initial pose; None if too few can be triangulated."""
    config = config or KeypointStartConfig()
    n_points, own = len(observations.bone), np.arange(len(observations.bone))
    seen = np.full((len(rig), 1, n_points, 3), np.nan)
    inverse = np.zeros(seen.shape[:3])
    where = observations.camera, 0, observations.point
    seen[where] = np.column_stack([observations.pixel, np.ones(len(observations))])
    inverse[where] = observations.inverse_scale
    partner = own.copy()
    partner[observations.point] = np.where(
        observations.partner >= 0, observations.partner, observations.point
    )
    outlier = config.outlier * rig.height / 480
    found = triangulate(rig, seen, TriangulationConfig(max_error=outlier)).points
    if np.isfinite(found).all(-1).sum() < config.least_points:
        return None
    views = PointViews(
        observations.bone, observations.position, np.full(n_points, 1e-3), partner,
        np.nan_to_num(seen[..., :2]), inverse, found,
    )  # fmt: skip
    fitter = PointFitter(body, rig, views, config.fit, keep_shape=True)
    near = fitter.start_fit()
    tried = [
        fitter.refine(fitter.fit_to_triangulated(replace(near, poses=poses)), poses_alone=True)
        for poses in (near.poses, fitter.turn_around(near.poses))
    ]
    return min(tried, key=lambda fit: float(fitter.missed_share(fit)[0])).poses[0]


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


def _choose_anchor(fitter: PointFitter, fit: PointFit) -> int:
    """Return the first frame with at least three quarters of the usual number of keypoints and
    about the usual error."""
    missed, seen = fitter.missed_share(fit), (fitter.views.inverse_scale > 0).sum((0, 2))
    sound = missed <= fitter.config.suspect * np.median(missed)
    sound &= seen >= 0.75 * np.median(seen)
    return int(np.argmax(sound)) if sound.any() else int(np.argmin(missed))


def _make_views(
    seen: np.ndarray, found: np.ndarray, points: BodyPoints, error: float | np.ndarray
) -> PointViews:
    known = np.isfinite(seen).all(-1) & (np.nan_to_num(seen[..., 2]) > 0)
    if np.ndim(error) == 0:  # without an error model, a low confidence counts as a large error
        error = error / np.sqrt(np.maximum(np.nan_to_num(seen[..., 2]), 1e-3))
    return PointViews(
        bone=points.bones,
        position=points.offsets,
        spread=points.spreads,
        partner=points.partners,
        pixels=np.nan_to_num(seen[..., :2]),
        inverse_scale=np.where(known, 1 / np.asarray(error), 0.0),
        triangulated=found,
    )


def _calibrate_errors(
    fitter: PointFitter,
    fit: PointFit,
    seen: np.ndarray,
    points: BodyPoints,
    config: KeypointStartConfig,
    pixel: float,
) -> tuple[PointViews, KeypointModel]:
    """Return the views with errors by confidence and point that are estimated from the residuals of
    a fit, and the model with them."""
    views = fitter.views
    off = np.linalg.norm(fitter.residuals(fit), axis=-1) / _RAYLEIGH
    # The fit uses up three coordinates of each point.
    n_views = np.maximum((views.inverse_scale > 0).sum(0), 2)
    off *= np.sqrt(2 * n_views / np.maximum(2 * n_views - 3, 1))
    known = views.inverse_scale > 0
    confidence, of = seen[..., 2][known], off[known]
    order = np.argsort(confidence)
    parts = np.array_split(order, min(config.n_levels, len(order)))
    levels = np.array([np.median(confidence[part]) for part in parts])
    errors = np.array([np.median(of[part]) for part in parts])
    # the error must not rise with the confidence
    errors = np.maximum.accumulate(errors[::-1])[::-1]
    errors = np.maximum(errors, config.least_error * pixel)
    ratio = np.where(known, off / np.interp(np.nan_to_num(seen[..., 2]), levels, errors), np.nan)
    with np.errstate(invalid="ignore"):
        factor = np.array([
            np.median(one[np.isfinite(one)]) if np.isfinite(one).any() else 1.0
            for one in np.moveaxis(ratio, -1, 0)
        ])  # fmt: skip
    own = np.arange(len(points))
    model = KeypointModel(
        columns=points.columns,
        bone=points.bones,
        position=fitter.positions(fit.log_lengths, fit.offset),
        partner=np.where(points.partners == own, -1, points.partners),
        confidence=levels,
        error=errors,
        factor=np.clip(factor, 0.3, 4.0),
        usual=float(np.median(known.sum((0, 2)))),
    )
    scale = model.scale(np.nan_to_num(seen[..., 2]))
    return replace(views, inverse_scale=np.where(known, 1 / scale, 0.0)), model


def _scale_to_height(
    fitter: PointFitter, fit: PointFit, height: float, rig: CameraRig
) -> tuple[PointFit, PointFitter]:
    """Return the fit with the body scaled to a known stature, and the rest fitted to that body."""
    factor = np.log(height / stature(fitter.body(fit.log_lengths)))
    fitter = PointFitter(fitter.template, rig, fitter.views, fitter.config, keep_shape=True)
    return fitter.refine(replace(fit, log_lengths=fit.log_lengths + factor)), fitter
