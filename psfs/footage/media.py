"""The pictures of one camera, a video or image files, and decoders for their frames."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, cast

# suppresses FFmpeg's messages; we raise errors ourselves
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

import cv2
import numpy as np

from cl import InputError
from psfs.cameras.names import natural_key
from psfs.common.numbers import pick_evenly
from psfs.common.picture_size import check_picture_size
from psfs.common.pictures import read_mask, read_picture
from psfs.common.reading import open_input
from psfs.common.system import memory_limit

if hasattr(cv2, "setLogLevel"):  # OpenCV 4
    cv2.setLogLevel(0)
else:
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)

VIDEO_SUFFIXES = {
    *(".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg"),
    *(".mts", ".m2ts", ".ts", ".wmv", ".3gp"),
}
IMAGE_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".pbm", ".pgm", ".ppm", ".tif", ".tiff"}

#: Containers that store their number of frames; others' headers estimate it from the duration.
_COUNTING_SUFFIXES = {".mp4", ".mov", ".m4v", ".avi"}
#: Videos with at most this many frames are decoded to count them; of longer ones the last frame is
#: decoded to verify the header's count.
_SHORT = 16
#: A jump ahead of at most this many frames is decoded instead of sought.
_SHORT_JUMP = 32


class Decoder(Protocol):
    """A decoder of the frames of one `Media`, fastest in ascending order.

    `read(index, into)` returns the picture (h, w, 3) uint8 BGR. into: a contiguous array of that
    size, into which a decoder may write to save an allocation and a copy.
    """

    def read(self, index: int, into: np.ndarray | None = None) -> np.ndarray: ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class Media:
    """One camera's pictures.

    paths: one video, or the images in order. size: (width, height) px. count: frames that can be
    decoded. fps: of the video, else None. picks: the file's frames to use, None for all in order.
    is_mask: whether they are read as masks, see `read_mask`.
    Each iteration decodes all frames again.
    """

    name: str
    paths: tuple[Path, ...]
    size: tuple[int, int]
    count: int
    fps: float | None = None
    picks: tuple[int, ...] | None = None
    is_mask: bool = False

    @property
    def is_video(self) -> bool:
        return self.paths[0].suffix.lower() in VIDEO_SUFFIXES

    @property
    def where(self) -> str:
        """The file or folder, for messages."""
        return str(self.paths[0] if len(self.paths) == 1 else self.paths[0].parent)

    def open(self) -> Decoder:
        decoder = VideoDecoder(self) if self.is_video else ImagesDecoder(self)
        return decoder if self.picks is None else SelectingDecoder(decoder, self.picks)

    def select(self, picks: Sequence[int]) -> Media:
        """Return media whose frame k is frame picks[k] of this one."""
        source = self.picks
        chosen = tuple(picks if source is None else (source[index] for index in picks))
        return replace(self, count=len(chosen), picks=chosen)

    def __iter__(self) -> Iterator[np.ndarray]:
        return self.frames(range(self.count))

    def frames(self, indices: Iterable[int]) -> Iterator[np.ndarray]:
        """Decode the frames with these indices, (h, w, 3) uint8 BGR each."""
        with closing(self.open()) as decoder:
            for index in indices:
                yield decoder.read(index)

    def spread(self, n: int) -> list[int]:
        """Return `n` evenly spread frame indices from first to last; all if there are fewer."""
        return pick_evenly(self.count, n).tolist()


def open_media(name: str, paths: Sequence[Path]) -> Media:
    """Open a video or images to find their size, count and frame rate.

    Raises InputError if the start cannot be decoded, or if a video ends early (a truncated file).
    """
    if paths[0].suffix.lower() not in VIDEO_SUFFIXES:
        return Media(name, tuple(paths), read_picture_size(paths[0]), len(paths))
    path = paths[0]
    capture = _open_capture(path)
    try:
        size = _read_first_size(capture, path)
        count = _count_frames(capture, path)
        fps = capture.get(cv2.CAP_PROP_FPS)
    finally:
        capture.release()
    return Media(name, (path,), size, count, fps if fps > 0 else None)


def open_all_media(paths: Mapping[str, Sequence[Path]]) -> tuple[Media, ...]:
    """Open the media of every camera, by name, in parallel. Raises InputError as `open_media`
    does."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return tuple(pool.map(open_media, paths, paths.values()))


def read_picture_size(path: Path) -> tuple[int, int]:
    """Return (width, height), px, of an image or of a video's first frame."""
    if path.suffix.lower() not in VIDEO_SUFFIXES:
        height, width = read_picture(path).shape[:2]
        return width, height
    capture = _open_capture(path)
    try:
        return _read_first_size(capture, path)
    finally:
        capture.release()


def _read_first_size(capture: cv2.VideoCapture, path: Path) -> tuple[int, int]:
    """Decode the first frame and return its size."""
    _, image = capture.read()
    if image is None:
        raise InputError(f"{path}: no frame can be decoded; expected a video")
    return image.shape[1], image.shape[0]


def list_media(folder: Path) -> dict[str, list[Path]]:
    """List the pictures in a folder by camera name.

    A camera has a video, an image, or a subfolder of images or with one video; its name is the
    file's without suffix, or the subfolder's. A subfolder with several videos, such as masks/, is
    no camera; where there is nothing else it raises InputError, as two files of one camera do.
    """
    found: dict[str, list[Path]] = {}
    several = list[str]()
    for path in sorted(_list_visible(folder), key=lambda path: natural_key(path.name)):
        if path.is_dir():
            files = list_images(path) or [
                own for own in _list_visible(path) if own.suffix.lower() in VIDEO_SUFFIXES
            ]
            if len(files) > 1 and files[0].suffix.lower() in VIDEO_SUFFIXES:
                several.append(f"{path}: {len(files)} videos; expected one per camera")
            elif files:
                found[path.name] = files
        elif path.suffix.lower() in VIDEO_SUFFIXES | IMAGE_SUFFIXES:
            if path.stem in found:
                raise InputError(f"{folder}: two files for {path.stem}; expected one per camera")
            found[path.stem] = [path]
    if several and not found:
        raise InputError(several[0])
    return found


def list_images(folder: Path) -> list[Path]:
    """List the image files of a folder in natural order of their names."""
    images = [path for path in _list_visible(folder) if path.suffix.lower() in IMAGE_SUFFIXES]
    return sorted(images, key=lambda path: natural_key(path.name))


def _list_visible(folder: Path) -> list[Path]:
    """List a folder without hidden files, such as the `._0001.png` of macOS."""
    return [path for path in folder.iterdir() if not path.name.startswith(".")]


class VideoDecoder:
    """Decoder of a video: ascending reads decode on, only jumps seek."""

    def __init__(self, media: Media) -> None:
        self._media = media
        self._capture = _open_capture(media.paths[0])
        self._next = 0

    def read(self, index: int, into: np.ndarray | None = None) -> np.ndarray:
        """Decode one frame, (h, w, 3) uint8 BGR. Raises InputError naming file and frame."""
        if not self._next <= index <= self._next + _SHORT_JUMP:
            self._capture.set(cv2.CAP_PROP_POS_FRAMES, index)
            self._next = index
        while self._next < index and self._capture.grab():
            self._next += 1
        # Not `capture.read`: it reports success and leaves `into` unchanged if retrieving fails.
        good, image = False, None
        if self._next == index and self._capture.grab():
            good, image = self._capture.retrieve(into)
        if not good or image is None:
            raise InputError(
                f"{self._media.where}: frame {index} of {self._media.count} cannot be decoded; "
                "the file is damaged or truncated"
            )
        self._next += 1
        return image

    def close(self) -> None:
        self._capture.release()


class ImagesDecoder:
    """Decoder of numbered image files, all of one size."""

    def __init__(self, media: Media) -> None:
        self._media = media

    def read(self, index: int, into: np.ndarray | None = None) -> np.ndarray:
        """Decode one frame, (h, w, 3) uint8 BGR. Raises InputError naming the file."""
        path = self._media.paths[index]
        image = read_mask(path) if self._media.is_mask else read_picture(path)
        found, expected = (image.shape[1], image.shape[0]), self._media.size
        if found != expected:
            raise InputError(
                f"{path}: {found[0]} x {found[1]} pixels; "
                f"expected {expected[0]} x {expected[1]} as in the first picture"
            )
        return image

    def close(self) -> None:
        pass


def name_for_opencv(path: Path) -> str:
    """Return the path as text, or as bytes if it is not UTF-8.

    OpenCV crashes on text that is not UTF-8, and its version 4 does not accept bytes otherwise.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return cast(str, os.fsencode(path))
    return str(path)


class SelectingDecoder:
    """Decoder of selected frames of another decoder."""

    def __init__(self, decoder: Decoder, picks: Sequence[int]) -> None:
        self._decoder, self._picks = decoder, picks

    def read(self, index: int, into: np.ndarray | None = None) -> np.ndarray:
        """Decode one frame, (h, w, 3) uint8 BGR. Raises InputError naming file and frame."""
        return self._decoder.read(self._picks[index], into)

    def close(self) -> None:
        self._decoder.close()


def _open_capture(path: Path) -> cv2.VideoCapture:
    open_input(path, "a video").close()
    capture = cv2.VideoCapture(name_for_opencv(path), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise InputError(
            f"{path}: cannot be opened as a video; it is damaged or truncated{_or_memory()}"
        )
    sides = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    width, height = (int(capture.get(side)) for side in sides)
    try:
        check_picture_size((width, height), f"{path}: claims pictures of")
    except InputError:
        capture.release()
        raise
    return capture


def _or_memory() -> str:
    """Return what else may be the reason of a decoder's failure, under a limit of memory."""
    limit = memory_limit()
    return f", or {limit / 2**20:,.0f} MiB (ulimit -v) are too few" if limit < math.inf else ""


def _count_frames(capture: cv2.VideoCapture, path: Path) -> int:
    """Count the frames that can be decoded.

    The header's count is accepted if its last frame exists and none follows; otherwise all frames
    are decoded and counted.
    """
    promised = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    if promised > _SHORT:
        capture.set(cv2.CAP_PROP_POS_FRAMES, promised - 1)
        if _count_remaining(capture) == 1:
            return promised
    whole = _open_capture(path)  # a video of one frame cannot be rewound
    count = _count_remaining(whole)
    whole.release()
    # An encoder that drops frames at the end leaves the header a few frames wrong; more means
    # damage.
    if path.suffix.lower() in _COUNTING_SUFFIXES and promised - count > max(5, promised // 100):
        raise InputError(
            f"{path}: only {count} of the {promised} frames that its header promises can be "
            "decoded; the file is damaged or truncated"
        )
    return count


def _count_remaining(capture: cv2.VideoCapture) -> int:
    count = 0
    while capture.grab():
        count += 1
    return count


def pad_pictures(pictures: list[np.ndarray], into: np.ndarray) -> np.ndarray:
    """Copy pictures into `into` (V, H, W, ...), zero padded; those that are there already are not
    copied."""
    for own, picture in zip(into, pictures, strict=True):
        if not np.may_share_memory(own, picture):
            if picture.shape != own.shape:
                own[...] = 0
            own[: picture.shape[0], : picture.shape[1]] = picture
    return into
