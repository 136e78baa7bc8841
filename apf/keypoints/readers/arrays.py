"""Read keypoints from NumPy files: `keypoints.npz`, FreeMoCap's and other arrays of 2-D points."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from apf.keypoints.readers.orders import find_order
from apf.keypoints.readers.raw import LARGEST_SCORE, RawKeypoints
from cl import InputError
from psfs.cameras.names import join_names
from psfs.common.npz import Values, read_npy, read_npz

_NPZ = "keypoints (cameras, frames, points, 3: x, y, confidence), keypoint_names and camera_names"
_ARRAYS = {
    "keypoints": Values(None, finite=False),
    "keypoint_names": Values(None, "text", needed=False),
    "camera_names": Values(None, "text", needed=False),
}
#: FreeMoCap's array files: x, y and, in newer ones, a depth, which is not a confidence.
FREEMOCAP = "*2dData*pixelXY.npy"
_DIMENSIONS = "(cameras, frames, points, 2 or 3), or (frames, points, 2 or 3) for one camera"


def read_keypoints_npz(path: Path) -> RawKeypoints:
    """Read an npz with `keypoints` (V, F, K, 3) and optionally the names of keypoints and cameras.

    Without keypoint names, their number determines them. Raises InputError, or MissingFileError.
    """
    data = read_npz(path, _ARRAYS, f"an npz with {_NPZ}")
    views = _to_views(path, data["keypoints"])
    names, cameras = data.get("keypoint_names"), data.get("camera_names")
    if names is None:
        names = np.array(find_order(str(path), views))
        views = views[:, :, : len(names)]
    for key, values, wanted in (
        ("keypoint_names", names, views.shape[2]),
        ("camera_names", cameras, len(views)),
    ):
        if values is not None and values.shape != (wanted,):
            raise InputError(
                f"{path}: {key} has values {values.shape}; expected ({wanted},), for keypoints of "
                f"values {data['keypoints'].shape}"
            )
    keys = [str(key) for key in (range(1, len(views) + 1) if cameras is None else cameras)]
    if len(set(keys)) < len(keys):
        raise InputError(f"{path}: camera names must differ; found {join_names(keys)}")
    by_camera = {key: view[:, None] for key, view in zip(keys, views, strict=True)}
    shares, named = _are_shares(by_camera), cameras is not None
    return RawKeypoints(path, tuple(map(str, names)), by_camera, named, shares)


def read_array(path: Path) -> RawKeypoints:
    """Read an npy (V, F, K, 2 or 3) or (F, K, 2 or 3); the number of keypoints determines their
    names."""
    return read_arrays(path, {"": path})


def read_arrays(path: Path, files: dict[str, Path]) -> RawKeypoints:
    """Read an npy (F, K, 2 or 3) per camera, by its name, or one of all, see `read_array`, without
    a name. path: named in errors."""
    wanted = Values(None, finite=False)
    arrays = {
        name: _to_views(file, read_npy(file, wanted, f"an array {_DIMENSIONS}"))
        for name, file in files.items()
    }
    counts = {name: array.shape[2] for name, array in arrays.items()}
    if len(set(counts.values())) > 1:
        stated = join_names(f"{name} {count}" for name, count in counts.items())
        raise InputError(f"{path}: cameras differ in their numbers of keypoints: {stated}")
    one = list(files) == [""]
    wrong = [str(files[name]) for name, array in arrays.items() if not one and len(array) > 1]
    if wrong:
        raise InputError(f"{join_names(wrong)}: holds several cameras; expected one per file")
    names = find_order(
        str(path), np.concatenate([a.reshape(-1, *a.shape[2:]) for a in arrays.values()])
    )
    notes: list[str] = []
    for name, array in arrays.items():
        notes += _drop_depth(files[name], array[:, :, : len(names)])
    if one:  # of all cameras
        arrays = {f"{view + 1}": array[None] for view, array in enumerate(arrays[""])}
    views = {name: array[0][:, None, : len(names)] for name, array in arrays.items()}
    return RawKeypoints(path, names, views, not one, _are_shares(views), tuple(notes))


def _drop_depth(path: Path, views: np.ndarray) -> list[str]:
    """Set the confidences of keypoints (V, F, K, 3) to 1 if the third number is not one; return
    notes.

    In FreeMoCap's files it is a depth.
    """
    scores = views[..., 2][np.isfinite(views[..., 2])]
    depth = path.match(FREEMOCAP)
    if not depth and (not scores.size or (scores.min() >= 0 and scores.max() <= LARGEST_SCORE)):
        return []
    views[..., 2] = np.where(np.isfinite(views[..., :2]).all(-1), 1.0, np.nan)
    if depth:
        return []
    return [f"{path}: the third number is {scores.min():g} to {scores.max():g}, not a confidence"]


def _to_views(path: Path, array: np.ndarray) -> np.ndarray:
    """Convert an array with or without cameras and confidences to keypoints (V, F, K, 3)
    float64."""
    views = array[None] if array.ndim == 3 else array
    if array.dtype.kind not in "fiu" or views.ndim != 4 or views.shape[-1] not in (2, 3):
        raise InputError(
            f"{path}: holds {array.dtype} of shape {array.shape}; expected {_DIMENSIONS}"
        )
    if not views.size:
        raise InputError(f"{path}: holds no keypoints: shape {array.shape}; expected {_DIMENSIONS}")
    views = views.astype(np.float64)
    if views.shape[-1] == 2:
        score = np.where(np.isfinite(views).all(-1, keepdims=True), 1.0, np.nan)
        views = np.concatenate([views, score], axis=-1)
    return views


def _are_shares(views: dict[str, np.ndarray]) -> bool:
    """Return whether x and y are shares of the picture, as MediaPipe's are, instead of pixels."""
    places = np.concatenate([view[..., :2].ravel() for view in views.values()])
    places = np.abs(places[np.isfinite(places)])
    return bool(places.size) and float(np.quantile(places, 0.99)) < 2.0
