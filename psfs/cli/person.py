"""`psfs calibrate FOLDER --person -o OUT`: cameras and times from somebody who walks about."""

from __future__ import annotations

from pathlib import Path
from threading import Event

import numpy as np
from rich.table import Table

from cl import InputError, select_device
from psfs.calibration.intrinsics import (
    make_cameras_by_angle,
    make_cameras_by_metadata,
    read_intrinsics,
)
from psfs.calibration.targets.detection import open_uncalibrated
from psfs.cameras.calibration import find_calibration
from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import join_names, match_files_to_cameras
from psfs.cameras.rig_geometry import transfer_poses
from psfs.cli.commandline import make_table, progress_bar, remark, stdout, warn
from psfs.common.files import write_json
from psfs.common.progress import map_in_threads
from psfs.common.requests import write_settings
from psfs.common.system import versions
from psfs.diagnostics.small_views import LARGE_SIDE, Outline
from psfs.footage.media import IMAGE_SUFFIXES, VIDEO_SUFFIXES, list_media
from psfs.footage.settings import SequenceSettings
from psfs.request import CALIBRATION, REPORT, PersonRequest
from psfs.self_calibration.calibrator import (
    PersonCalibration,
    calibrate_by_person,
    check_number_of_cameras,
)
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.footage import (
    estimate_empty_scene,
    extract_outlines,
    find_empty_edges,
)
from psfs.sequence import Sequence

#: Standard deviation of the logarithm of a focal length that an angle of view states.
_FOCAL = 0.1
_EXPECTED = (
    "expected --intrinsics PATH, a calibration of which only the lenses are taken, as psfs "
    "calibrate --board writes, or a folder with a photo by each camera; or --field-of-view "
    "DEGREES, of the pictures' longer side: see docs/from_phones.md"
)


def calibrate_from_person(request: PersonRequest) -> None:
    """Estimate the cameras of a folder from the person in it, and write them."""
    views, large, config = open_person_footage(request)
    check_number_of_cameras(len(large))
    small, outlines, edges = outline_footage(request, views, large, config)
    with progress_bar() as bar:
        found = calibrate_by_person(
            small, outlines, edges, views.fps, config,
            lambda items, total, name: bar.track(items, total, description=name),
        )  # fmt: skip
    rig = transfer_poses(large, small, found.rig)
    verdict = f"silhouettes differ by at most {found.misfits.max():.2f} px"
    write_person_calibration(request, views, rig, found, config, verdict)


def open_person_footage(request: PersonRequest) -> tuple[Sequence, list[Camera], PersonConfig]:
    """Open the folder of uncalibrated cameras, with the empty scene or masks where it has some, and
    return it, the cameras with their lenses, and the settings of `[person]` with the stature of
    --stature, if it is stated, and with lenses to be refined, if these are known by an angle."""
    folder, stated = Path(request.folder or ""), request.capture
    settings = SequenceSettings(cameras=stated.cameras, fps=stated.fps, sync={})
    views = open_uncalibrated(folder, settings, silhouettes=True)
    for note in views.notes:
        remark("note", "cyan", note)
    cameras, lenses_known = _read_lenses(request, views)
    config, stature = request.person_settings, request.stature
    config = config if stature is None else config.replace(stature=stature)
    return views, cameras, config if lenses_known else config.replace(focal=_FOCAL)


def outline_footage(
    request: PersonRequest, views: Sequence, large: list[Camera], config: PersonConfig
) -> tuple[list[Camera], list[list[Outline | None]], list[np.ndarray]]:
    """Return the cameras, scaled to small pictures, the person's outlines in these [view][frame],
    and the straight edges (N, 2, 2) px of the empty room in each."""
    device = select_device(request.device)
    factor = views.rig.factor_within(LARGE_SIDE)
    small = [camera.scaled(factor) for camera in large]
    most = config.most_frames
    media = views.footage.masks or views.footage.images or ()
    stopped = Event()
    with progress_bar() as bar:
        task = bar.add_task("silhouettes", total=sum(min(most, own.count) for own in media))

        def extract(view: int) -> tuple[list[Outline | None], np.ndarray]:
            found, footage = [], views.footage
            empty = estimate_empty_scene(footage, view)
            for outline in extract_outlines(footage, view, empty, factor, device, config):
                if stopped.is_set():
                    break
                found.append(outline)
                bar.advance(task)
            return found, find_empty_edges(empty, factor)

        try:
            outlines, edges = zip(*map_in_threads(extract, range(len(small))), strict=True)
            return small, list(outlines), list(edges)
        finally:
            stopped.set()


def write_person_calibration(
    request: PersonRequest, views: Sequence, rig: CameraRig, found: PersonCalibration,
    config: PersonConfig, verdict: str,
) -> None:  # fmt: skip
    """Write the calibration and its report, and print them."""
    out = request.output or Path()
    warnings = []
    if request.stature is None:
        warnings.append(
            f"no --stature is stated: the person is taken to be {config.stature:g} m tall, which "
            "gives the scale"
        )
    if not found.levelled:
        warnings.append(
            "no clear vertical edges of a room are seen: up is the person's and may be some "
            "degrees off; lay a board or a wand on the floor where that matters"
        )
    late = views.timing.count_own_frames((found.lags - min(found.lags)).tolist())
    sync = ",".join(f"{camera.name}={by}" for camera, by in zip(rig, late, strict=True))
    write_toml_tables(out / CALIBRATION, rig)
    report = _summary(request, rig, found, config)
    write_json(out / REPORT, {"verdict": verdict, "sync": sync, **report, "warnings": warnings})
    write_settings(out, request.replace(person_settings=config), ["person_settings"])
    stdout.print(_table(rig, found))
    for text in warnings:
        warn(text, stdout)
    stdout.print(f"{verdict}; wrote {out}")
    stdout.print(
        f"$ apf track {request.folder} --calibration {out / CALIBRATION} --sync {sync} -o OUT"
    )


def _summary(
    request: PersonRequest, rig: CameraRig, found: PersonCalibration, config: PersonConfig
) -> dict[str, object]:
    return {
        "folder": str(request.folder),
        "intrinsics": None if request.intrinsics is None else str(request.intrinsics),
        "field_of_view_degrees": request.field_of_view,
        "stature_m": config.stature,
        "frontier_points": found.count,
        "residual_px": round(found.residual, 4),
        "path_m": round(found.path, 3),
        "up_from": "room" if found.levelled else "person",
        "cameras": {
            camera.name: {
                **_uncertainty(found, view),
                "late_frames": round(float(lag), 3),
                "position_m": camera.centre.round(4).tolist(),
                "focal_px": round(float(camera.K[0, 0]), 2),
                "misfit_px": round(float(misfit), 3),
            }
            for view, (camera, lag, misfit) in enumerate(
                zip(rig, found.lags, found.misfits, strict=True)
            )
        },
        "versions": versions(),
    }


def _uncertainty(found: PersonCalibration, view: int) -> dict[str, float]:
    """Return the standard deviations of a camera's direction and position, if they are known."""
    if found.turns is None or found.shifts is None:
        return {}
    return {
        "direction_sigma_degrees": round(float(np.degrees(found.turns[view])), 3),
        "position_sigma_percent": round(100 * float(found.shifts[view]), 3),
    }


def _table(rig: CameraRig, found: PersonCalibration) -> Table:
    columns = ("late, frames", "position, m", "misfit, px")
    table = make_table("Cameras from the person", ["camera"], columns)
    for camera, lag, misfit in zip(rig, found.lags, found.misfits, strict=True):
        place = ", ".join(f"{value:.2f}" for value in camera.centre)
        table.add_row(camera.name, f"{lag:+.2f}", place, f"{misfit:.2f}")
    return table


def _read_lenses(request: PersonRequest, views: Sequence) -> tuple[list[Camera], bool]:
    """Return the cameras with the intrinsics of --intrinsics, --field-of-view or the metadata of
    photos or of the footage, and whether these are kept, rather than refined."""
    if request.intrinsics is not None and request.field_of_view is not None:
        raise InputError("--intrinsics and --field-of-view; expected one of them")
    if request.field_of_view is not None:
        return make_cameras_by_angle(views.rig, request.field_of_view), False
    path: Path | None = request.intrinsics
    if path is None:
        images = views.footage.images or ()
        return _read_metadata(views, {media.name: media.paths[0] for media in images}), False
    if path.suffix.lower() in IMAGE_SUFFIXES | VIDEO_SUFFIXES and path.is_file():
        raise InputError(f"{path}: a picture or video; {_EXPECTED}")
    if path.is_dir() and find_calibration(path) is None:
        photos = list_media(path)  # or videos
        if not photos:
            raise InputError(f"{path}: holds no calibration and no photos; {_EXPECTED}")
        names = views.rig.names
        pairs, _ = match_files_to_cameras(names, list(photos), str(path), names)
        return _read_metadata(views, {name: photos[pairs[name]][0] for name in names}), False
    return read_intrinsics(path, views.rig, None), True


def _read_metadata(views: Sequence, pictures: dict[str, Path]) -> list[Camera]:
    try:
        cameras, stated = make_cameras_by_metadata(views.rig, pictures)
    except InputError as error:
        raise InputError(
            f"no lenses are stated ({error}, which iPhones' videos and most photos have); "
            f"{_EXPECTED}"
        ) from None
    angles = join_names(
        f"{name} {lens.degrees:.0f} degrees ({lens.source})" for name, lens in stated.items()
    )
    text = "angles of view by metadata, to be refined: "
    remark("note", "cyan", f"{text}{angles}; a video that is stabilised shows up to a fifth less")
    return cameras
