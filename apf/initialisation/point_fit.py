"""Fit body and poses to image points of the body by least squares: a bundle adjustment.

The unknowns are the pose of every frame, the body's lengths, and the positions of the points on it.
Lengths and positions are shared by all frames. The poses are eliminated from the normal equations
(Schur complement), as in `shape_fit`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from apf.body.jacobian import bone_point_jacobian
from apf.body.kinematics import bone_matrices
from apf.body.limbs import limb_chains
from apf.body.model import BodyModel, sideless
from apf.initialisation.fit_config import PointFitConfig
from apf.initialisation.shape_fit import LOG_STEP
from apf.initialisation.shape_model import inner_axes
from psfs.cameras.camera import CameraRig


@dataclass(frozen=True, eq=False)
class PointViews:
    """P points of the body in M frames and V cameras.

    bone: (P,) that each is fixed to. position: (P, 3) m on it, in the template's size. spread: (P,)
    m, standard deviation of each coordinate of the position. partner: (P,) index of the same point
    on the other side, or its own index on the midline; partners lie at mirrored positions. pixels:
    (V, M, P, 2), undistorted. inverse_scale: (V, M, P) 1 / px, 0 where a point is not seen.
    triangulated: (M, P, 3) m, NaN where unknown.
    """

    bone: np.ndarray
    position: np.ndarray
    spread: np.ndarray
    partner: np.ndarray
    pixels: np.ndarray
    inverse_scale: np.ndarray
    triangulated: np.ndarray

    def select_frames(self, chosen: np.ndarray) -> PointViews:
        """Return the views of the frames numbered `chosen`."""
        return replace(
            self, pixels=self.pixels[:, chosen], inverse_scale=self.inverse_scale[:, chosen],
            triangulated=self.triangulated[chosen],
        )  # fmt: skip

    @cached_property
    def by_place(self) -> np.ndarray:
        """Mirroring (P, Q, 3) of unknown positions to points: 1 where point p has the position q,
        with -1 along y if p is on the other side, else 0."""
        own = np.arange(len(self.bone))
        first = np.minimum(own, self.partner)
        places, place = np.unique(first, return_inverse=True)
        sign = np.ones((len(own), 3))
        sign[first != own, 1] = -1
        return np.eye(len(places))[place][:, :, None] * sign[:, None, :]


@dataclass(frozen=True, eq=False)
class PointFit:
    """The result of a fit. log_lengths: (G,) of the template's scale groups. offset: (Q, 3) m of
    the points' positions, see `PointViews.by_place`. poses: (M, D)."""

    log_lengths: np.ndarray
    offset: np.ndarray
    poses: np.ndarray


class PointFitter:
    """Fits a template body to image points. keep_shape: the body's lengths stay fixed."""

    def __init__(
        self,
        template: BodyModel,
        rig: CameraRig,
        views: PointViews,
        config: PointFitConfig | None = None,
        keep_shape: bool = False,
    ) -> None:
        self.template, self.views, self.config = template, views, config or PointFitConfig()
        self.groups = template.scale_groups
        self._group = np.array([self.groups.index(sideless(b.name)) for b in template.bones])
        self._R = np.stack([camera.R for camera in rig])
        self._t = np.stack([camera.t for camera in rig])
        self._K = np.stack([camera.K for camera in rig])
        self.keep_shape, self._rig = keep_shape, rig
        self._pose_prior = np.where(inner_axes(template), self.config.angle**-2, 1e-6)

    def body(self, log_lengths: np.ndarray) -> BodyModel:
        """Return the template with these log lengths (G,); radii are scaled by their mean."""
        scales = np.exp(log_lengths)
        girth = float(np.exp(log_lengths.mean()))
        return self.template.scaled(dict(zip(self.groups, scales, strict=True)), girth)

    def positions(self, log_lengths: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """Return the positions (P, 3) m of the points on their bones."""
        factor = np.exp(log_lengths)[self._group[self.views.bone]]
        placed: np.ndarray = self.views.position * factor[:, None]
        return placed + np.einsum("pqi,qi->pi", self.views.by_place, offset)

    def points(self, log_lengths: np.ndarray, offset: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Return the points (M, P, 3) m in the world."""
        rotations, origins = bone_matrices(self.body(log_lengths), poses)
        bone, local = self.views.bone, self.positions(log_lengths, offset)
        turned = np.einsum("mpij,pj->mpi", rotations[:, bone], local)
        return origins[:, bone] + turned

    def residuals(self, fit: PointFit) -> np.ndarray:
        """Return the reprojection residuals (V, M, P, 2), px."""
        pixels, _ = self._project(self.points(fit.log_lengths, fit.offset, fit.poses))
        return pixels - self.views.pixels

    def start_fit(self) -> PointFit:
        """Return the initial fit: a body of about the right size, and its poses at the triangulated
        points."""
        size = 0.0 if self.keep_shape else self._first_size()
        lengths = np.full(len(self.groups), size)
        offset = np.zeros((self.views.by_place.shape[1], 3))
        return self.fit_to_triangulated(
            PointFit(lengths, offset, self._first_poses(lengths, offset))
        )

    def refine(self, fit: PointFit, poses_alone: bool = False) -> PointFit:
        """Return the fit after Gauss-Newton steps on the reprojection error; over the poses alone
        if `poses_alone`."""
        config = self.config
        for reach in np.geomspace(config.first_reach, config.last_reach, config.n_steps):
            fit = self._step(fit, float(reach), poses_alone)
        return fit

    def refit_suspect_frames(self, fit: PointFit) -> PointFit:
        """Return the fit with suspect frames fitted again, from the poses of the nearest other
        frames and from turned poses, where that lowers the error."""
        missed = self.missed_share(fit)
        suspect = np.flatnonzero(missed > self.config.suspect * np.median(missed))
        sound = np.setdiff1d(np.arange(len(missed)), suspect)
        if not suspect.size or not sound.size:
            return fit
        part = PointFitter(
            self.template,
            self._rig,
            self.views.select_frames(suspect),
            self.config,
            self.keep_shape,
        )
        after = sound[np.minimum(np.searchsorted(sound, suspect), len(sound) - 1)]
        before = sound[np.maximum(np.searchsorted(sound, suspect) - 1, 0)]
        best = replace(fit, poses=fit.poses[suspect])
        least = missed[suspect]
        for poses in (fit.poses[before], fit.poses[after], self.turn_around(best.poses)):
            for near in (True, False):
                tried = replace(fit, poses=poses)
                tried = part.refine(
                    part.fit_to_triangulated(tried) if near else tried, poses_alone=True
                )
                cost = part.missed_share(tried)
                better = cost < least
                least = np.where(better, cost, least)
                best = replace(best, poses=np.where(better[:, None], tried.poses, best.poses))
        poses = fit.poses.copy()
        poses[suspect] = best.poses
        return replace(fit, poses=poses)

    def missed_share(self, fit: PointFit) -> np.ndarray:
        """Return the mean robust loss (M,) of the poses: the share of the observations that they
        miss (Geman & McClure 1987)."""
        square = np.sum(self.residuals(fit) ** 2, -1) * self.views.inverse_scale**2
        share = square / (square + self.config.first_reach**2)
        seen = np.maximum((self.views.inverse_scale > 0).sum((0, 2)), 1)
        return share.sum((0, 2)) / seen

    def turn_around(self, poses: np.ndarray) -> np.ndarray:
        """Return poses (M, D) with the root turned by half a turn."""
        out = poses.copy()
        for axis in self.template.bones[0].axes:
            if axis.kind == "rz":
                out[:, axis.dof] += np.pi
        return out

    def fit_to_triangulated(self, fit: PointFit) -> PointFit:
        """Return the fit with poses fitted to the triangulated points, each by the
        Levenberg-Marquardt method."""
        config, poses = self.config, fit.poses
        damping = np.full(len(poses), 1e-2)
        gap, cost = self._gaps(fit, poses)
        for _ in range(config.n_near_steps):
            weight = self._gap_weights(gap)
            by_pose = bone_point_jacobian(
                self.body(fit.log_lengths), poses, self.views.bone,
                self.points(fit.log_lengths, fit.offset, poses),
            )  # fmt: skip
            rows = _rows(by_pose)
            weighted = _rows(by_pose * weight[:, :, None, None])
            matrix = weighted @ rows.swapaxes(1, 2) + np.diag(self._pose_prior)
            vector = (weighted @ gap.reshape(len(gap), -1, 1))[..., 0]
            vector += self._pose_prior * (poses - self.template.rest_pose)
            diagonal = np.einsum("mdd->md", matrix)
            damped = matrix + (damping[:, None] * diagonal)[:, :, None] * np.eye(poses.shape[1])
            moved = poses - np.linalg.solve(damped, vector[..., None])[..., 0]
            moved = np.clip(moved, self.template.lower, self.template.upper)
            moved_gap, moved_cost = self._gaps(fit, moved)
            better = moved_cost < cost
            poses = np.where(better[:, None], moved, poses)
            gap = np.where(better[:, None, None], moved_gap, gap)
            cost = np.where(better, moved_cost, cost)
            damping = np.clip(np.where(better, 0.3 * damping, 5 * damping), 1e-6, 1e6)
        return replace(fit, poses=poses)

    def _first_size(self) -> float:
        """Return the log of the body's size.

        It is the median, over pairs of points on neighbouring bones, of the ratio of the
        triangulated distance to the template's. Points on the trunk and along limbs are used,
        because posture changes their distances little.
        """
        body, views = self.template, self.views
        rest = self.points(np.zeros(len(self.groups)), np.zeros_like(views.by_place[0]),
                           body.rest_pose[None])[0]  # fmt: skip
        logs = []
        for a in range(len(rest)):
            for b in range(a):
                if views.bone[a] == views.bone[b]:
                    continue  # points on one bone are too close to each other
                apart = np.linalg.norm(rest[a] - rest[b])
                if apart < 0.2 or not _neighbours(body, views.bone[a], views.bone[b]):
                    continue
                found = np.linalg.norm(views.triangulated[:, a] - views.triangulated[:, b], axis=-1)
                if np.isfinite(found).any():
                    logs.append(np.log(np.nanmedian(found) / apart))
        return float(np.median(logs)) if logs else 0.0

    def _first_poses(self, log_lengths: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """Return rest poses (M, D), turned and moved to the triangulated points of the trunk. A
        frame with too few of them gets the pose of an earlier frame."""
        body = self.template
        swinging = [bone for chain in limb_chains(body) for bone in chain[-2:]]
        trunk = ~np.isin(self.views.bone, swinging)
        pose = body.rest_pose
        poses = np.empty((len(self.views.triangulated), body.n_dof))
        rest = self.points(log_lengths, offset, pose[None])[0]
        root = {axis.kind: axis for axis in body.bones[0].axes}
        for frame, found in enumerate(self.views.triangulated):
            known = trunk & np.isfinite(found).all(1)
            if known.sum() >= 3:
                heading = _heading(rest[known], found[known])
                pose = body.rest_pose.copy()
                if "rz" in root:
                    pose[root["rz"].dof] += root["rz"].sign * heading
                here = self.points(log_lengths, offset, pose[None])[0, known].mean(0)
                for kind, move in zip(("tx", "ty", "tz"), found[known].mean(0) - here, strict=True):
                    if kind in root:
                        pose[root[kind].dof] += root[kind].sign * move
            poses[frame] = pose
        return poses

    def _gaps(self, fit: PointFit, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the vectors (M, P, 3) m from the triangulated points to those of the poses, 0 for
        missing points, and the cost (M,) of the poses."""
        gap = self.points(fit.log_lengths, fit.offset, poses) - self.views.triangulated
        gap = np.where(np.isfinite(gap), gap, 0.0)
        square = np.sum(gap**2, -1)
        share = square / (square + self.config.stray**2)
        cost = (self.config.stray / self.config.noise) ** 2 * share.sum(1)
        away = poses - self.template.rest_pose
        return gap, cost + np.sum(self._pose_prior * away**2, 1)

    def _gap_weights(self, gap: np.ndarray) -> np.ndarray:
        square = np.sum(gap**2, -1) / self.config.stray**2
        known = np.isfinite(self.views.triangulated).all(-1)
        return np.where(known, self.config.noise**-2 / (1 + square) ** 2, 0.0)

    def _project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project points (M, P, 3) m. Return pixels (V, M, P, 2) and their derivatives (V, M, P, 2,
        3)."""
        seen = np.einsum("vij,mpj->vmpi", self._R, points) + self._t[:, None, None]
        depth = np.maximum(seen[..., 2:], 0.05)
        plane = seen[..., :2] / depth
        turned = self._R[:, None, None, :2] - plane[..., None] * self._R[:, None, None, 2:]
        focal = self._K[:, None, None, :2, :2]
        pixels = np.einsum("vij,vmpj->vmpi", self._K[:, :2, :2], plane)
        slopes: np.ndarray = focal @ (turned / depth[..., None])
        return pixels + self._K[:, None, None, :2, 2], slopes

    def _step(self, fit: PointFit, reach: float, poses_alone: bool) -> PointFit:
        """Return the fit after one Gauss-Newton step. reach: distance, in standard deviations, at
        which the weight of a point falls to a quarter."""
        views, config = self.views, self.config
        points = self.points(fit.log_lengths, fit.offset, fit.poses)
        pixels, slopes = self._project(points)
        seen = views.inverse_scale > 0
        off = np.where(seen[..., None], pixels - views.pixels, 0.0)
        scaled = np.sum(off**2, -1) * views.inverse_scale**2
        weight = views.inverse_scale**2 / (1 + scaled / reach**2) ** 2
        # Sum over the cameras, for each point: information (M, P, 3, 3) and gradient (M, P, 3).
        weighted_slopes = slopes * weight[..., None, None]
        matrix = np.einsum("vmpai,vmpaj->mpij", weighted_slopes, slopes)
        vector = np.einsum("vmpai,vmpa->mpi", weighted_slopes, off)
        body = self.body(fit.log_lengths)
        by_pose = bone_point_jacobian(body, fit.poses, views.bone, points)
        rows, weighted = _rows(by_pose), _rows(by_pose @ matrix)
        own = weighted @ rows.swapaxes(1, 2) + np.diag(self._pose_prior)
        own += config.damping * own * np.eye(own.shape[1])
        gradient = np.einsum("mpdi,mpi->md", by_pose, vector)
        gradient += self._pose_prior * (fit.poses - self.template.rest_pose)
        if poses_alone:
            moved = fit.poses - np.linalg.solve(own, gradient[..., None])[..., 0]
            return replace(fit, poses=np.clip(moved, self.template.lower, self.template.upper))
        shared = self._shared_derivatives(fit, points)
        shared_rows, shared_weighted = _rows(shared), _rows(shared @ matrix)
        mixed = weighted @ shared_rows.swapaxes(1, 2)
        solved = np.linalg.solve(own, np.concatenate([mixed, gradient[..., None]], 2))
        counted = min(1.0, config.n_independent / len(points))
        total = np.sum(shared_weighted @ shared_rows.swapaxes(1, 2), 0)
        total -= np.tensordot(mixed, solved[..., :-1], ((0, 1), (0, 1)))
        right = np.einsum("mpsi,mpi->s", shared, vector)
        right -= np.einsum("mds,md->s", mixed, solved[..., -1])
        prior, pull = self._shared_prior(fit)
        change = -np.linalg.solve(counted * total + prior, counted * right + pull)
        moved = fit.poses - solved[..., -1] - np.einsum("mds,s->md", solved[..., :-1], change)
        n = len(self.groups)
        return PointFit(
            fit.log_lengths + change[:n],
            fit.offset + change[n:].reshape(-1, 3),
            np.clip(moved, self.template.lower, self.template.upper),
        )

    def _shared_derivatives(self, fit: PointFit, points: np.ndarray) -> np.ndarray:
        """Return the derivatives (M, P, S, 3) of the points with respect to the logs of lengths,
        then the coordinates of positions."""
        views, n = self.views, len(self.groups)
        by_length = np.zeros((*points.shape[:2], n, 3))
        if not self.keep_shape:
            for group, step in enumerate(LOG_STEP * np.eye(n)):
                moved = self.points(fit.log_lengths + step, fit.offset, fit.poses)
                by_length[:, :, group] = (moved - points) / LOG_STEP
        rotations, _ = bone_matrices(self.body(fit.log_lengths), fit.poses)
        by_place = np.einsum("mpij,pqj->mpqji", rotations[:, views.bone], views.by_place)
        by_place = by_place.reshape(*points.shape[:2], -1, 3)
        return np.concatenate([by_length, by_place], 2)

    def _shared_prior(self, fit: PointFit) -> tuple[np.ndarray, np.ndarray]:
        """Return the inverse covariance (S, S) of the shared unknowns, and its product with their
        deviation from the prior."""
        config, n = self.config, len(self.groups)
        lengths = np.diag(np.full(n, config.length**2)) + config.size**2
        spread = np.array([
            self.views.spread[np.any(self.views.by_place[:, q] != 0, 1)].mean()
            for q in range(self.views.by_place.shape[1])
        ])  # fmt: skip
        prior = np.diag(np.concatenate([np.zeros(n), np.repeat(spread, 3) ** -2.0]))
        prior[:n, :n] = np.linalg.inv(lengths)
        now = np.concatenate([fit.log_lengths, fit.offset.ravel()])
        if self.keep_shape:
            prior[:n, :n], now[:n] = np.eye(n), 0.0
        return prior, prior @ now


def _rows(slopes: np.ndarray) -> np.ndarray:
    """Reshape slopes (M, P, S, 3) to matrices (M, S, 3 P)."""
    return slopes.swapaxes(1, 2).reshape(len(slopes), slopes.shape[2], -1)


def _heading(points: np.ndarray, turned: np.ndarray) -> float:
    """Return the angle, rad, of the rotation about z that best maps points (K, 3) to the points
    `turn_around` (K, 3)."""
    a, b = (p[:, :2] - p[:, :2].mean(0) for p in (points, turned))
    return float(np.arctan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b)))


def _neighbours(body: BodyModel, a: int, b: int) -> bool:
    """Return whether one of the bones is the other's parent, or both have the same parent."""
    parents = body.bones[a].parent, body.bones[b].parent
    return a == parents[1] or b == parents[0] or parents[0] == parents[1]
