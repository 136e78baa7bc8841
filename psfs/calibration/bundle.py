"""Bundle adjustment of cameras and target poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from psfs.calibration.scene import CalibrationScene, rigid_transform
from psfs.calibration.targets.target import Sighting, group_by_view
from psfs.cameras.camera import Camera
from psfs.common.least_squares import Parameters, Residuals, Slope, Solution, prior, solve
from psfs.common.progress import one_blas_thread

#: Parameters of a pose (Rodrigues vector, translation) and of a lens (log fx, log fy, cx, cy, k1,
#: k2, p1, p2), the columns of cv2.projectPoints's Jacobian.
_POSE, LENS_PARAMETERS = 6, 8
#: Standard deviations of a lens's parameters, the principal point's in widths of the picture, and
#: of the ratio of fx and fy around 1: lenses are well within them.
_LENSES, _ASPECT = (np.inf, np.inf, 0.05, 0.05, 0.3, 0.3, 0.01, 0.01), 0.01


def adjust_bundle(
    scene: CalibrationScene, sightings: Sequence[Sighting], lenses: Sequence[int],
    held: Sequence[int], poses: bool,
) -> CalibrationScene:  # fmt: skip
    """Minimise the robust sum of squared reprojection errors, px, with weak priors on the lenses.

    lenses: cameras whose intrinsics are free. held: cameras whose pose is fixed. poses: whether the
    target's poses are free. Returns the adjusted scene; free poses are those of the sightings'
    frames only. The noise of each camera's points is estimated.
    """
    problem = _Problem(scene, sightings, lenses, held, poses)
    return problem.scene(problem.solve().parameters) if problem.frames else scene


def compare_lenses(
    scene: CalibrationScene, sightings: Sequence[Sighting], views: Sequence[int],
    held: Sequence[int],
) -> dict[int, tuple[float, Camera]]:  # fmt: skip
    """Estimate the intrinsics of the cameras `views`, all at once; return for each camera the
    statistic of its change, and the camera with the estimated intrinsics.

    The statistic (Wald's F) is the square of the change in units of its covariance, per parameter:
    near 1 if the given intrinsics are right.
    """
    problem = _Problem(scene, sightings, views, held, poses=True)
    solution = problem.solve()
    cameras = problem.scene(solution.parameters).cameras
    tests = {}
    for view in views:
        change = solution.parameters["lenses"][view] - problem.start["lenses"][view]
        inverse = np.linalg.pinv(solution.covariance("lenses", [view]), hermitian=True)
        tests[view] = float(change @ inverse @ change) / LENS_PARAMETERS, cameras[view]
    return tests


class _Problem:
    """The residuals of parameters and their derivatives.

    The blocks: cameras (V, 6), lenses (V, 8), and poses (F, 6) of the target: its rotation vector
    in its own axes since the start, and its translation.
    """

    def __init__(
        self, scene: CalibrationScene, sightings: Sequence[Sighting], lenses: Sequence[int],
        held: Sequence[int], poses: bool,
    ) -> None:  # fmt: skip
        self._lenses, self._held, self._poses = list(lenses), held, poses
        self.first, cameras = scene, scene.cameras
        self.frames = sorted({sighting.frame for sighting in sightings})
        self.turns = np.array([scene.poses[frame][:3, :3] for frame in self.frames])
        rows = {frame: row for row, frame in enumerate(self.frames)}
        self.views = [self._view(group, rows) for group in group_by_view(sightings, len(cameras))]
        self.free = {
            "cameras": np.zeros((len(cameras), _POSE), bool),
            "lenses": np.zeros((len(cameras), LENS_PARAMETERS), bool),
            "poses": np.full((len(self.frames), _POSE), poses),
        }
        self.free["cameras"][[v for v in range(len(cameras)) if v not in held]] = True
        self.free["lenses"][self._lenses] = True
        # A wand's rotation about itself, its X axis, cannot be observed.
        self.free["poses"][:, 0] &= scene.target.planar
        starts = [np.r_[np.zeros(3), scene.poses[frame][:3, 3]] for frame in self.frames]
        self.start = {
            "cameras": np.stack([np.r_[cv2.Rodrigues(c.R)[0].ravel(), c.t] for c in cameras]),
            "lenses": np.stack([_pack_lens(camera) for camera in cameras]),
            "poses": np.reshape(starts, (-1, _POSE)),
        }

    def solve(self) -> Solution:
        """Return the solution."""
        with one_blas_thread():  # the matrices are too small for more threads
            return solve(self.evaluate, self.start, eliminate=["poses"], free=self.free)

    def _view(
        self, sightings: Sequence[Sighting], rows: dict[int, int]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return frame rows (N,), target points (N, 3) and pixels (N, 2) of a camera's
        sightings."""
        if not sightings:
            return np.zeros(0, int), np.zeros((0, 3)), np.zeros((0, 2))
        of_frames = [np.full(len(s.ids), rows[s.frame]) for s in sightings]
        points = [self.first.target.frame_points(s.frame)[s.ids] for s in sightings]
        pixels = [s.pixels for s in sightings]
        return np.concatenate(of_frames), np.concatenate(points), np.concatenate(pixels)

    def scene(self, parameters: Parameters) -> CalibrationScene:
        """Build the scene from the parameters."""
        cameras = []
        for view, camera in enumerate(self.first.cameras):
            if view not in self._held:
                vector = parameters["cameras"][view]
                camera = replace(camera, R=cv2.Rodrigues(vector[:3])[0], t=vector[3:])
            if view in self._lenses:
                camera = _unpack_lens(parameters["lenses"][view], camera)
            cameras.append(camera)
        if not self._poses:
            return replace(self.first, cameras=tuple(cameras))
        poses = {
            frame: rigid_transform(turn @ cv2.Rodrigues(values[:3])[0], values[3:])
            for frame, turn, values in zip(
                self.frames, self.turns, parameters["poses"], strict=True
            )
        }
        return CalibrationScene(tuple(cameras), self.first.target, poses)

    def evaluate(self, parameters: Parameters) -> list[Residuals]:
        """Return the errors in x and y of each camera's points, px, and the priors of lenses."""
        by_vector = [cv2.Rodrigues(pose[:3]) for pose in parameters["poses"]]
        R = self.turns @ np.stack([turn for turn, _ in by_vector])
        slopes = self.turns[:, None] @ np.stack([pose.reshape(3, 3, 3) for _, pose in by_vector])
        poses = R, parameters["poses"][:, 3:], slopes
        residuals = [
            self._evaluate_view(view, parameters, poses)
            for view, (rows, _, _) in enumerate(self.views)
            if len(rows)
        ]
        return [*residuals, *self._lens_priors(parameters["lenses"])]

    def _evaluate_view(
        self, view: int, parameters: Parameters, poses: tuple[np.ndarray, np.ndarray, np.ndarray]
    ) -> Residuals:
        rows, points, pixels = self.views[view]
        R, t, slopes = poses
        vector, camera = parameters["cameras"][view], self.first.cameras[view]
        if view in self._lenses:
            camera = _unpack_lens(parameters["lenses"][view], camera)
        world = np.einsum("nij,nj->ni", R[rows], points) + t[rows]
        seen, slope = cv2.projectPoints(world, vector[:3], vector[3:], camera.K, camera.distortion)
        slope = slope.reshape(len(points), 2, -1)[..., : _POSE + LENS_PARAMETERS]
        by_lens = slope[..., _POSE:]
        by_lens[..., :2] *= camera.K[0, 0], camera.K[1, 1]  # by the logarithms
        # x_cam = R x + t: the derivative with respect to t is that with respect to x_cam.
        by_point = slope[..., 3:_POSE] @ cv2.Rodrigues(vector[:3])[0]
        by_turn = np.einsum("nwij,nj->niw", slopes[rows], points)
        by_pose = np.concatenate([by_point @ by_turn, by_point], axis=-1)
        mine = np.full(len(points), view)
        return Residuals(
            seen.reshape(-1, 2) - pixels,
            [
                Slope("cameras", mine, slope[..., :_POSE]),
                Slope("lenses", mine, by_lens),
                Slope("poses", rows, by_pose),
            ],
        )

    def _lens_priors(self, lenses: np.ndarray) -> list[Residuals]:
        """Return the priors of lenses: aspect, principal point, distortion."""
        free = self._lenses
        sizes = np.array([self.first.cameras[view].size for view in free], float).reshape(-1, 2)
        sigmas = np.full((len(lenses), LENS_PARAMETERS), np.inf)
        sigmas[free] = _LENSES
        sigmas[free, 2:4] *= sizes[:, :1]
        means = np.zeros(sigmas.shape)
        means[free, 2:4] = (sizes - 1) / 2
        aspect = np.zeros((len(free), 1, LENS_PARAMETERS))
        aspect[..., :2] = 1, -1
        off = lenses[free, 0] - lenses[free, 1]
        slope = Slope("lenses", np.array(free, int), aspect)
        return [
            Residuals(off, [slope], sigma=_ASPECT, robust=False),
            prior("lenses", lenses, sigmas, means),
        ]


def _pack_lens(camera: Camera) -> np.ndarray:
    """Return a lens's parameters (8,)."""
    K = camera.K
    return np.r_[np.log([K[0, 0], K[1, 1]]), K[0, 2], K[1, 2], camera.distortion[:4]]


def _unpack_lens(values: np.ndarray, camera: Camera) -> Camera:
    """Return the camera with a lens of these parameters (8,)."""
    fx, fy = np.exp(values[:2])
    K = np.array([[fx, 0, values[2]], [0, fy, values[3]], [0, 0, 1]])
    return replace(camera, K=K, distortion=np.r_[values[4:], camera.distortion[4:]])
