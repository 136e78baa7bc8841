"""A subject's folder of HumanEva (Sigal, Balan, Black 2010); `take` chooses the take.

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
from pathlib import Path

import numpy as np

from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.cameras.calibration.common import (
    Calibration,
    name_file_in_errors,
    parse_numbers,
    read_text,
)
from psfs.cameras.calibration.number_lists import looks_like_tsai, read_humaneva, read_tsai
from psfs.cameras.names import join_names, natural_key
from psfs.footage.layouts.common import (
    Footage,
    Found,
    Layout,
    assemble,
    choose_cameras,
    make_size_lookup,
)
from psfs.footage.settings import SequenceSettings

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
        path, sizes = folder / settings.calibration, make_size_lookup(videos, where, settings)
        return read_calibration(path, settings.unit, sizes), videos, []
    place = _find_subfolder(folder, "calibration_data")
    files = [p for p in sorted(place.glob("*.[cC][aA][lL]")) if p.stem in videos]
    if not files:
        raise InputError(f"{place}: no .cal of {join_names(videos)}; expected one per camera")
    lacking = sorted(videos.keys() - {path.stem for path in files}, key=natural_key)
    notes = [f"{name} is not calibrated, and left out" for name in lacking]
    videos = {path.stem: videos[path.stem] for path in files}
    sizes = make_size_lookup(videos, where, settings)
    read = read_tsai if looks_like_tsai(read_text(files[0])) else read_humaneva
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
        values = parse_numbers(read_text(path).split(), "HumanEva's .ofs")
        if values.size < 3 or not np.isfinite(values[:3]).all() or values[2] <= 0:
            raise InputError(
                f"{values.size} numbers; expected three: a frame of the video, one of the motion "
                "capture, and its frames per frame of the video"
            )
        return values[:3]


#: X and Y on the floor, Z up, millimetres.
HUMANEVA = Layout("HumanEva", _matches, _read, SequenceSettings(fps=_FPS))
