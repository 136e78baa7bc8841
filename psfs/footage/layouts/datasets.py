"""Folders of published recordings: PARSEC's bodytrack, Utrecht's course, Middlebury's sets,
HumanEva.

HumanEva's (Sigal, Balan, Black 2010) is that of a subject; `take` chooses the take.

Image_Data/<take>_(<camera>).avi   Calibration_Data/<camera>.cal
    Sync_Data/<take>_(<camera>).ofs    Mocap_Data/<take>.c3d
    Background/Background*_(<camera>).avi, here, beside it or in Image_Data

A .cal is HumanEva's or Tsai's. An .ofs has three numbers: a frame of the video, the frame of the
motion capture at that time, and frames of the motion capture per frame of the video, both counted
from 1. The sequence begins when all videos have begun; a note says which frame of the motion
capture that is.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from cl import InputError
from psfs.cameras.calibration.common import Calibration, name_file_in_errors, parse_numbers
from psfs.cameras.calibration.filestorage import read_filestorage
from psfs.cameras.calibration.number_lists import looks_like_tsai, read_humaneva, read_tsai
from psfs.cameras.names import join_names, name_tokens, natural_key
from psfs.common.files import read_text
from psfs.footage.layouts.common import (
    Footage,
    Found,
    Layout,
    assemble,
    choose_cameras,
    measure_sizes,
    read_rig,
)
from psfs.footage.media import IMAGE_SUFFIXES, list_images
from psfs.footage.settings import SequenceSettings

#: The pelvis moves about 14 mm per frame, which suits a walk at 60 Hz; no file states the rate.
_BODYTRACK_FPS = 60.0
#: Of Utrecht's calibrations: checkerboard.xml says squares of 115 mm, but the boards in the
#: pictures fit about 151 units, so that one unit is 115 mm / 151.
_UTRECHT_UNIT = "0.76mm"


def _list_bodytrack(folder: Path, prefix: str) -> Found:
    """List the images by camera name: CAM1 and FG1 belong to Camera1.cal."""
    folders = [path for path in folder.glob(f"{prefix}[0-9]*") if path.is_dir()]
    folders.sort(key=lambda path: natural_key(path.name))
    images = {f"Camera{name_tokens(path.name)[-1]}": list_images(path) for path in folders}
    empty = [name for name, paths in images.items() if not paths]
    if empty:
        raise InputError(f"{folder}: no images for {', '.join(empty)} in {prefix}*")
    return images


def _read_bodytrack(folder: Path, settings: SequenceSettings) -> Footage:
    images, masks = _list_bodytrack(folder, "CAM"), _list_bodytrack(folder, "FG")
    rig = read_rig(folder / (settings.calibration or "CALIB"), settings, images, folder / "CAM*")
    guess = f"{_BODYTRACK_FPS:g} frames per second fit the walk; no file states them"
    return assemble(
        rig,
        settings,
        {"images": (images, folder / "CAM*"), "masks": (masks, folder / "FG*")},
        notes=[guess] if settings.fps == _BODYTRACK_FPS else [],
    )


def _list_utrecht(folder: Path, pattern: str) -> Found:
    paths = sorted(folder.glob(f"cam*/{pattern}"), key=lambda path: natural_key(str(path)))
    return {path.parent.name: [path] for path in paths}


def _read_utrecht(folder: Path, settings: SequenceSettings) -> Footage:
    videos, where = _list_utrecht(folder, "video.avi"), folder / "cam*" / "video.avi"
    if settings.calibration is None:
        files = _list_utrecht(folder, "config.xml")
        paths = [path for (path,) in files.values()]
        sizes = partial(measure_sizes, videos, where, settings)
        rig = read_filestorage(paths, settings.unit, sizes, list(files))
    else:
        rig = read_rig(folder / settings.calibration, settings, videos, where)
    note = f"the unit {_UTRECHT_UNIT} comes from a board of 115 mm that measures 151: uncertain"
    empty = _list_utrecht(folder, "background.avi")
    return assemble(
        rig,
        settings,
        {"images": (videos, where), "background": (empty, folder / "cam*" / "background.avi")},
        notes=[note] if settings.unit == _UTRECHT_UNIT else [],
    )


def _read_middlebury(folder: Path, settings: SequenceSettings) -> Footage:
    calibration = next(folder.glob("*_par.txt"))
    if settings.calibration is not None:
        calibration = folder / settings.calibration
    images = {
        path.stem: [path] for path in sorted(folder.iterdir()) if path.suffix in IMAGE_SUFFIXES
    }
    rig = read_rig(calibration, settings, images, folder)
    good = folder / calibration.name.replace("_par.txt", "_good_silhouette_images.txt")
    notes = []
    if settings.cameras is None and good.is_file() and good != calibration:
        lines = read_text(good, "names of pictures").splitlines()
        names = {Path(line.strip()).stem for line in lines}
        cameras = tuple(name for name in rig.names if name in names)
        if not cameras:
            raise InputError(f"{good}: names no view of {calibration.name}")
        if len(cameras) < len(rig):
            notes.append(f"{good.name}: {len(cameras)} of {len(rig)} views are used")
        settings = settings.replace(cameras=cameras)
    return assemble(rig, settings, {"images": (images, folder)}, extras=True, notes=notes)


#: CALIB/Camera*.cal, CAM*/image*.bmp, FG*/image*.bmp.
BODYTRACK = Layout(
    "bodytrack",
    lambda folder, _: (folder / "CALIB").is_dir() and any(folder.glob("CAM*/")),
    _read_bodytrack,
    SequenceSettings(fps=_BODYTRACK_FPS),
)
#: camN/config.xml, camN/video.avi, camN/background.avi. Z points into the floor.
UTRECHT = Layout(
    "utrecht",
    lambda folder, _: any(folder.glob("cam*/config.xml")),
    _read_utrecht,
    SequenceSettings(unit=_UTRECHT_UNIT, up="-z"),
)
#: `*_par.txt` beside one image per view, a single frame. The objects stand along y. The silhouettes
#: follow the recipe in the authors' README: threshold, dilate, erode.
MIDDLEBURY = Layout(
    "middlebury",
    lambda folder, _: len(list(folder.glob("*_par.txt"))) == 1,
    _read_middlebury,
    SequenceSettings(
        up="y",
        background="threshold",
        threshold=0.19,
        dilate=10,
        erode=7,
        fps=1.0,
        subject="object",
    ),
)


#: Frame rate of the videos, as their makers state it.
_FPS = 60.0
_VIDEO = re.compile(r"(?P<take>.+?)_?\((?P<camera>[^()]+)\)\.avi$", re.IGNORECASE)


def _find_subfolder(folder: Path, name: str) -> Path:
    """Return the subfolder of that name in any case; if there is none, a path that does not
    exist."""
    found = [path for path in folder.glob("*") if path.is_dir() and path.name.lower() == name]
    return found[0] if found else folder / name


def _list_takes(folder: Path) -> dict[str, dict[str, list[Path]]]:
    """List the videos by take and camera."""
    found: dict[str, dict[str, list[Path]]] = defaultdict(dict)
    for path in sorted(folder.glob("*")):
        match = _VIDEO.match(path.name)
        if match:
            found[match["take"]][match["camera"]] = [path]
    return dict(found)


def _matches(folder: Path, settings: SequenceSettings) -> bool:
    calibration = _find_subfolder(folder, "calibration_data")
    return calibration.is_dir() and bool(_list_takes(_find_subfolder(folder, "image_data")))


def _choose_take(folder: Path, take: str | None) -> tuple[str, Found]:
    """Return the name and videos of the take, by default the only one. Raises InputError."""
    takes = {
        name: videos
        for name, videos in _list_takes(folder).items()
        if not name.lower().startswith("background")
    }
    if take is None and len(takes) == 1:
        take = next(iter(takes))
    if take is None or take not in takes:
        names = join_names(sorted(takes, key=natural_key))
        found = "no `take` is stated" if take is None else f"there is no take {take!r}"
        raise InputError(f"{folder}: {found}; expected one of {names}")
    return take, takes[take]


def _read_cameras(
    folder: Path, videos: Found, where: Path, settings: SequenceSettings
) -> tuple[Calibration, Found, list[str]]:
    """Return the cameras, the videos of the calibrated ones, and remarks on the others."""
    if settings.calibration is not None:
        return read_rig(folder / settings.calibration, settings, videos, where), videos, []
    place = _find_subfolder(folder, "calibration_data")
    files = [p for p in sorted(place.glob("*.[cC][aA][lL]")) if p.stem in videos]
    if not files:
        raise InputError(f"{place}: no .cal of {join_names(videos)}; expected one per camera")
    lacking = sorted(videos.keys() - {path.stem for path in files}, key=natural_key)
    notes = [f"{name} is not calibrated, and left out" for name in lacking]
    videos = {path.stem: videos[path.stem] for path in files}
    sizes = partial(measure_sizes, videos, where, settings)
    read = read_tsai if looks_like_tsai(read_text(files[0], "a calibration")) else read_humaneva
    return read(files, settings.unit, sizes), videos, notes


def _read(folder: Path, settings: SequenceSettings) -> Footage:
    where = _find_subfolder(folder, "image_data")
    take, videos = _choose_take(where, settings.take)
    rig, videos, notes = _read_cameras(folder, videos, where, settings)
    chosen, empty = choose_cameras(rig, settings).names, _find_background_videos(folder)
    late, more = _compute_delays(_find_subfolder(folder, "sync_data"), take, chosen)
    kinds = {"images": (videos, where)}
    if set(chosen) <= empty.keys():
        kinds["background"] = empty, folder / "Background"
    return assemble(rig, settings, kinds, extras=True, notes=[*notes, *more], late=late)


def _find_background_videos(folder: Path) -> Found:
    """Return the first video of the empty room of every camera."""
    found: dict[str, list[Path]] = {}
    places = [_find_subfolder(place, "background") for place in (folder, folder.parent)]
    for place in (*places, _find_subfolder(folder, "image_data")):
        for name, videos in _list_takes(place).items():
            if name.lower().startswith("background"):
                found = {**videos, **found}
    return found


def _compute_delays(
    folder: Path, take: str, cameras: Sequence[str]
) -> tuple[dict[str, int], list[str]]:
    """Compute by how many frames each video starts late, and a remark on the motion capture.

    The sequence then begins at the first time that all videos have. Without an .ofs for each of
    them, returns no delays.
    """
    paths = [folder / f"{take}_({name}).ofs" for name in cameras]
    if not all(path.exists() for path in paths):
        return {}, [f"no .ofs for every camera of {take}: the videos are taken as they begin"]
    starts, mocap, scale = np.array([_read_offsets(path) for path in paths]).T
    # Frame of the motion capture, counted from 0, at each video's first frame.
    first = mocap - 1 - (starts - 1) * scale
    begin = float(first.max())
    late = np.rint((begin - first) / scale).astype(int)
    shown = f"frame {begin:.2f} of {take}.c3d, counted from 0, {scale.mean():.4g} per frame"
    note = f"frame 0 is {shown} (`apf evaluate --truth-start {begin:.2f}`)"
    return {name: int(by) for name, by in zip(cameras, late, strict=True)}, [note]


def _read_offsets(path: Path) -> np.ndarray:
    with name_file_in_errors(path):
        values = parse_numbers(read_text(path, "offsets").split(), "HumanEva's .ofs")
        if values.size < 3 or not np.isfinite(values[:3]).all() or values[2] <= 0:
            raise InputError(
                f"{values.size} numbers; expected three: a frame of the video, one of the motion "
                "capture, and its frames per frame of the video"
            )
        return values[:3]


#: X and Y on the floor, Z up, millimetres.
HUMANEVA = Layout("HumanEva", _matches, _read, SequenceSettings(fps=_FPS))
