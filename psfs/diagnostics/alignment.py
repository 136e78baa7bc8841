"""Correction of a slightly wrong calibration by the silhouettes: `correct_rig`.

Tripods sink, lenses are refocused, and calibration boards are seen from one side only. The cameras
then look some tenths of a degree away from where the calibration says, and arms are carved off the
voxels. The planes that touch the person in two pictures (see `tangency`) measure the error. Robust
least squares over all pairs of cameras and all frames correct each camera's direction and focal
length (Sinha & Pollefeys, IJCV 87, 2010; Hernandez, Schmitt & Cipolla, PAMI 29, 2007).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.rig_geometry import intersect_axes_ahead
from psfs.diagnostics.config import AlignmentConfig, FaultConfig
from psfs.diagnostics.small_views import Outline, SmallViews, small_views
from psfs.diagnostics.tangency import Tangency
from psfs.session import Session

#: Parameters of a camera's correction: a rotation vector, rad, and the log of the focal length's
#: factor.
_N = 4
#: Step of the finite differences.
_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Alignment:
    """A corrected rig.

    corrections: (V, 4) rotation vector, rad, and log of the focal length's factor. before, after:
    median distance, m, between planes that should coincide. moved: (V,) px by which the scene's
    middle and the points around it moved in each camera's picture.
    """

    rig: CameraRig
    corrections: np.ndarray
    before: float
    after: float
    moved: np.ndarray

    def __str__(self) -> str:
        return (
            f"the calibration is off by {np.sqrt(np.mean(self.moved**2)):.1f} px; with corrected "
            f"directions the silhouettes differ by {1000 * self.after:.0f} mm instead of "
            f"{1000 * self.before:.0f}"
        )

    def is_accepted(self, config: AlignmentConfig) -> bool:
        """Return whether the rig was measurably off and fits now."""
        return self.is_significant(config, config.share) and self.after <= config.most_left

    def is_significant(self, config: AlignmentConfig, share: float) -> bool:
        """Return whether the rig was measurably off, and at most this share of the distances is
        left."""
        size = max(self.rig.width, self.rig.height)
        return bool(
            self.after <= share * self.before
            and np.sqrt(np.mean(self.moved**2)) >= config.least_moved * size
        )


def correct_rig(
    session: Session, views: SmallViews, config: AlignmentConfig | None = None
) -> Alignment | None:
    """Return the corrected rig of a session; None if the rig fits as it is or cannot be judged.

    views: small pictures of these cameras or more. If they show that the rig is off, the correction
    is estimated from larger ones.
    """
    config, rig = config or AlignmentConfig(), session.rig
    if not config.on or len(rig) < 3:
        return None
    first = _estimate_from_views(rig, views, config)
    if first is None or not first.is_significant(config, config.first_share):
        return None
    larger = FaultConfig().replace(longest_side=config.longest_side)
    found = _estimate_from_views(rig, small_views(session.sequence, session.device, larger), config)
    return found if found is not None and found.is_accepted(config) else None


def _estimate_from_views(
    rig: CameraRig, views: SmallViews, config: AlignmentConfig
) -> Alignment | None:
    columns = [views.rig.names.index(name) for name in rig.names]
    small = CameraRig(tuple(views.rig[column] for column in columns))
    outlines = [[row[column] for column in columns] for row in views.outlines]
    hidden = rig.hidden
    if hidden is not None:
        shapes = [camera.size for camera in small]
        reduced = [cv2.resize(h.view(np.uint8), s) for h, s in zip(hidden, shapes, strict=True)]
        outlines = mark_hidden_points(outlines, reduced)
    return estimate_alignment(rig, small, outlines, config)


def estimate_alignment(
    rig: CameraRig,
    small: CameraRig,
    outlines: list[list[Outline | None]],
    config: AlignmentConfig | None = None,
) -> Alignment | None:
    """Return the rig under which the outlines [frame][view] fit best; None if they cannot be
    compared. `small` is the same rig scaled to the outlines' pictures."""
    config = config or AlignmentConfig()
    fit = _Fit(small, outlines, config)
    if not config.on or not fit.pairs:
        return None
    x = np.zeros((len(rig), _N))
    before = np.nan
    for step in range(config.n_steps):
        residuals, jacobian = fit.linearise(x)
        if len(residuals) < config.least_rows * x.size:
            return None
        if step == 0:
            before = float(np.median(np.abs(residuals)))
        x = x + fit.step(x, residuals, jacobian)
    after = float(np.median(np.abs(fit.linearise(x)[0])))
    turned = CameraRig(tuple(correct_camera(c, own) for c, own in zip(rig, x, strict=True)))
    return Alignment(turned, x, before, after, _measure_motion(rig, turned, fit.size))


def correct_camera(camera: Camera, correction: np.ndarray) -> Camera:
    """Return the camera, turned about its centre and with its focal length changed."""
    R = cv2.Rodrigues(correction[:3])[0] @ camera.R
    K = camera.K.copy()
    K[[0, 0, 1], [0, 1, 1]] *= np.exp(correction[3])
    return replace(camera, K=K, R=R, t=-R @ camera.centre)


class _Fit:
    """The distances between the planes of all pairs of cameras, and their derivatives by the
    corrections."""

    def __init__(
        self, rig: CameraRig, outlines: list[list[Outline | None]], config: AlignmentConfig
    ) -> None:
        self.rig, self.config = rig, config
        self._tangency = Tangency(rig, outlines)
        self.size = self._tangency.size
        n = len(rig)
        known = np.isfinite(self.size) and n > 2
        comparable = self._tangency.comparable
        self.pairs = [(a, b) for a in range(n) for b in range(a) if known and comparable(a, b)]

    def _rays(self, view: int, correction: np.ndarray) -> list[np.ndarray]:
        """Return the rays (N, 3) of a view's outlines under its correction (4,), then under those
        that differ from it by a step in one number."""
        first, steps = self.rig[view], _STEP * np.eye(_N)
        camera = correct_camera(first, correction)
        rays = self._tangency.trace_outlines(view, camera)
        longer = correct_camera(first, correction + steps[3])
        # A turn needs no lens undone again.
        turns = [cv2.Rodrigues((correction + step)[:3])[0] @ first.R for step in steps[:3]]
        turned = [rays @ (camera.R.T @ turn) for turn in turns]
        return [rays, *turned, self._tangency.trace_outlines(view, longer)]

    def _planes(
        self, view: int, rays: list[np.ndarray], other: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the planes (2 F,) of a view around the line to another camera, and their
        derivatives (2 F, 4) by its correction."""
        planes, *moved = (self._tangency.measure_planes(view, own, other).ravel() for own in rays)
        return planes, np.stack([(one - planes) / _STEP for one in moved], -1)

    def linearise(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals (M,) m of corrections x (V, 4), and their derivatives (M, 4 V)."""
        residuals, rows = [], []
        rays = [self._rays(view, own) for view, own in enumerate(x)]
        for a, b in self.pairs:
            first, first_slopes = self._planes(a, rays[a], b)
            second, second_slopes = self._planes(b, rays[b], a)
            derivative = np.zeros((len(first), x.size))
            derivative[:, _N * a : _N * a + _N] = first_slopes
            derivative[:, _N * b : _N * b + _N] = -second_slopes
            residuals.append(first - second)
            rows.append(derivative)
        found, jacobian = np.concatenate(residuals), np.concatenate(rows)
        kept = np.isfinite(found) & np.isfinite(jacobian).all(1)
        return found[kept], jacobian[kept]

    def step(self, x: np.ndarray, residuals: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        """Return the Gauss-Newton step (V, 4). Residuals have Geman & McClure's weights,
        corrections have their prior, and the scene's middle, which all cameras see, is held where
        it was."""
        config = self.config
        weights = config.information / (config.noise * (1 + (residuals / config.reach) ** 2)) ** 2
        sigmas = np.tile([*3 * [config.turn], config.focal], len(x))
        pinned = self._scene_moves() / config.middle
        normal = (jacobian * weights[:, None]).T @ jacobian + np.diag(sigmas**-2.0)
        normal += pinned.T @ pinned
        gradient = jacobian.T @ (weights * residuals) + x.ravel() / sigmas**2
        gradient += pinned.T @ (pinned @ x.ravel())
        return -np.linalg.solve(normal, gradient).reshape(x.shape)

    def _scene_moves(self) -> np.ndarray:
        """Return the derivatives (3, 4 V), m, of the triangulated intersection of the optical axes
        by the corrections."""
        target = intersect_axes_ahead(self.rig)
        total, moves = np.zeros((3, 3)), np.zeros((3, _N * len(self.rig)))
        for view, camera in enumerate(self.rig):
            ray = target - camera.centre
            across = np.eye(3) - np.outer(ray, ray) / (ray @ ray)
            total += across
            turn = -np.cross(np.eye(3), ray) @ camera.R.T  # d (R^T w x ray) / d w
            moves[:, _N * view : _N * view + 3] = across @ turn
        solved: np.ndarray = np.linalg.solve(total, moves)
        return solved


def _measure_motion(before: CameraRig, after: CameraRig, size: float) -> np.ndarray:
    """Return (V,) how far points around the scene's middle move in each picture, px."""
    around = np.stack(np.meshgrid(*3 * [[-0.4, 0, 0.4]]), -1).reshape(-1, 3) * size
    points = intersect_axes_ahead(before) + around
    pairs = zip(before, after, strict=True)
    moves = [np.linalg.norm(a.project(points)[0] - b.project(points)[0], axis=1) for a, b in pairs]
    return np.array([np.median(own) for own in moves])


def mark_hidden_points(
    outlines: list[list[Outline | None]], hidden: list[np.ndarray], near: int = 4
) -> list[list[Outline | None]]:
    """Return the outlines [frame][view] with the points within `near` px of hidden pixels marked as
    points on the picture's border, since the person goes on behind furniture. The hidden pixels of
    each view are (h, w) uint8."""
    square = np.ones((2 * near + 1,) * 2, np.uint8)
    wide = [cv2.dilate(own, square) > 0 for own in hidden]

    def cut(outline: Outline | None, where: np.ndarray) -> Outline | None:
        if outline is None:
            return None
        x, y = outline.points.astype(int).T
        return replace(outline, at_border=outline.at_border | where[y, x])

    return [[cut(*of) for of in zip(row, wide, strict=True)] for row in outlines]
