"""Place cameras by markers whose positions a motion-capture system measured (C3D)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from cl import InputError
from psfs.calibration.scene import CalibrationScene, place_camera, rigid_transform
from psfs.calibration.start.board import choose_best_pose
from psfs.calibration.start.placing import FOCALS, with_focal_length
from psfs.calibration.targets.target import Sighting, Target, group_by_view, make_wand
from psfs.cameras.camera import Camera
from psfs.cameras.names import join_names
from psfs.common.c3d import read_c3d_points

#: Inlier thresholds, px: with a known lens, and with a guessed one.
_INLIER_PX, _GUESSED_LENS_INLIER_PX = 4.0, 15.0
#: Fewest frames in which a camera must see the markers.
_FEWEST = 6


def read_measured_wand(
    path: Path, markers: Sequence[str] | None, frames: Sequence[int], fps: float, begins: float
) -> Target:
    """Read the positions, m, of the wand's markers in the frames from a C3D file.

    markers: their names along the wand; default: all of the file, if two or three. fps: frames per
    second of the pictures. begins: time of the file's start after the first picture, s. Raises
    InputError if the file is not C3D or lacks these markers.
    """
    recording = read_c3d_points(path)
    names, rate = recording.names, recording.rate
    chosen = list(markers if markers is not None else names)
    missing = [name for name in chosen if name not in names]
    if missing or not 2 <= len(chosen) <= 3:
        wrong = f"no marker {join_names(missing)}" if missing else f"{len(chosen)} markers"
        raise InputError(
            f"{path}: {wrong} (it has {join_names(names)}); expected the names of the wand's two "
            "or three markers"
        )
    rows = [names.index(name) for name in chosen]
    places = recording.positions[:, rows]
    known = {}
    for frame in frames:
        at = (frame / fps - begins) * rate
        low = int(np.floor(at + 1e-6))
        share = max(0.0, at - low)
        if low < 0 or low + (share > 1e-6) >= len(places):
            continue
        here = places[low] if share <= 1e-6 else (1 - share) * places[low] + share * places[low + 1]
        if np.isfinite(here).all():
            known[frame] = here
    if not known:
        raise InputError(
            f"{path}: {len(places)} frames at {rate:g} per second hold the markers "
            f"{join_names(chosen)} at the time of no picture; expected some"
        )
    lengths = np.linalg.norm(np.diff(np.stack(list(known.values())), axis=1), axis=-1)
    return replace(make_wand([float(length) for length in np.median(lengths, axis=0)]), known=known)


def place_cameras_by_markers(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    lenses_known: bool,
) -> tuple[CalibrationScene, list[Sighting]]:
    """Place the cameras in the frame of the measured markers.

    Returns them with the sightings, their points in the order that fits. Raises InputError for a
    camera that does not see enough of the markers.
    """
    assert target.known is not None
    rig = []
    for camera, group in zip(cameras, group_by_view(sightings, len(cameras)), strict=True):
        if len(group) < _FEWEST:
            raise InputError(
                f"too few views: {camera.name} sees the measured markers in {len(group)} frames; "
                f"expected {_FEWEST} or more"
            )
        rig.append(_place_by_markers(camera, target, group, lenses_known))
    poses = {frame: np.eye(4) for frame in target.known}
    ordered = []
    for sighting in sightings:
        ordered += choose_best_pose(rig, target, [sighting], [np.eye(4)])[1]
    return CalibrationScene(tuple(rig), target, poses), ordered


def _place_by_markers(
    camera: Camera, target: Target, sightings: Sequence[Sighting], lens_known: bool
) -> Camera:
    """Place a camera where most markers agree with it, by RANSAC over the possible orders of
    points.

    Of an unknown lens the focal length with most inliers is taken.
    """
    assert target.known is not None
    points = np.concatenate(
        [target.known[s.frame][order] for s in sightings for order in target.orders]
    )
    pixels = np.concatenate([s.pixels for s in sightings for _ in target.orders])
    best: tuple[int, Camera] | None = None
    for share in (None,) if lens_known else FOCALS:
        tried = camera if share is None else with_focal_length(camera, share)
        cv2.setRNGSeed(0)
        solved, turn, shift, inliers = cv2.solvePnPRansac(
            points, pixels, tried.K, tried.distortion, iterationsCount=500, confidence=0.9999,
            reprojectionError=_INLIER_PX if lens_known else _GUESSED_LENS_INLIER_PX,
            flags=cv2.SOLVEPNP_SQPNP,
        )  # fmt: skip
        if solved and inliers is not None and (best is None or len(inliers) > best[0]):
            best = len(inliers), place_camera(tried, rigid_transform(turn, shift))
    if best is None or best[0] < len(sightings):
        raise InputError(
            f"the markers that {camera.name} sees are not where the C3D file has them; expected "
            "pictures and file that begin together (or the time between), and a wand that is the "
            "only bright thing that moves"
        )
    return best[1]
