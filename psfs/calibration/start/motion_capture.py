"""Markers whose places a motion-capture system measured (C3D): cameras in its frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cl import InputError, MissingFileError
from psfs.calibration.scene import Scene, placed, rigid
from psfs.calibration.start.board import best_pose
from psfs.calibration.targets.target import Sighting, Target, by_view, wand
from psfs.cameras.camera import Camera
from psfs.cameras.names import listed
from psfs.cameras.units import metres_per_unit

#: Focal lengths that are tried where none is known, of the longer side of the picture.
_FOCALS = np.geomspace(0.5, 3.0, 25)
#: Errors of points that agree with a place, px, and of those that nearly agree with a guessed lens.
_AGREES, _NEARLY = 4.0, 15.0
#: Frames of which a camera must see the markers.
_FEWEST = 6


def measured_wand(
    path: Path, markers: Sequence[str] | None, frames: Sequence[int], fps: float, begins: float
) -> Target:
    """Return the wand with the places, m, that a C3D file gives its markers in the frames.

    markers: their names along the wand; all of the file where there are two or three. fps: frames
    per second of the pictures; begins: s after the first of them at which the file does. Raises
    InputError for a file that is no C3D, or has not these markers.
    """
    names, points, rate, unit = _read(path)
    chosen = list(markers) if markers is not None else names
    missing = [name for name in chosen if name not in names]
    if missing or not 2 <= len(chosen) <= 3:
        wrong = f"no marker {listed(missing)}" if missing else f"{len(chosen)} markers"
        raise InputError(
            f"{path}: {wrong} (it has {listed(names)}); expected the names of the wand's two or "
            "three markers"
        )
    rows = [names.index(name) for name in chosen]
    places = metres_per_unit(unit) * points[:, rows]
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
            f"{path}: {len(points)} frames at {rate:g} per second hold the markers "
            f"{listed(chosen)} at the time of no picture; expected some"
        )
    lengths = np.linalg.norm(np.diff(np.stack(list(known.values())), axis=1), axis=-1)
    return replace(wand([float(length) for length in np.median(lengths, axis=0)]), known=known)


def _read(path: Path) -> tuple[list[str], np.ndarray, float, str]:
    """Return names, points (F, P, 3), NaN where missing, rate and unit of a C3D file."""
    import ezc3d  # takes a while to load

    if not path.is_file():
        raise MissingFileError(f"{path}: no such file; expected a C3D file")
    try:
        file: Any = ezc3d.c3d(str(path))
        group = file["parameters"]["POINT"]
        names = [str(name) for name in group["LABELS"]["value"]]
        rate, unit = float(group["RATE"]["value"][0]), str(group["UNITS"]["value"][0])
        points = np.asarray(file["data"]["points"])[:3].transpose(2, 1, 0).astype(float)
        residuals = np.asarray(file["data"]["meta_points"]["residuals"])[0].T
    except (OSError, KeyError, IndexError, ValueError, RuntimeError) as error:
        raise InputError(f"{path}: cannot be read as C3D: {error}") from None
    if rate <= 0 or points.shape[1] < len(names):
        raise InputError(f"{path}: {points.shape[1]} markers at {rate:g} Hz; expected a C3D file")
    points[residuals < 0] = np.nan
    return names, points, rate, unit


def scene_in_frame(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    lenses_known: bool,
) -> tuple[Scene, list[Sighting]]:
    """Return the cameras in the frame of the measured markers; and the sightings with their points
    in the order that fits. Raises InputError for a camera that does not see enough of them."""
    assert target.known is not None
    rig = []
    for camera, own in zip(cameras, by_view(sightings, len(cameras)), strict=True):
        if len(own) < _FEWEST:
            raise InputError(
                f"too few views: {camera.name} sees the measured markers in {len(own)} frames; "
                f"expected {_FEWEST} or more"
            )
        rig.append(_placed(camera, target, own, lenses_known))
    poses = {frame: np.eye(4) for frame in target.known}
    ordered = []
    for sighting in sightings:
        ordered += best_pose(rig, target, [sighting], [np.eye(4)])[1]
    return Scene(tuple(rig), poses), ordered


def _placed(
    camera: Camera, target: Target, sightings: Sequence[Sighting], lens_known: bool
) -> Camera:
    """Return the camera where most of the markers agree with it, by RANSAC over the orders in which
    it may have taken them; of an unknown lens, with the focal length of the best."""
    assert target.known is not None
    points = np.concatenate(
        [target.known[s.frame][order] for s in sightings for order in target.orders]
    )
    pixels = np.concatenate([s.pixels for s in sightings for _ in target.orders])
    best: tuple[int, Camera] | None = None
    for share in (None,) if lens_known else _FOCALS:
        tried = camera
        if share is not None:
            K = camera.K.copy()
            K[0, 0] = K[1, 1] = share * max(camera.size)
            tried = replace(camera, K=K)
        cv2.setRNGSeed(0)
        found, turn, shift, inliers = cv2.solvePnPRansac(
            points, pixels, tried.K, tried.distortion, iterationsCount=500, confidence=0.9999,
            reprojectionError=_AGREES if lens_known else _NEARLY, flags=cv2.SOLVEPNP_SQPNP,
        )  # fmt: skip
        if found and inliers is not None and (best is None or len(inliers) > best[0]):
            best = len(inliers), placed(tried, rigid(turn, shift))
    if best is None or best[0] < len(sightings):
        raise InputError(
            f"the markers that {camera.name} sees are not where the C3D file has them; expected "
            "pictures and file that begin together (or the time between), and a wand that is the "
            "only bright thing that moves"
        )
    return best[1]
