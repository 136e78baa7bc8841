"""Calibrate cameras from sightings of a board or wand.

Find a start, adjust the bundle, reject false detections, and set aside cameras that disagree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cl import InputError
from psfs.calibration.bundle import FreeParameters, adjust_bundle
from psfs.calibration.consistency import (
    describe_lens_change,
    explain_disagreement,
    find_outlier_camera,
    find_wrong_intrinsics,
)
from psfs.calibration.scene import (
    OUTLIER,
    CalibrationScene,
    reprojection_errors,
    rms,
)
from psfs.calibration.start.board import place_cameras_by_board
from psfs.calibration.start.lenses import default_camera, estimate_camera_from_boards
from psfs.calibration.start.motion_capture import place_cameras_by_markers
from psfs.calibration.start.placing import (
    FEW_BOARDS,
    FEW_WANDS,
    check_linked,
    count_shared_frames,
    find_spanning_pairs,
)
from psfs.calibration.start.wand import estimate_focal_lengths, place_cameras_by_wand
from psfs.calibration.targets.target import Sighting, Target, group_by_view, select_shared
from psfs.cameras.camera import Camera
from psfs.cameras.names import join_names

#: Largest skew of known intrinsics, px, which moves pixels by less than a tenth of one.
_MOST_SKEW = 0.1
#: Share of a camera's sightings that may be false detections; with more, the camera disagrees.
_FALSE = 0.1


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """Result of a calibration.

    scene: cameras and target poses. sightings: those that were used. dropped: number of rejected
    sightings by camera. disagreeing: for each camera that disagrees with the others, why; the
    others were calibrated without it, and it was then placed where it fits best. misfits: for each
    camera whose given intrinsics do not fit, why; it was used nevertheless. shared: number of
    frames that each pair of cameras shares (V, V).
    """

    scene: CalibrationScene
    target: Target
    sightings: list[Sighting]
    dropped: dict[str, int]
    disagreeing: dict[str, str]
    misfits: dict[str, str]
    shared: np.ndarray

    def transform(self, world: np.ndarray) -> CalibrationResult:
        """Transform the result to another world, x' = world x, (4, 4)."""
        return replace(self, scene=self.scene.transform(world))


def calibrate_cameras(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    lenses_known: bool,
) -> CalibrationResult:
    """Estimate the cameras' poses, and their intrinsics unless these are known.

    cameras: names, sizes and, with `lenses_known`, intrinsics that are kept. Raises InputError if
    the sightings do not suffice.
    """
    names = [camera.name for camera in cameras]
    _check_lenses(cameras)
    if target.known is not None:
        sightings = [s for s in sightings if s.frame in target.known]
    shared = count_shared_frames(sightings, len(cameras))
    scene, ordered = _initialise(cameras, target, sightings, shared, lenses_known)
    everyone = tuple(range(len(cameras)))
    held = _choose_anchor(shared, target)
    freedom = FreeParameters(() if lenses_known else everyone, held)
    freedom = replace(freedom, poses=target.known is None)
    scene = adjust_bundle(scene, target, ordered, freedom)
    accepted = _reject_false(scene, target, ordered)
    if len(accepted) < len(ordered):
        scene = adjust_bundle(scene, target, accepted, freedom)
    scene, agreeing, disagreeing = _exclude_outlier_cameras(scene, target, accepted, freedom, names)
    error = rms(np.minimum(reprojection_errors(scene, target, agreeing), 1e3))
    if not error <= OUTLIER:  # also NaN, of no sighting at all
        raise InputError(
            f"the sightings of the {target.name} fit no arrangement of the cameras; expected "
            "pictures of the same time, one rigid target of the stated size, cameras that stay"
        )
    misfits: dict[str, str] = {}
    if lenses_known:
        views = [view for view in everyone if names[view] not in disagreeing]
        wanted = find_wrong_intrinsics(scene, target, agreeing, views)
        misfits = {names[v]: describe_lens_change(cameras[v], wanted[v]) for v in wanted}
    dropped = [len(group) for group in group_by_view(ordered, len(cameras))]
    for view, view_sightings in enumerate(group_by_view(accepted, len(cameras))):
        dropped[view] -= len(view_sightings)
    fitting = [s for s in accepted if s.frame in scene.poses]
    return CalibrationResult(
        scene, target, fitting, dict(zip(names, dropped, strict=True)), disagreeing, misfits, shared
    )


def _check_lenses(cameras: Sequence[Camera]) -> None:
    """Raise InputError for lenses that OpenCV's projection, which the bundle adjustment uses,
    ignores."""
    for camera in cameras:
        skew = camera.K[0, 1]
        if camera.kappa or camera.fisheye or abs(skew) > _MOST_SKEW:
            model = "Tsai's distortion" if camera.kappa else f"a skew of {skew:g} px"
            model = "a fisheye lens" if camera.fisheye else model
            raise InputError(
                f"the intrinsics of {camera.name} have {model}; expected k1, k2, p1, p2, k3 and no "
                "skew, or no --intrinsics"
            )


def _initialise(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    shared: np.ndarray,
    lenses_known: bool,
) -> tuple[CalibrationScene, list[Sighting]]:
    """Estimate the initial cameras and target poses; return the sightings in order of their
    points."""
    names = [camera.name for camera in cameras]
    blind = [name for name, count in zip(names, np.diag(shared), strict=True) if not count]
    if blind:
        raise InputError(
            f"{join_names(blind)}: the {target.name} is in none of the pictures; expected it in "
            "all cameras' (or --cameras without these)"
        )
    groups = group_by_view(sightings, len(cameras))
    if not lenses_known and target.planar:
        cameras = [
            estimate_camera_from_boards(camera.name, camera.size, target, view_sightings)
            for camera, view_sightings in zip(cameras, groups, strict=True)
        ]
    elif not lenses_known:
        cameras = [default_camera(camera.name, camera.size) for camera in cameras]
    if target.known is not None:
        return place_cameras_by_markers(cameras, target, sightings, lenses_known)
    if len(cameras) < 2:
        raise InputError("a single camera; expected two or more that see the target together")
    fewest = FEW_BOARDS if target.planar else FEW_WANDS
    check_linked(shared, fewest, names, target.name)
    pairs = find_spanning_pairs(shared, fewest)
    if target.planar:
        return place_cameras_by_board(cameras, target, sightings, pairs)
    if not lenses_known:
        cameras = estimate_focal_lengths(cameras, target, sightings, pairs)
    return place_cameras_by_wand(cameras, target, sightings, pairs, names)


def _choose_anchor(shared: np.ndarray, target: Target) -> tuple[int, ...]:
    """Return the camera that is held fixed while the world's axes are not yet defined."""
    if target.known is not None:
        return ()
    return (int((shared - np.diag(np.diag(shared))).sum(axis=1).argmax()),)


def _reject_false(
    scene: CalibrationScene,
    target: Target,
    sightings: Sequence[Sighting],
) -> list[Sighting]:
    """Reject sightings with large errors, except of cameras that have many of them."""
    accepted: list[Sighting] = []
    for group in group_by_view(sightings, len(scene.cameras)):
        good = [s for s in group if np.median(reprojection_errors(scene, target, [s])) < OUTLIER]
        least = (1 - _FALSE) * len(group)
        accepted += good if len(good) >= least else group
    return select_shared(accepted, _count_needed(target))


def _count_needed(target: Target) -> int:
    """Return how many cameras must see the target for its pose to be known."""
    return 1 if target.planar or target.known is not None else 2


def _exclude_outlier_cameras(
    scene: CalibrationScene,
    target: Target,
    sightings: list[Sighting],
    freedom: FreeParameters,
    names: Sequence[str],
) -> tuple[CalibrationScene, list[Sighting], dict[str, str]]:
    """Set aside, one at a time, the cameras that disagree with the others.

    Returns the scene estimated from the cameras that agree, their sightings, and why each of the
    others disagrees, by name; these are placed where they fit best. If half of the cameras or more
    disagree, no majority says which are wrong, and all are kept.
    """
    everything = scene, sightings, dict[str, str]()
    views = list(range(len(names)))
    disagreeing: dict[str, str] = {}
    used = sightings
    while (view := find_outlier_camera(scene, target, used, views)) is not None:
        views.remove(view)
        used = select_shared([s for s in sightings if s.view in views], _count_needed(target))
        lenses = tuple(other for other in freedom.lenses if other in views)
        anchor = freedom.held and (views[0],)
        held = (*anchor, *(v for v in range(len(names)) if v not in views))
        scene = adjust_bundle(scene, target, used, FreeParameters(lenses, held, freedom.poses))
        others = tuple(other for other in range(len(names)) if other != view)
        of_view = [s for s in sightings if s.view == view and s.frame in scene.poses]
        scene = adjust_bundle(scene, target, of_view, FreeParameters((), others, poses=False))
        disagreeing[names[view]] = explain_disagreement(scene, target, of_view)
        if 2 * len(disagreeing) >= len(names):
            return everything
    return scene, [s for s in sightings if s.view in views and s.frame in scene.poses], disagreeing
