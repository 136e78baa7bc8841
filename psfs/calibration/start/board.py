"""Initialise a calibration from a board, whose pose follows from each single picture of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np

from psfs.calibration.scene import (
    GOOD,
    CalibrationScene,
    rigid_transform,
    transform_points,
)
from psfs.calibration.start.placing import place_along
from psfs.calibration.targets.target import Sighting, Target, group_by_frame
from psfs.cameras.camera import Camera
from psfs.common.numbers import pick_evenly


def estimate_board_pose(camera: Camera, target: Target, sighting: Sighting) -> np.ndarray | None:
    """Estimate the board's pose (4, 4), board to camera; None if there is none, as for points that
    coincide in the picture.

    The better of a plane's two solutions (cv2.SOLVEPNP_IPPE), refined.
    """
    points = np.ascontiguousarray(target.points[sighting.ids])
    pixels = np.ascontiguousarray(sighting.pixels)
    known = points, pixels, camera.K, camera.distortion
    _, turns, shifts, _ = cv2.solvePnPGeneric(*known, flags=cv2.SOLVEPNP_IPPE)
    if not turns:
        return None
    turn, shift = cv2.solvePnPRefineLM(*known, turns[0], shifts[0])
    return rigid_transform(turn, shift)


def place_cameras_by_board(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    pairs: Sequence[tuple[int, int]],
) -> tuple[CalibrationScene, list[Sighting]]:
    """Place the cameras along the `pairs` and estimate the board's poses.

    Returns them with the sightings that have a pose, their points in the order that fits.
    """
    estimated = {
        (s.frame, s.view): estimate_board_pose(cameras[s.view], target, s) for s in sightings
    }
    poses = {key: pose for key, pose in estimated.items() if pose is not None}
    sightings = [s for s in sightings if (s.frame, s.view) in poses]
    seen = {(s.frame, s.view): s for s in sightings}
    relative = {pair: _estimate_relative_pose(pair, cameras, target, seen, poses) for pair in pairs}
    rig, camera_poses = place_along(cameras, relative)
    board_poses: dict[int, np.ndarray] = {}
    ordered: list[Sighting] = []
    for frame, here in group_by_frame(sightings).items():
        proposed = [np.linalg.inv(camera_poses[s.view]) @ poses[frame, s.view] for s in here]
        board_poses[frame], fitting = choose_best_pose(rig, target, here, proposed)
        ordered += fitting
    return CalibrationScene(rig, target, board_poses), ordered


def choose_best_pose(
    rig: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    proposed: Sequence[np.ndarray],
) -> tuple[np.ndarray, list[Sighting]]:
    """Choose the proposed pose (4, 4) that fits a frame's sightings best.

    Returns it with the sightings, their points in the order that fits it.
    """
    best: tuple[float, np.ndarray, list[Sighting]] | None = None
    for pose in proposed:
        points = transform_points(pose, target.frame_points(sightings[0].frame))
        fitting, cost = [], 0.0
        for sighting in sightings:
            pixels, _ = rig[sighting.view].project(points)
            off = _median_errors(target, sighting, pixels)
            fitting.append(sighting.reorder(target.orders[int(np.argmin(off))]))
            cost += min(min(off), 100.0)  # one camera with a large error must not decide
        if best is None or cost < best[0]:
            best = cost, pose, fitting
        if cost < GOOD * len(sightings):
            break
    assert best is not None
    return best[1], best[2]


def _median_errors(target: Target, sighting: Sighting, pixels: np.ndarray) -> list[float]:
    """Return the median distance, px, of a sighting from the target's points at `pixels` (P, 2), in
    each of the target's orders."""
    return [
        float(np.median(np.linalg.norm(pixels[order[sighting.ids]] - sighting.pixels, axis=-1)))
        for order in target.orders
    ]


def _estimate_relative_pose(
    pair: tuple[int, int],
    cameras: Sequence[Camera],
    target: Target,
    seen: Mapping[tuple[int, int], Sighting],
    poses: Mapping[tuple[int, int], np.ndarray],
) -> np.ndarray:
    """Estimate the transform (4, 4) from the first camera of a pair to the second.

    Every chosen frame proposes one; the one with the least median error over all frames is taken.
    """
    a, b = pair
    frames = [frame for frame, view in seen if view == a and (frame, b) in seen]
    picked = pick_evenly(len(frames))
    proposals = []
    for frame in (frames[k] for k in picked):
        for order in target.orders:
            pose = estimate_board_pose(cameras[b], target, seen[frame, b].reorder(order))
            if pose is not None:
                proposals.append(pose @ np.linalg.inv(poses[frame, a]))
    camera = replace(cameras[b], R=np.eye(3), t=np.zeros(3))

    def cost(motion: np.ndarray) -> float:
        off = []
        for frame in frames:
            pixels, _ = camera.project(transform_points(motion @ poses[frame, a], target.points))
            off.append(min(_median_errors(target, seen[frame, b], pixels)))
        return float(np.median(off))

    return min(proposals, key=cost)
