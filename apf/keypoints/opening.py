"""Open files or folders of keypoints and match them to a sequence's cameras and frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from apf.keypoints.readers.arrays import (
    FREEMOCAP,
    read_array,
    read_arrays,
    read_keypoints_npz,
)
from apf.keypoints.readers.deeplabcut import ENDINGS, is_deeplabcut, read_deeplabcut
from apf.keypoints.readers.people import (
    OPENCAP,
    read_alphapose,
    read_mmpose,
    read_opencap,
    read_pictures,
)
from apf.keypoints.readers.raw import RawKeypoints
from cl import InputError, MissingFileError
from psfs.cameras.camera import CameraRig
from psfs.cameras.names import contains_name, join_names, name_tokens, natural_key
from psfs.common.reading import parsing
from psfs.sequence import Sequence as Footage

#: What keypoints can be matched to.
Cameras = CameraRig | Footage | Sequence[str]
_WILDCARDS = "*?["
_EXPECTED = (
    "keypoints.npz, JSON of OpenPose, MMPose or EasyMocap per frame, of AlphaPose or MMPose per "
    "video, YOLO's labels, OpenCap's pickles, FreeMoCap's or other .npy arrays, or .csv or .h5 of "
    "DeepLabCut or SLEAP"
)


def read_raw(path: Path) -> RawKeypoints:
    """Read a file or folder of keypoints of any supported format.

    Wildcards in the path choose among the folders of cameras: `Videos/Cam*/OutputPkl*/jump`. Raises
    InputError.
    """
    if not path.exists() and any(sign in str(path) for sign in _WILDCARDS):
        base, roots = expand_wildcards(path)
        if not roots:
            raise MissingFileError(f"{path}: matches no file or folder; expected {_EXPECTED}")
        return _read_folder(base, roots)
    if not path.exists():
        raise MissingFileError(f"{path}: no such file or folder; expected {_EXPECTED}")
    if path.is_dir():
        return _read_folder(path, [path])
    readers = {".npz": read_keypoints_npz, ".npy": read_array}
    ending = path.suffix.lower()
    if ending in readers:
        return readers[ending](path)
    if ending in ENDINGS:
        return read_deeplabcut(path, [path])
    if ending == ".pkl":
        return read_opencap(path.parent, [path])
    hint = ": name its folder" if ending == ".json" else ""
    raise InputError(f"{path}: not a file of keypoints of all frames{hint}; expected {_EXPECTED}")


def expand_wildcards(path: Path) -> tuple[Path, list[Path]]:
    """Return the part of a path before its first wildcard, and all that the path matches. Names
    that exist, such as `walk [1]`, are no wildcards. Raises InputError for a malformed pattern."""
    fixed = 0
    for part in path.parts:
        if any(sign in part for sign in _WILDCARDS) and not Path(*path.parts[: fixed + 1]).exists():
            break
        fixed += 1
    base, rest = Path(*path.parts[:fixed]), path.parts[fixed:]
    if not rest:
        return base, [base] if base.exists() else []
    with parsing(path, "a pattern such as Videos/Cam*/OutputPkl*/jump"):
        return base, sorted(base.glob(str(Path(*rest))))


def _read_folder(base: Path, roots: Sequence[Path]) -> RawKeypoints:
    """Read the keypoints in the folders or files `roots`, all of them in or equal to `base`.

    If there are several formats, the first in the order of this function is read.
    """

    def found(pattern: str) -> list[Path]:
        inside = {path for root in roots if root.is_dir() for path in root.rglob(pattern)}
        return sorted(inside.union(root for root in roots if root.match(pattern)))

    if (base / "keypoints.npz").is_file() and list(roots) == [base]:
        return read_keypoints_npz(base / "keypoints.npz")
    freemocap = found(FREEMOCAP)
    if len(freemocap) > 1:
        listing = join_names(str(path.relative_to(base)) for path in freemocap)
        raise InputError(f"{base}: {len(freemocap)} recordings: {listing}; expected one: name it")
    if freemocap:
        return read_array(freemocap[0])
    opencap = sorted({path for pattern in OPENCAP for path in found(pattern)})
    if opencap:
        return read_opencap(base, opencap)
    texts = found("*.json")
    pictures = read_pictures(base, texts)
    if pictures is not None:
        return pictures
    here = [
        path for root in roots for path in ((root, *root.iterdir()) if root.is_dir() else (root,))
    ]
    arrays = sorted(
        (p for p in here if p.suffix == ".npy"), key=lambda path: natural_key(path.stem)
    )
    if arrays:
        return read_arrays(base, {path.stem: path for path in arrays})
    tables = [path for path in sorted(here) if path.is_file() and is_deeplabcut(path)]
    if tables:
        return read_deeplabcut(base, tables)
    for read in (read_alphapose, read_mmpose):
        if (videos := read(base, texts)) is not None:
            return videos
    labels = read_pictures(base, found("*.txt"))
    if labels is not None:
        return labels
    other = f" but JSON of another layout, {texts[0].relative_to(base)}" if texts else ""
    raise InputError(f"{base}: holds no keypoints{other}; expected {_EXPECTED}")


def match_persons(
    raw: RawKeypoints, cameras: Cameras | None
) -> tuple[np.ndarray, tuple[str, ...], list[str]]:
    """Match keypoints to cameras and frames; return those of all persons of each picture (V, F, N,
    K, 3) px, the cameras' names (V,) and notes. Raises InputError."""
    rig, notes = get_rig(cameras), list(raw.notes)
    if cameras is None:
        names, view_of = list(raw.views), {name: name for name in raw.views}
    else:
        names = [str(name) for name in cameras] if rig is None else rig.names
        view_of, note = match_cameras(raw, names)
        notes += [note] if note else []
    views = {camera: raw.views[name] for camera, name in view_of.items()}
    views, placed = _place_frames(raw, views, cameras)
    notes += placed
    length = _count_frames(raw, views, cameras)
    n_persons = max(view.shape[1] for view in views.values())
    points = np.full((len(names), length, n_persons, len(raw.names), 3), np.nan)
    for row, camera in enumerate(names):
        if camera in views:
            view = views[camera][:length]
            points[row, : len(view), : view.shape[1]] = view
    if raw.shares:
        points[..., :2] = _to_pixels(raw, points[..., :2], cameras)
        notes.append(f"{raw.path}: x and y are shares of the picture, converted to pixels")
    return points, tuple(names), notes


def get_rig(cameras: Cameras | None) -> CameraRig | None:
    """Return the rig of what keypoints are matched to; None of names alone."""
    if isinstance(cameras, Footage):
        return cameras.rig
    return cameras if isinstance(cameras, CameraRig) else None


def match_cameras(raw: RawKeypoints, cameras: Sequence[str]) -> tuple[dict[str, str], str | None]:
    """Match the views of `raw` to cameras; return them with a note if the match was guessed.

    A camera's name may occur anywhere in the view's. If only some cameras are found by name, the
    others have no view. If none is found, and there are as many views as cameras, they are paired
    in natural order. Raises InputError.
    """
    view_of: dict[str, str] = {}
    for camera in cameras if raw.named else ():
        same = [name for name in raw.views if name_tokens(name) == name_tokens(camera)]
        candidates = same or [name for name in raw.views if contains_name(name, camera)]
        if len(candidates) > 1:
            raise InputError(
                f"{raw.path}: {join_names(candidates)} could all be camera {camera}; expected "
                "one of them: name those of one take, such as Videos/Cam*/OutputPkl*/jump"
            )
        if candidates:
            view_of[camera] = candidates[0]
    twice = [name for name in view_of.values() if list(view_of.values()).count(name) > 1]
    if view_of and not twice:
        missing = [camera for camera in cameras if camera not in view_of]
        if not missing:
            return view_of, None
        return view_of, f"{raw.path}: no keypoints of camera {join_names(missing)}"
    if len(raw.views) == len(cameras):
        ordered = sorted(raw.views, key=natural_key)
        view_of = dict(zip(sorted(cameras, key=natural_key), ordered, strict=True))
        pairs = ", ".join(f"{name} for {camera}" for camera, name in view_of.items())
        return view_of, f"{raw.path}: cameras are not named; taken in order: {pairs}"
    raise InputError(
        f"{raw.path}: keypoints of {len(raw.views)} cameras ({join_names(raw.views)}); expected "
        f"those of {join_names(cameras)}"
    )


def _place_frames(
    raw: RawKeypoints, views: Mapping[str, np.ndarray], cameras: Cameras | None
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the views (F, N, K, 3) by camera, in the frames that their files' numbers say if they
    are fewer than the sequence's and numbered within it, with a note."""
    last = raw.first + max(len(view) for view in views.values()) - 1
    numbered = raw.first > 0 or raw.sparse
    if not (numbered and isinstance(cameras, Footage) and last < len(cameras)):
        return dict(views), []
    placed = {}
    for camera, view in views.items():
        placed[camera] = np.full((len(cameras), *view.shape[1:]), np.nan)
        placed[camera][raw.first : raw.first + len(view)] = view
    note = f"{raw.path}: keypoints of frames {raw.first} to {last} alone"
    return placed, [note] if last - raw.first + 1 < len(cameras) else []


def _count_frames(
    raw: RawKeypoints, views: Mapping[str, np.ndarray], cameras: Cameras | None
) -> int:
    """Return the number of frames.

    Raises InputError if the cameras' numbers of frames contradict each other or the sequence: each
    must be that of the camera's own video or of the whole sequence.
    """
    counts = {camera: len(view) for camera, view in views.items()}
    if not isinstance(cameras, Footage):
        if len(set(counts.values())) > 1:
            stated = join_names(f"{camera} {count}" for camera, count in counts.items())
            raise InputError(f"{raw.path}: the cameras' numbers of frames differ: {stated}")
        return next(iter(counts.values()))
    media = cameras.footage.images or cameras.footage.masks or ()
    lengths = dict(zip(cameras.rig.names, (pictures.count for pictures in media), strict=True))
    wrong = [
        f"{camera} {count} (its video {lengths[camera]})"
        for camera, count in counts.items()
        if count not in (lengths[camera], len(cameras))
    ]
    if wrong:
        raise InputError(
            f"{raw.path}: numbers of frames differ from those of {cameras.name}: "
            f"{join_names(wrong)}; expected {len(cameras)}"
        )
    return len(cameras)


def _to_pixels(raw: RawKeypoints, shares: np.ndarray, cameras: Cameras | None) -> np.ndarray:
    """Convert x, y (V, ..., 2) from shares of the picture's width and height to px."""
    rig = get_rig(cameras)
    if rig is None:
        raise InputError(
            f"{raw.path}: x and y go from 0 to 1, as shares of the picture; expected pixels, or "
            "cameras with known picture sizes"
        )
    sizes = np.array([camera.size for camera in rig], float)
    return shares * sizes.reshape(-1, *[1] * (shares.ndim - 2), 2) - 0.5
