"""The pictures of one camera, a video or image files, and decoders for their frames."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from cl import InputError
from psfs.cameras.names import natural_key
from psfs.common.numbers import pick_evenly
from psfs.common.pictures import read_mask, read_picture
from psfs.footage.video import VideoDecoder, VideoIndex, index_video

VIDEO_SUFFIXES = {
    *(".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg"),
    *(".mts", ".m2ts", ".ts", ".wmv", ".3gp", ".asf", ".dv", ".flv", ".mod", ".mxf", ".vob"),
}
IMAGE_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".pbm", ".pgm", ".ppm", ".tif", ".tiff"}


@dataclass(frozen=True)
class Media:
    """One camera's pictures.

    paths: one video, or the images in order. size: (width, height) px. count: frames that can be
    decoded. fps: of the video, else None. picks: the file's frames to use, None for all in order.
    is_mask: whether they are read as masks, see `read_mask`.
    index: the frames of a video.
    Each iteration decodes all frames again.
    """

    name: str
    paths: tuple[Path, ...]
    size: tuple[int, int]
    count: int
    fps: float | None = None
    picks: tuple[int, ...] | None = None
    is_mask: bool = False
    index: VideoIndex | None = field(default=None, compare=False, repr=False)

    @property
    def is_video(self) -> bool:
        return self.paths[0].suffix.lower() in VIDEO_SUFFIXES

    @property
    def where(self) -> str:
        """The file or folder, for messages."""
        return str(self.paths[0] if len(self.paths) == 1 else self.paths[0].parent)

    @property
    def times(self) -> np.ndarray | None:
        """The time (F,) s of each frame of a video after the file's first, None for images."""
        if self.index is None:
            return None
        return self.index.times if self.picks is None else self.index.times[list(self.picks)]

    def open(self) -> Decoder:
        return ImagesDecoder(self) if self.index is None else VideoDecoder(self.index, self.picks)

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
    """Open a video or images to find their size, count and times.

    Raises InputError if the start cannot be decoded, or if a video ends early (a truncated file).
    """
    if paths[0].suffix.lower() not in VIDEO_SUFFIXES:
        return Media(name, tuple(paths), read_picture_size(paths[0]), len(paths))
    index = index_video(paths[0])
    return Media(name, (paths[0],), index.size, len(index.stamps), index.fps, index=index)


def read_picture_size(path: Path) -> tuple[int, int]:
    """Return (width, height), px, of an image or of a video's frames."""
    if path.suffix.lower() in VIDEO_SUFFIXES:
        return index_video(path).size
    height, width = read_picture(path).shape[:2]
    return width, height


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


class ImagesDecoder:
    """Decoder of numbered image files, all of one size."""

    def __init__(self, media: Media) -> None:
        self._media = media

    def read(self, index: int, into: np.ndarray | None = None) -> np.ndarray:
        """Decode one frame, (h, w, 3) uint8 BGR; never in `into`. Raises InputError naming the
        file."""
        picks = self._media.picks
        path = self._media.paths[index if picks is None else picks[index]]
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


#: A decoder of the frames of one `Media`, fastest in ascending order.
Decoder: TypeAlias = ImagesDecoder | VideoDecoder


def pad_pictures(pictures: list[np.ndarray], into: np.ndarray) -> np.ndarray:
    """Copy pictures into `into` (V, H, W, ...), zero padded; those that are there already are not
    copied."""
    for own, picture in zip(into, pictures, strict=True):
        if not np.may_share_memory(own, picture):
            if picture.shape != own.shape:
                own[...] = 0
            own[: picture.shape[0], : picture.shape[1]] = picture
    return into
