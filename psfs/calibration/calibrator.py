"""From sightings of a board or wand to cameras: a start, bundle adjustment, who disagrees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cl import InputError
from psfs.calibration.bundle import Freedom, adjusted
from psfs.calibration.config import CalibrationConfig
from psfs.calibration.consistency import lens_change, lens_misfits, odd_one, reason, trials
from psfs.calibration.scene import Scene, all_errors, errors, rms
from psfs.calibration.start.board import board_scene
from psfs.calibration.start.lenses import camera_from_boards, usual_camera
from psfs.calibration.start.motion_capture import scene_in_frame
from psfs.calibration.start.placing import check_linked, shared_frames, spanning_pairs
from psfs.calibration.start.wand import likely_cameras, wand_scene
from psfs.calibration.targets.target import Sighting, Target, by_frame, by_view
from psfs.cameras.camera import Camera
from psfs.cameras.names import listed

#: Share of a camera's sightings that may be false detections; more of them mean that the camera
#: disagrees.
_FALSE = 0.1
#: px root mean square beyond which nothing was calibrated.
_HOPELESS = 20.0


@dataclass(frozen=True, eq=False)
class Calibrated:
    """What was found. scene: cameras and poses. sightings: those that counted. dropped: how many
    did not, by camera. disagreeing: why cameras do not agree with the others, by name; the others
    were calibrated without them, and they were placed where they fit best. misfits: the same of
    given intrinsics; these cameras counted. shared: frames that pairs of cameras share (V, V)."""

    scene: Scene
    target: Target
    sightings: list[Sighting]
    dropped: dict[str, int]
    disagreeing: dict[str, str]
    misfits: dict[str, str]
    shared: np.ndarray

    def turned(self, world: np.ndarray) -> Calibrated:
        """Return the same in another world, x' = world x, (4, 4)."""
        return replace(self, scene=self.scene.turned(world))


def calibrated(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    lenses_known: bool,
    config: CalibrationConfig,
) -> Calibrated:
    """Return the cameras, placed, by what they saw of the target.

    cameras: names, sizes and, with `lenses_known`, intrinsics that are kept. Raises InputError
    where that does not suffice.
    """
    names = [camera.name for camera in cameras]
    if target.known is not None:
        sightings = [s for s in sightings if s.frame in target.known]
    shared = shared_frames(sightings, len(cameras))
    scene, ordered = _start(cameras, target, sightings, shared, lenses_known, config)
    everyone = tuple(range(len(cameras)))
    held = _anchor(shared, target)
    freedom = Freedom(() if lenses_known else everyone, held)
    freedom = replace(freedom, poses=target.known is None)
    scene = adjusted(scene, target, ordered, freedom, config)
    kept = _without_false(scene, target, ordered, config)
    if len(kept) < len(ordered):
        scene = adjusted(scene, target, kept, freedom, config)
    scene, agreeing, disagreeing = _agreed(scene, target, kept, freedom, names, config)
    if rms(np.minimum(all_errors(scene, target, agreeing), 1e3)) > _HOPELESS:
        raise InputError(
            f"the sightings of the {target.name} fit no arrangement of the cameras; expected "
            "pictures of the same time, one rigid target of the stated size, cameras that stay"
        )
    misfits: dict[str, str] = {}
    if lenses_known:
        views = [view for view in everyone if names[view] not in disagreeing]
        wanted = lens_misfits(scene, target, agreeing, views, config)
        misfits = {names[v]: lens_change(cameras[v], wanted[v]) for v in wanted}
    dropped = [len(of) for of in by_view(ordered, len(cameras))]
    for view, own in enumerate(by_view(kept, len(cameras))):
        dropped[view] -= len(own)
    fitting = [s for s in kept if s.frame in scene.poses]
    return Calibrated(
        scene, target, fitting, dict(zip(names, dropped, strict=True)), disagreeing, misfits, shared
    )


def _start(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    shared: np.ndarray,
    lenses_known: bool,
    config: CalibrationConfig,
) -> tuple[Scene, list[Sighting]]:
    """Return where cameras and target are, roughly, and the sightings in order."""
    names = [camera.name for camera in cameras]
    blind = [name for name, count in zip(names, np.diag(shared), strict=True) if not count]
    if blind:
        raise InputError(
            f"{listed(blind)}: the {target.name} is in none of the pictures; expected it in all "
            "cameras' (or --cameras without these)"
        )
    own = by_view(sightings, len(cameras))
    if not lenses_known and target.planar:
        cameras = [
            camera_from_boards(camera.name, camera.size, target, of)
            for camera, of in zip(cameras, own, strict=True)
        ]
    elif not lenses_known:
        cameras = [usual_camera(camera.name, camera.size) for camera in cameras]
    if target.known is not None:
        return scene_in_frame(cameras, target, sightings, lenses_known)
    if len(cameras) < 2:
        raise InputError("a single camera; expected two or more that see the target together")
    fewest = config.shared_boards if target.planar else config.shared_wands
    check_linked(shared, fewest, names, target.name)
    pairs = spanning_pairs(shared, fewest)
    if target.planar:
        return board_scene(cameras, target, sightings, pairs)
    if not lenses_known:
        cameras = likely_cameras(cameras, target, sightings, pairs)
    return wand_scene(cameras, target, sightings, pairs, names)


def _anchor(shared: np.ndarray, target: Target) -> tuple[int, ...]:
    """Return the camera that stays where it is, while the world has no axes yet."""
    if target.known is not None:
        return ()
    return (int((shared - np.diag(np.diag(shared))).sum(axis=1).argmax()),)


def _without_false(
    scene: Scene, target: Target, sightings: Sequence[Sighting], config: CalibrationConfig
) -> list[Sighting]:
    """Return the sightings without those that are far off, but for cameras with many such."""
    kept: list[Sighting] = []
    for own in by_view(sightings, len(scene.cameras)):
        near = [s for s in own if np.median(errors(scene, target, s)) < config.outlier]
        kept += near if len(near) >= (1 - _FALSE) * len(own) else own
    enough = 1 if target.planar or target.known is not None else 2
    counts = {frame: len(here) for frame, here in by_frame(kept).items()}
    return [s for s in kept if counts[s.frame] >= enough]


def _agreed(
    scene: Scene,
    target: Target,
    sightings: list[Sighting],
    freedom: Freedom,
    names: Sequence[str],
    config: CalibrationConfig,
) -> tuple[Scene, list[Sighting], dict[str, str]]:
    """Return the scene by the cameras that agree, and their sightings; the others are placed where
    they fit best, and why they disagree is said by name."""
    views = list(range(len(names)))
    disagreeing: dict[str, str] = {}
    while (odd := odd_one(trials(scene, target, sightings, views, config), config)) is not None:
        views.remove(odd.view)
        agreeing = [s for s in sightings if s.view in views]
        counts = {frame: len(here) for frame, here in by_frame(agreeing).items()}
        enough = 1 if target.planar or target.known is not None else 2
        agreeing = [s for s in agreeing if counts[s.frame] >= enough]
        lenses = tuple(view for view in freedom.lenses if view in views)
        anchor = freedom.held and (views[0],)
        held = (*anchor, *(v for v in range(len(names)) if v not in views))
        scene = adjusted(scene, target, agreeing, Freedom(lenses, held, freedom.poses), config)
        others = tuple(view for view in range(len(names)) if view != odd.view)
        own = [s for s in sightings if s.view == odd.view and s.frame in scene.poses]
        scene = adjusted(scene, target, own, Freedom((), others, poses=False), config)
        why = reason(replace(odd, scene=scene), target, own, config)
        disagreeing[names[odd.view]] = f"{odd.own:.1f} px off what the others see; {why}"
    return scene, [s for s in sightings if s.view in views and s.frame in scene.poses], disagreeing
