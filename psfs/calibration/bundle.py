"""Bundle adjustment of cameras and target poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import block_diag, coo_matrix, csr_matrix
from threadpoolctl import threadpool_limits

from psfs.calibration.config import CalibrationConfig
from psfs.calibration.scene import CalibrationScene, rigid_transform
from psfs.calibration.targets.target import Sighting, Target, group_by_view
from psfs.cameras.camera import Camera

#: Parameters of a pose (Rodrigues vector, translation) and of a lens (log fx, log fy, cx, cy, k1,
#: k2, p1, p2).
_POSE, _LENS = 6, 8
#: Columns of cv2.projectPoints's Jacobian that belong to the pose and to the lens.
_POSE_COLUMNS, _LENS_COLUMNS = slice(0, _POSE), slice(_POSE, _POSE + _LENS)
#: Tolerance of each step's linear system (LSMR), and the most steps of a round.
_TOLERANCE, _MOST_STEPS = 1e-6, 25
#: Rounds, each of which decorrelates the parameters again; a round of so few steps is the last.
_ROUNDS, _FEW_STEPS = 12, 8


@dataclass(frozen=True)
class FreeParameters:
    """Parameters that the bundle adjustment estimates.

    lenses: cameras whose intrinsics are free. held: cameras whose pose is fixed. poses: whether the
    target's poses are free.
    """

    lenses: tuple[int, ...] = ()
    held: tuple[int, ...] = ()
    poses: bool = True


def adjust_bundle(
    scene: CalibrationScene,
    target: Target,
    sightings: Sequence[Sighting],
    freedom: FreeParameters,
    config: CalibrationConfig,
) -> CalibrationScene:
    """Minimise the robust sum of squared reprojection errors, px, with weak priors on the lenses.

    Returns the adjusted scene; free poses are those of the sightings' frames only. Uses
    scipy.optimize.least_squares with soft L1 and the sparse Jacobian of cv2.projectPoints.
    """
    problem = _Problem(scene, target, sightings, freedom, config)
    if not problem.size:
        return scene
    # The robust loss gets its final noise level in a second run: far from the solution, all errors
    # are large and good points would be treated as outliers.
    x = problem.start
    with threadpool_limits(1, "blas"):  # the vectors are too short for more threads
        for noise in problem.noises():
            for _ in range(_ROUNDS):
                apart = problem.decorrelation(x)
                solution = _solve_round(problem, x, apart, noise)
                x = x + apart @ solution.x
                if solution.status > 0 and solution.nfev <= _FEW_STEPS:
                    break
    return problem.scene(x)


def _solve_round(problem: _Problem, x: np.ndarray, apart: csr_matrix, noise: float) -> Any:
    """Run one round of steps; its solution y moves the parameters to x + apart y."""
    return least_squares(
        lambda y: problem.residuals(x + apart @ y),
        np.zeros(problem.size),
        lambda y: problem.jacobian(x + apart @ y) @ apart,
        loss="soft_l1", f_scale=noise, ftol=1e-6, xtol=1e-8, gtol=1e-8, max_nfev=_MOST_STEPS,
        tr_solver="lsmr", tr_options={"atol": _TOLERANCE, "btol": _TOLERANCE, "maxiter": 1000},
    )  # fmt: skip


class _Problem:
    """The residuals of a parameter vector and their derivatives."""

    def __init__(
        self,
        scene: CalibrationScene,
        target: Target,
        sightings: Sequence[Sighting],
        freedom: FreeParameters,
        config: CalibrationConfig,
    ) -> None:
        self.target, self.freedom, self.config = target, freedom, config
        frames = sorted({sighting.frame for sighting in sightings})
        self.all_poses = scene.poses
        self.first = CalibrationScene(
            scene.cameras, {frame: scene.poses[frame] for frame in frames}
        )
        # A wand's rotation about itself, its X axis, cannot be observed.
        self.axes = [0, 1, 2] if target.planar else [1, 2]
        self.of_pose = len(self.axes) + 3
        self.frames = {frame: row for row, frame in enumerate(frames)}
        views = len(scene.cameras)
        self._assign_columns(len(frames))
        self.views = [self._view(of) for of in group_by_view(sightings, views)]
        self.start = self._pack_scene(self.first)
        self._known: tuple[bytes, np.ndarray, list[Any]] | None = None

    def _assign_columns(self, frames: int) -> None:
        """Compute the columns of each camera's pose and lens and of each target pose."""
        self.places: dict[int, int] = {}
        self.lenses: dict[int, int] = {}
        self.blocks: list[int] = []
        at = 0
        for view in range(len(self.first.cameras)):
            before = at
            if view not in self.freedom.held:
                self.places[view] = at
                at += _POSE
            if view in self.freedom.lenses:
                self.lenses[view] = at
                at += _LENS
            self.blocks += [at - before] if at > before else []
        self.poses = at
        if self.freedom.poses:
            self.blocks += [self.of_pose] * frames
        self.size = sum(self.blocks)

    def decorrelation(self, x: np.ndarray) -> csr_matrix:
        """Return the block diagonal matrix A for which J A has orthonormal columns in every block.

        J is the Jacobian; a block belongs to a camera or a target pose. Iterative solvers then need
        few iterations (block Jacobi).
        """
        normal = self.jacobian(x)
        normal = (normal.T @ normal).tocsr()
        found, at = [], 0
        for width in self.blocks:
            block = normal[at : at + width].tocsc()[:, at : at + width].toarray()
            scale = 1 / np.sqrt(np.maximum(np.diag(block), 1e-9))
            values, vectors = np.linalg.eigh(block * np.outer(scale, scale))
            found.append(scale[:, None] * vectors / np.sqrt(np.maximum(values, 1e-8)))
            at += width
        return block_diag(found, format="csr")

    def _view(self, sightings: Sequence[Sighting]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return frame rows (N,), target points (N, 3) and pixels (N, 2) of a camera's
        sightings."""
        if not sightings:
            return np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 2))
        rows = [np.full(len(s.ids), self.frames[s.frame]) for s in sightings]
        points = [self.target.frame_points(s.frame)[s.ids] for s in sightings]
        pixels = [s.pixels for s in sightings]
        return np.concatenate(rows), np.concatenate(points), np.concatenate(pixels)

    def noises(self) -> list[float]:
        """Return the robust loss's noise level of each run, px: the start's own level first."""
        sizes = np.abs(self.residuals(self.start))
        level = float(np.median(sizes)) if sizes.size else 0.0
        return [level, self.config.noise] if level > 2 * self.config.noise else [self.config.noise]

    def _pack_scene(self, scene: CalibrationScene) -> np.ndarray:
        x = np.zeros(self.size)
        for view, camera in enumerate(scene.cameras):
            if view in self.places:
                at = self.places[view]
                x[at : at + _POSE] = np.r_[cv2.Rodrigues(camera.R)[0].ravel(), camera.t]
            if view in self.lenses:
                K, at = camera.K, self.lenses[view]
                x[at : at + 4] = np.log(K[0, 0]), np.log(K[1, 1]), K[0, 2], K[1, 2]
                x[at + 4 : at + _LENS] = camera.distortion[:4]
        if self.freedom.poses:
            shifts = [scene.poses[frame][:3, 3] for frame in self.frames]
            x[self.poses :].reshape(-1, self.of_pose)[:, -3:] = shifts
        return x

    def scene(self, x: np.ndarray) -> CalibrationScene:
        """Build the scene from the parameters `x`."""
        cameras = tuple(self._camera(x, view) for view in range(len(self.first.cameras)))
        if not self.freedom.poses:
            return CalibrationScene(cameras, self.all_poses)
        poses: dict[int, np.ndarray] = {}
        for (frame, first), turn in zip(self.first.poses.items(), self._vectors(x), strict=True):
            R = first[:3, :3] @ cv2.Rodrigues(turn)[0]
            poses[frame] = rigid_transform(
                R, x[self.poses :].reshape(-1, self.of_pose)[len(poses), -3:]
            )
        return CalibrationScene(cameras, poses)

    def _vectors(self, x: np.ndarray) -> np.ndarray:
        """Return the rotations of the poses since the start, Rodrigues vectors (F, 3) in the
        target's axes."""
        vectors = np.zeros((len(self.frames), 3))
        vectors[:, self.axes] = x[self.poses :].reshape(-1, self.of_pose)[:, :-3]
        return vectors

    def _camera(self, x: np.ndarray, view: int) -> Camera:
        camera = self.first.cameras[view]
        if view in self.places:
            vector = x[self.places[view] :][:_POSE]
            camera = replace(camera, R=cv2.Rodrigues(vector[:3])[0], t=vector[3:])
        if view in self.lenses:
            log_fx, log_fy, cx, cy, *lens = x[self.lenses[view] :][:_LENS]
            fx, fy = np.exp([log_fx, log_fy])
            K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
            camera = replace(camera, K=K, distortion=np.r_[lens, camera.distortion[4:]])
        return camera

    def _vector(self, x: np.ndarray, view: int) -> np.ndarray:
        """Return a camera's rotation as a Rodrigues vector (3,).

        Several vectors mean the same rotation; if the pose is free, returns the one in `x`.
        """
        if view in self.places:
            return x[self.places[view] :][:3]
        vector: np.ndarray = cv2.Rodrigues(self.first.cameras[view].R)[0]
        return vector.ravel()

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Return the errors in x and y of all points, px, then the priors' residuals in sigmas."""
        return self._evaluate(x)[0].copy()  # least_squares scales it in place

    def jacobian(self, x: np.ndarray) -> csr_matrix:
        """Return the derivatives of the residuals, sparse."""
        residuals, entries = self._evaluate(x)
        rows, columns, values = (np.concatenate(of) for of in zip(*entries, strict=True))
        height = len(residuals)
        return coo_matrix((values, (rows, columns)), shape=(height, self.size)).tocsr()

    def _evaluate(self, x: np.ndarray) -> tuple[np.ndarray, list[Any]]:
        key = x.tobytes()
        if self._known is None or self._known[0] != key:
            scene = self.scene(x)
            turns = self._pose_derivatives(x, scene)
            errors: list[np.ndarray] = []
            entries: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
            height = 0
            for view, camera in enumerate(scene.cameras):
                if len(self.views[view][0]):
                    residuals, found = self._evaluate_view(
                        view, camera, self._vector(x, view), turns, height
                    )
                    errors.append(residuals)
                    entries += found
                    height += len(residuals)
            for view in self.lenses:
                residuals, found = self._evaluate_priors(view, scene.cameras[view], height)
                errors.append(residuals)
                entries += found
                height += len(residuals)
            self._known = key, np.concatenate(errors), entries
        return self._known[1:]

    def _pose_derivatives(
        self, x: np.ndarray, scene: CalibrationScene
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the target poses and their derivatives.

        Rotations (F, 3, 3), translations (F, 3), and the derivatives (F, T, 3, 3) of the rotations
        with respect to the T free angles.
        """
        poses = np.stack([scene.poses[frame] for frame in self.frames])
        slopes = np.zeros((len(poses), 3, 3, 3))
        if self.freedom.poses:
            first = np.stack(list(self.first.poses.values()))[:, None, :3, :3]
            by_vector = [cv2.Rodrigues(v)[1].reshape(3, 3, 3) for v in self._vectors(x)]
            slopes = (first @ np.stack(by_vector))[:, self.axes]
        return poses[:, :3, :3], poses[:, :3, 3], slopes

    def _evaluate_view(
        self, view: int, camera: Camera, vector: np.ndarray, turns: tuple[Any, ...], height: int
    ) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray, np.ndarray]]]:
        """Return a camera's residuals (2 N,) and its entries of the Jacobian.

        The entries are rows (from `height` on), columns and values.
        """
        frames, points, pixels = self.views[view]
        R, t, slopes = turns
        world = np.einsum("nij,nj->ni", R[frames], points) + t[frames]
        seen, slope = cv2.projectPoints(world, vector, camera.t, camera.K, camera.distortion)
        rows = height + np.arange(2 * len(points))
        entries = []
        # derivatives with respect to the logarithms
        slope[:, _LENS_COLUMNS][:, :2] *= camera.K[0, 0], camera.K[1, 1]
        for columns, part in ((self.places, _POSE_COLUMNS), (self.lenses, _LENS_COLUMNS)):
            if view in columns:
                entries.append(_block_entries(rows, columns[view], slope[:, part]))
        if self.freedom.poses:
            # x_cam = R x + t: the derivative with respect to t is that with respect to x_cam.
            by_point = slope[:, 3:6].reshape(-1, 2, 3) @ camera.R
            by_turn = np.einsum("nwij,nj->niw", slopes[frames], points)
            by_pose = np.concatenate([by_point @ by_turn, by_point], -1).reshape(-1, self.of_pose)
            first = np.repeat(self.poses + self.of_pose * frames, 2)
            entries.append(_block_entries(rows, first, by_pose))
        return (seen.reshape(-1, 2) - pixels).ravel(), entries

    def _evaluate_priors(
        self, view: int, camera: Camera, height: int
    ) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray, np.ndarray]]]:
        """Return the prior residuals (7,) of a lens: aspect, principal point, distortion."""
        config, (width, tall), K = self.config, camera.size, camera.K
        centre = config.centre_sigma * width
        scales = np.r_[centre, centre, [config.lens_sigma] * 2, [config.tangential_sigma] * 2]
        off = np.r_[K[0, 2] - (width - 1) / 2, K[1, 2] - (tall - 1) / 2, camera.distortion[:4]]
        residuals = np.r_[np.log(K[0, 0] / K[1, 1]) / config.aspect_sigma, off / scales]
        slope = np.zeros((7, _LENS))
        slope[0, :2] = 1 / config.aspect_sigma, -1 / config.aspect_sigma
        slope[1:, 2:] = np.diag(1 / scales)
        return residuals, [_block_entries(height + np.arange(7), self.lenses[view], slope)]


def _block_entries(
    rows: np.ndarray, first: int | np.ndarray, block: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows, columns and values of a block (N, K) whose row k begins at column first[k]."""
    n, k = block.shape
    columns = np.broadcast_to(first, n)[:, None] + np.arange(k)
    return np.repeat(rows, k), columns.ravel(), block.ravel()
