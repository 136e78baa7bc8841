"""Write videos that browsers play: H.264 in MP4."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from cl import InputError
from psfs.common.files import write_atomically

#: Constant rate factor, smaller is better: 23 is x264's default and keeps lines of one pixel sharp.
QUALITY = 23
#: Frames between key frames: a player with a slider seeks often.
_KEY_FRAMES = 15


class Video:
    """A video being written; made by `write_video`. count: pictures so far."""

    def __init__(self, path: Path, fps: float, quality: int, most: float | None) -> None:
        import av  # slow to import

        self.count = 0
        options = {"movflags": "+faststart"}  # playable before all of it is read
        self._container = av.open(str(path), "w", format="mp4", container_options=options)
        rate = Fraction(fps).limit_denominator(1001)
        self._stream = self._container.add_stream("libx264", rate=rate)
        self._stream.pix_fmt = "yuv420p"  # browsers play no other format
        self._stream.thread_type = "FRAME"  # slices wait for each other
        self._stream.options = {  # with B frames x264 gives several files for the same pictures
            "crf": str(quality), "preset": "veryfast", "g": str(_KEY_FRAMES), "bf": "0"
        }  # fmt: skip
        if most is not None:
            self._stream.options |= {"maxrate": str(int(most)), "bufsize": str(int(most))}

    def write(self, picture: np.ndarray) -> None:
        """Add a picture (h, w, 3) uint8 BGR, of the first one's size."""
        import av

        picture = _pad_to_even(picture)
        if not self.count:
            self._stream.height, self._stream.width = picture.shape[:2]
        planes = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420), np.uint8)
        frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
        frame.pts = self.count
        self._container.mux(self._stream.encode(frame))
        self.count += 1

    def close(self, whole: bool) -> None:
        """Close the file; whole: flush the encoder first."""
        if whole and self.count:
            self._container.mux(self._stream.encode())
        self._container.close()


@contextmanager
def write_video(
    path: str | Path, fps: float, quality: int = QUALITY, most: float | None = None
) -> Iterator[Video]:
    """Open a video for writing; it gets its name only when it is complete and verified.

    After closing, the file is read again and its pictures are counted. fps: pictures per second.
    quality: x264's constant rate factor. most: bits per second. Raises InputError if it cannot be
    written, or if nothing was.
    """
    import av

    path = Path(path)
    with write_atomically(path) as temporary:
        try:
            video = Video(temporary, fps, quality, most)
            whole = False
            try:
                yield video
                whole = True
            finally:
                video.close(whole)
            found = count_frames(temporary) if video.count else 0
        except av.FFmpegError as error:
            raise InputError(f"{path}: the video cannot be written: {error.strerror}") from None
        if not video.count or found != video.count:
            raise InputError(f"{path}: {found} of {video.count} pictures could be written")


def count_frames(path: Path) -> int:
    """Count the pictures in a video file."""
    import av

    with av.open(str(path)) as container:
        return sum(packet.size > 0 for packet in container.demux(video=0))


def _pad_to_even(picture: np.ndarray) -> np.ndarray:
    """Repeat the last row and column of a picture with odd sides: H.264 needs even ones."""
    height, width = picture.shape[:2]
    return np.asarray(
        cv2.copyMakeBorder(picture, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
    )
