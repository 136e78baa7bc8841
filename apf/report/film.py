"""Encode the overlay video for the page: H.264 of limited size."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import cv2

from cl import InputError
from psfs.common.scratch import temporary_folder
from psfs.output.video import write_video

if TYPE_CHECKING:
    import av

#: Most bytes of a video of up to `_SHORT` s; proportionally more for longer ones.
_BYTES, _SHORT = 4_000_000, 60.0
#: Width of a reduced video, px.
_WIDTH = 1280
#: Least bit rate at which the picture is recognisable, bits/s.
_LEAST_RATE = 1e5


def encode_page_video(path: Path) -> bytes:
    """Return the video at `path` as MP4 with H.264; it is encoded again if it is not, or is too
    large.

    Raises InputError if it cannot be read.
    """
    import av  # slow to import

    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            seconds = float(stream.frames / (stream.average_rate or 25))
            allowed = _BYTES * max(1.0, seconds / _SHORT)
            if stream.codec_context.name == "h264" and path.stat().st_size <= allowed:
                return path.read_bytes()
            with temporary_folder() as folder:
                smaller = folder / "smaller.mp4"
                _encode(container, smaller, 0.9 * 8 * allowed / max(seconds, 0.1))
                return smaller.read_bytes()
    except (av.FFmpegError, IndexError) as error:
        raise InputError(f"{path}: cannot be read as a video: {error}") from None


def _encode(source: av.container.InputContainer, path: Path, bits_per_second: float) -> None:
    stream = source.streams.video[0]
    factor = min(1.0, _WIDTH / stream.width)
    size = (round(stream.width * factor), round(stream.height * factor))
    rate = float(stream.average_rate or 25)
    with write_video(path, rate, most=max(bits_per_second, _LEAST_RATE)) as video:
        for frame in source.decode(stream):
            picture = frame.to_ndarray(format="bgr24")
            video.write(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
