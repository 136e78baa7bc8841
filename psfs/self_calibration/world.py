"""The world's axes and scale: up from the room or the person, floor and scale from the person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from psfs.calibration.scene import rigid_transform, transform_cameras, turn_to_up
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.triangulation import intersect_rays
from psfs.cameras.units import scale_rig
from psfs.common.least_squares import Parameters, Residuals, Slope, prior, solve
from psfs.common.numbers import pick_evenly
from psfs.diagnostics.frontier import FrontierPoints, SilhouetteContours, trace_points
from psfs.footage.camera_times import INDEPENDENT_SHARE
from psfs.self_calibration.adjustment import Adjusted, PersonPoints
from psfs.self_calibration.room_edges import fit_vertical
from psfs.self_calibration.take import PersonTake

#: Standard deviation of the person's up, rad, and of a lowest point over the floor, m.
_UP, _FEET = 0.026, 0.02
#: Percentile of the heights of the topmost points that is the stature: knees bend.
_STANDING = 90.0
#: Greatest distance of the floor from the lowest points, step of the slices, half of a slice's side
#: and its cell, m.
_AROUND, _STEP, _SIDE, _CELL = 0.2, 0.01, 0.6, 0.03
#: Width above which the largest slice is a shadow on the floor, m: feet are 0.10 to 0.15 m wide.
_FOOT = 0.2
#: Height above it at which a shadow is no longer seen, m, and its greatest area there, as a share.
_ABOVE, _THIN = 0.05, 0.8
#: Area of the lowest slice of feet, as a share of the largest slice's.
_LOWEST = 0.1


def triangulate_points(rig: CameraRig, points: FrontierPoints) -> np.ndarray:
    """Return the places (M, 3), m, nearest to both rays of each point."""
    return intersect_rays(rig.centres[points.views], trace_points(rig, points))


def align_to_person(
    adjusted: Adjusted, take: PersonTake, points: FrontierPoints
) -> tuple[CameraRig, bool]:
    """Return the rig in metres with Z up and Z = 0 on the floor, below the person's middle, and
    whether up is the room's.

    Up is that of the room's vertical edges, if these are clear, else of the
    floor below the lowest points. points: where silhouettes touch common planes. X is the first
    camera's right.
    """
    stature = take.points.config.stature
    rig = _place(adjusted.rig, take.find_up(adjusted.rig), points, stature)
    low, _ = _frame_extremes(triangulate_points(rig, points), points.frames)
    rig = _place(rig, fit_floor(low), points, stature)
    rig, levelled = level_rig(replace(adjusted, rig=rig), take.points, take.edges, points)
    return _place(rig, np.array([0.0, 0.0, 1.0]), points, stature, floor=0.0), levelled


def level_rig(
    adjusted: Adjusted, person: PersonPoints, edges: Sequence[np.ndarray], points: FrontierPoints
) -> tuple[CameraRig, bool]:
    """Return a rig in metres, turned to the room's vertical edges [view] (N, 2, 2) px if these are
    clear, with Z = 0 on the floor, and whether they are.

    adjusted: Z is up to some degrees, and Z = 0 below the person to some decimetres.
    """
    rig = adjusted.rig
    up = fit_vertical(rig, edges, np.array([0.0, 0.0, 1.0]))
    if up is not None:
        rig = transform_rig(rig, turn_to_up(up, np.array([1.0, 0.0, 0.0])), np.zeros(3))
    floor = measure_floor(rig, person.contours, adjusted.shifts, *measure_places(rig, points))
    return transform_rig(rig, np.eye(3), np.array([0.0, 0.0, -floor])), up is not None


def transform_rig(rig: CameraRig, R: np.ndarray, shift: np.ndarray) -> CameraRig:
    """Return the rig in another world, x' = R x + shift."""
    return CameraRig(transform_cameras(rig, rigid_transform(R, shift)))


def _place(
    rig: CameraRig, up: np.ndarray, points: FrontierPoints, stature: float,
    floor: float | None = None,
) -> CameraRig:  # fmt: skip
    """Return the rig turned to `up` (3,), with the person's stature and the origin below the
    person's middle at the height `floor`, by default at that of the lowest points."""
    R = turn_to_up(up, rig[0].R[0])
    places = triangulate_points(rig, points) @ R.T
    low, top = _frame_extremes(places, points.frames)
    lowest = np.median(low[:, 2]) if floor is None else floor
    factor = stature / (np.percentile(top[:, 2], _STANDING) - lowest)
    origin = np.array([*np.median(places[:, :2], axis=0), lowest])
    turned = transform_rig(rig, R, -origin)
    return scale_rig(turned, factor)


def fit_floor(low: np.ndarray, up: float = _UP) -> np.ndarray:
    """Return the floor's up (3,), of z 1, below the lowest places (F, 3).

    up: standard deviation of the given up, rad. Where two cameras did not see the feet, hands or
    knees are lowest: robust least squares leave these out.
    """
    plane = np.column_stack([low[:, :2] - np.median(low[:, :2], axis=0), np.ones(len(low))])

    def evaluate(parameters: Parameters) -> list[Residuals]:
        (values,) = parameters["floor"]
        slope = Slope("floor", np.zeros(len(low), int), plane[:, None])
        away = Residuals(
            plane @ values - low[:, 2], [slope], weights=INDEPENDENT_SHARE, least=_FEET
        )
        return [away, prior("floor", parameters["floor"], np.array([[up, up, np.inf]]))]

    start = np.array([[0.0, 0.0, np.median(low[:, 2])]])
    rise = solve(evaluate, {"floor": start}).parameters["floor"][0, :2]
    return np.append(-rise, 1.0)


def measure_places(rig: CameraRig, points: FrontierPoints) -> tuple[np.ndarray, np.ndarray]:
    """Return the frames (F,) in which points are seen and the person's places (F, 2) on the floor
    in these, m."""
    places, frames = triangulate_points(rig, points)[:, :2], np.unique(points.frames)
    middles = [np.median(places[points.frames == frame], axis=0) for frame in frames]
    return frames, np.array(middles).reshape(-1, 2)


def measure_path(places: np.ndarray) -> float:
    """Return the standard deviation of the person's places (F, 2) on the floor along the direction
    in which it is greatest, m."""
    return float(np.sqrt(np.linalg.eigvalsh(np.cov(places.T))[-1])) if len(places) > 1 else 0.0


def _frame_extremes(places: np.ndarray, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the second lowest and the second highest place (F, 3) of every frame with four or
    more; the outermost ones are more often wrong."""
    low, top = [], []
    for frame in np.unique(frames):
        frame_places = places[frames == frame]
        if len(frame_places) >= 4:
            order = np.argsort(frame_places[:, 2])
            low.append(frame_places[order[1]])
            top.append(frame_places[order[-2]])
    return np.array(low).reshape(-1, 3), np.array(top).reshape(-1, 3)


def measure_floor(
    rig: CameraRig, contours: Sequence[SilhouetteContours], shifts: np.ndarray,
    frames: np.ndarray, places: np.ndarray,
) -> float:  # fmt: skip
    """Return the height of the floor, m, of cameras with Z up, searched around Z = 0; zero if
    nothing is seen there.

    On the floor the silhouettes of all cameras agree about the feet, and about the person's shadow
    if they show it; a few centimetres above or below, each camera sees the shadow elsewhere (planar
    homographies: Khan & Shah, ECCV 2006). So the largest slice of the visual hull is at the floor
    if it is that of a shadow: wider than a foot, and larger than the slices above. Without a
    shadow, slices grow from the soles upwards, and the floor is below them.

    contours: of each camera, whose frame is `frames` (F,) + shifts[view]. places: (F, 2) the person
    on the floor in these frames.
    """
    steps = np.arange(-_AROUND, _AROUND + _STEP, _STEP)
    sides = np.arange(-_SIDE, _SIDE + _CELL, _CELL)
    grid = np.stack(np.meshgrid(steps, sides, sides, indexing="ij"), axis=-1)[..., [1, 2, 0]]
    areas, widths = [], []
    for index in pick_evenly(len(frames)):
        place = np.append(places[index], 0)
        slices = _carve(rig, contours, shifts + frames[index], grid + place)
        areas.append(slices.sum(axis=(1, 2)))
        largest = np.pad(slices[areas[-1].argmax()].view(np.uint8), 1)
        widths.append(2 * _CELL * cv2.distanceTransform(largest, cv2.DIST_L2, 3).max())
    total = np.sum(areas, axis=0)
    if not total.any():
        return 0.0
    width, largest = np.average(widths, weights=np.max(areas, axis=1)), total.argmax()
    above = np.searchsorted(steps, steps[largest] + _ABOVE).clip(max=len(steps) - 1)
    if width > _FOOT and total[above] < _THIN * total[largest]:
        return float(steps[largest])
    return float(steps[np.argmax(total > _LOWEST * total.max())])


def _carve(
    rig: CameraRig, contours: Sequence[SilhouetteContours], frames: np.ndarray, grid: np.ndarray
) -> np.ndarray:
    """Return which points (..., 3) m lie in the silhouettes of all cameras that see them, three or
    more, in the cameras' frames (V,)."""
    points = grid.reshape(-1, 3)
    outside, seen = np.zeros(len(points), bool), np.zeros(len(points), int)
    for camera, view_contours, frame in zip(rig, contours, frames, strict=True):
        mask = _fill(camera, view_contours, frame)
        if mask is not None:
            visible, rows, columns, _ = camera.look_up(points)
            outside[visible] |= mask[rows, columns] == 0
            seen += visible
    return (~outside & (seen >= 3)).reshape(grid.shape[:-1])


def _fill(camera: Camera, contours: SilhouetteContours, frame: int) -> np.ndarray | None:
    """Return the silhouette (h, w) uint8 inside a frame's contour; None without one."""
    first, last = np.searchsorted(contours.frames, [frame, frame + 1])
    if first == last:
        return None
    mask = np.zeros(camera.size[::-1], np.uint8)
    cv2.fillPoly(mask, [contours.points[first:last].astype(np.int32)], 1)
    return mask
