"""Read intrinsics from a calibration file, take them from metadata, or estimate them from each
camera's pictures of the board."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cl import InputError, MissingFileError
from psfs.calibration.start.placing import default_camera, estimate_camera_from_boards
from psfs.calibration.targets.detection import Finder
from psfs.calibration.targets.target import Sighting
from psfs.cameras.calibration import find_calibration, read_calibration
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import contains_name, join_names, match_files_to_cameras
from psfs.common.ranges import check_number
from psfs.footage.lens import StatedLens, read_lens
from psfs.footage.media import list_media, open_media

#: Most pictures of a camera that are searched, and fewest that must show the board.
_MOST, _FEWEST = 120, 4


def read_intrinsics(path: Path, rig: CameraRig, finder: Finder | None) -> list[Camera]:
    """Read the intrinsics of the rig's cameras from `path`.

    path: a calibration in any supported format, or a folder with one video or folder of pictures of
    the board per camera. Raises InputError naming the camera that it does not fit.
    """
    if not path.exists():
        raise MissingFileError(f"{path}: no such file or folder; expected intrinsics")
    if path.is_dir() and find_calibration(path) is None:
        return [_estimate_from_pictures(path, camera, finder) for camera in rig]
    calibration = path if path.is_file() else find_calibration(path)
    assert calibration is not None
    sizes = {camera.name: camera.size for camera in rig}

    def find_sizes(names: Sequence[str]) -> list[tuple[int, int]]:
        pairs, _ = match_files_to_cameras(rig.names, list(names), str(path), rig.names)
        by_file = {file: sizes[name] for name, file in pairs.items()}
        return [by_file.get(name, rig[0].size) for name in names]

    read = read_calibration(calibration, sizes=find_sizes)
    pairs, _ = match_files_to_cameras(rig.names, read.names, str(path), rig.names)
    cameras = []
    for name in rig.names:
        camera = read[read.names.index(pairs[name])]
        if camera.size != sizes[name]:
            raise InputError(
                f"{path}: camera {name} is calibrated for {camera.size[0]} x {camera.size[1]} "
                f"pixels; its pictures have {sizes[name][0]} x {sizes[name][1]}"
            )
        cameras.append(replace(camera, name=name, R=np.eye(3), t=np.zeros(3)))
    return cameras


def make_cameras_by_angle(rig: CameraRig, degrees: float) -> list[Camera]:
    """Return the rig's cameras with the angle of view, degrees, of the pictures' longer side, and
    without distortion. Raises InputError for an angle that no such lens has."""
    check_number("--field-of-view, degrees,", degrees, 5, 150)
    share = 0.5 / np.tan(np.radians(0.5 * degrees))
    return [default_camera(camera.name, camera.size, share) for camera in rig]


def make_cameras_by_metadata(
    rig: CameraRig, pictures: Mapping[str, Path]
) -> tuple[list[Camera], dict[str, StatedLens]]:
    """Return the rig's cameras without distortion, with the focal lengths that a picture or video
    of each states, by camera, and what these say. Raises InputError naming those that state none.
    """
    lenses = {name: read_lens(path) for name, path in pictures.items()}
    stated = {name: lens for name, lens in lenses.items() if lens is not None}
    silent = [str(pictures[name]) for name in pictures if name not in stated]
    if silent:
        raise InputError(f"{join_names(silent)}: no focal length in the metadata")
    return [default_camera(c.name, c.size, stated[c.name].share) for c in rig], stated


def _estimate_from_pictures(folder: Path, camera: Camera, finder: Finder | None) -> Camera:
    """Estimate a camera's intrinsics from its pictures of the board in the folder."""
    if finder is None or not finder.target.planar:
        raise InputError(
            f"{folder}: holds no calibration; expected one, since pictures of a board can be used "
            "with --board only"
        )
    media = list_media(folder)
    names = [name for name in media if contains_name(name, camera.name)]
    if len(names) != 1:
        raise InputError(
            f"{folder}: {len(names)} videos or folders of pictures are named after {camera.name}; "
            f"expected one (found {', '.join(media) or 'none'})"
        )
    pictures = open_media(camera.name, media[names[0]])
    if pictures.size != camera.size:
        raise InputError(
            f"{pictures.where}: {pictures.size[0]} x {pictures.size[1]} pixels; expected "
            f"{camera.size[0]} x {camera.size[1]} as in the other pictures of {camera.name}"
        )
    sightings = []
    for frame, picture in enumerate(pictures.frames(pictures.spread(_MOST))):
        seen = finder(0, picture)
        if seen is not None:
            sightings.append(Sighting(frame, 0, *seen))
    if len(sightings) < _FEWEST:
        raise InputError(
            f"{pictures.where}: the {finder.target.name} is found in {len(sightings)} pictures; "
            f"expected {_FEWEST} or more"
        )
    return estimate_camera_from_boards(camera.name, camera.size, finder.target, sightings)
