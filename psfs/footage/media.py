"""The pictures of one camera: a video or a list of image files, and reading frames from them."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, cast

os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # FFmpeg's chatter; errors are ours to raise

import cv2
import numpy as np

from cl import InputError, MissingFileError
from psfs.cameras.names import natural_key
from psfs.common.picture_size import check_picture_size
from psfs.common.pictures import read_picture

if hasattr(cv2, "setLogLevel"):  # OpenCV 4
    cv2.setLogLevel(0)
else:
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)

VIDEO_SUFFIXES = {".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg"}
IMAGE_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".pbm", ".pgm", ".ppm", ".tif", ".tiff"}

#: Containers that count their frames; the others' counts are guesses from the duration.
_COUNTING = {".mp4", ".mov", ".m4v", ".avi"}
#: Videos of no more frames are decoded to count them; of longer ones the last frame, to verify the
#: header's count.
_SHORT = 16
#: A jump ahead of at most this many frames is decoded through rather than sought.
_SHORT_JUMP = 32


class Decoder(Protocol):
    """Reads the frames of one `Media`, cheapest in ascending order.

    `read(index, into)` returns the picture (h, w, 3) uint8 BGR; `into`, if a contiguous array of
    its size is given and the decoder writes to such, which saves clearing and copying one.
    """

    def read(self, index: int, into: np.ndarray | None = None) -> np.ndarray: ...

    def close(self) -> None: ...


@dataclass(frozen=True)
class Media:
    """One camera's pictures. paths: one video or the images in order. size: (width, height) px.

    count: frames that can be decoded. fps: the video's, else None. picks: which frames of the file
    these are, where not all of them in order. Iterating decodes all frames, each time anew.
    """

    name: str
    paths: tuple[Path, ...]
    size: tuple[int, int]
    count: int
    fps: float | None = None
    picks: tuple[int, ...] | None = None

    @property
    def is_video(self) -> bool:
        return self.paths[0].suffix.lower() in VIDEO_SUFFIXES

    @property
    def where(self) -> str:
        """What messages call it."""
        return str(self.paths[0] if len(self.paths) == 1 else self.paths[0].parent)

    def open(self) -> Decoder:
        decoder = VideoDecoder(self) if self.is_video else ImagesDecoder(self)
        return decoder if self.picks is None else PickingDecoder(decoder, self.picks)

    def picked(self, picks: Sequence[int]) -> Media:
        """Return the media whose frame k is frame picks[k] of this one."""
        source = self.picks
        chosen = tuple(picks if source is None else (source[index] for index in picks))
        return replace(self, count=len(chosen), picks=chosen)

    def __iter__(self) -> Iterator[np.ndarray]:
        return self.frames(range(self.count))

    def frames(self, indices: Iterable[int]) -> Iterator[np.ndarray]:
        """Decode the frames with these numbers, (h, w, 3) uint8 BGR each."""
        with closing(self.open()) as decoder:
            for index in indices:
                yield decoder.read(index)

    def spread(self, n: int) -> list[int]:
        """Return the numbers of `n` frames from the first to the last; all, if there are fewer."""
        indices = np.linspace(0, self.count - 1, n).round().astype(int)
        return [int(index) for index in np.unique(indices)]


def open_media(name: str, paths: Sequence[Path]) -> Media:
    """Look into a video or images. Raises InputError if the start cannot be decoded, or if a
    video ends early, as truncated files do.
    """
    if paths[0].suffix.lower() not in VIDEO_SUFFIXES:
        return Media(name, tuple(paths), picture_size(paths[0]), len(paths))
    path = paths[0]
    capture = _open_capture(path)
    try:
        size = _first_size(capture, path)
        count = _true_count(capture, path)
        fps = capture.get(cv2.CAP_PROP_FPS)
    finally:
        capture.release()
    return Media(name, (path,), size, count, fps if fps > 0 else None)


def opened_media(paths: Mapping[str, Sequence[Path]]) -> tuple[Media, ...]:
    """Look into the videos or images of every camera, by name, at the same time. Raises
    InputError as `open_media` does."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return tuple(pool.map(open_media, paths, paths.values()))


def picture_size(path: Path) -> tuple[int, int]:
    """Return (width, height), px, of an image or of a video's first frame."""
    if path.suffix.lower() not in VIDEO_SUFFIXES:
        height, width = read_picture(path).shape[:2]
        return width, height
    capture = _open_capture(path)
    try:
        return _first_size(capture, path)
    finally:
        capture.release()


def _first_size(capture: cv2.VideoCapture, path: Path) -> tuple[int, int]:
    """Decode the first frame, and return its size."""
    _, image = capture.read()
    if image is None:
        raise InputError(f"{path}: no frame can be decoded; expected a video")
    return image.shape[1], image.shape[0]


def media_in(folder: Path) -> dict[str, list[Path]]:
    """Return the pictures in a folder by camera name: a video or image per camera, or a subfolder
    of images per camera. The names are those of the files without suffix, or of the subfolders.
    """
    found: dict[str, list[Path]] = {}
    for path in sorted(_visible(folder), key=lambda path: natural_key(path.name)):
        if path.is_dir():
            images = images_in(path)
            if images:
                found[path.name] = images
        elif path.suffix.lower() in VIDEO_SUFFIXES | IMAGE_SUFFIXES:
            if path.stem in found:
                raise InputError(f"{folder}: two files for {path.stem}; expected one per camera")
            found[path.stem] = [path]
    return found


def images_in(folder: Path) -> list[Path]:
    """Return the image files of a folder in natural order of their names."""
    images = [path for path in _visible(folder) if path.suffix.lower() in IMAGE_SUFFIXES]
    return sorted(images, key=lambda path: natural_key(path.name))


def _visible(folder: Path) -> list[Path]:
    """Return what is in a folder but for hidden files, such as the `._0001.png` of macOS."""
    return [path for path in folder.iterdir() if not path.name.startswith(".")]


class VideoDecoder:
    """Frames of a video. Ascending reads decode on; only jumps seek."""

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
        # Not `read`, which says that what it could not retrieve is there, in `into` as it was.
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
    """Frames of numbered image files, all of one size."""

    def __init__(self, media: Media) -> None:
        self._media = media

    def read(self, index: int, into: np.ndarray | None = None) -> np.ndarray:
        """Decode one frame, (h, w, 3) uint8 BGR. Raises InputError naming the file."""
        path = self._media.paths[index]
        image = read_picture(path)
        found, expected = (image.shape[1], image.shape[0]), self._media.size
        if found != expected:
            raise InputError(
                f"{path}: {found[0]} x {found[1]} pixels; "
                f"expected {expected[0]} x {expected[1]} as in the first picture"
            )
        return image

    def close(self) -> None:
        pass


def _name_for_opencv(path: Path) -> str:
    """Return the path as text, or as bytes where it is no UTF-8: OpenCV crashes on such a text, and
    its version 4 takes no bytes."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return cast(str, os.fsencode(path))
    return str(path)


class PickingDecoder:
    """Some frames of another decoder, in an order of their own."""

    def __init__(self, decoder: Decoder, picks: Sequence[int]) -> None:
        self._decoder, self._picks = decoder, picks

    def read(self, index: int, into: np.ndarray | None = None) -> np.ndarray:
        """Decode one frame, (h, w, 3) uint8 BGR. Raises InputError naming file and frame."""
        return self._decoder.read(self._picks[index], into)

    def close(self) -> None:
        self._decoder.close()


def _open_capture(path: Path) -> cv2.VideoCapture:
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file; expected a video")
    capture = cv2.VideoCapture(_name_for_opencv(path), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise InputError(f"{path}: cannot be opened as a video; it is damaged or truncated")
    sides = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    width, height = (int(capture.get(side)) for side in sides)
    try:
        check_picture_size((width, height), f"{path}: claims pictures of")
    except InputError:
        capture.release()
        raise
    return capture


def _true_count(capture: cv2.VideoCapture, path: Path) -> int:
    """Count the frames that really decode. The header's count is believed if the last frame by
    that count is there, and none after it; else all are decoded and counted.
    """
    promised = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    if promised > _SHORT:
        capture.set(cv2.CAP_PROP_POS_FRAMES, promised - 1)
        if _grabbed(capture) == 1:
            return promised
    whole = _open_capture(path)  # a video of one frame cannot be wound back
    count = _grabbed(whole)
    whole.release()
    # Headers are a few frames wrong where an encoder dropped frames at the end; more is damage.
    if path.suffix.lower() in _COUNTING and promised - count > max(5, promised // 100):
        raise InputError(
            f"{path}: only {count} of the {promised} frames that its header promises can be "
            "decoded; the file is damaged or truncated"
        )
    return count


def _grabbed(capture: cv2.VideoCapture) -> int:
    count = 0
    while capture.grab():
        count += 1
    return count
