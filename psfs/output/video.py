"""Videos that browsers play: H.264 in MP4, written whole."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import numpy as np

from cl import InputError
from psfs.common.files import written_whole

#: Constant quality, smaller is better: 23 is x264's own, at which lines of one pixel stay sharp.
QUALITY = 23
#: Frames between two that can be jumped to: a player with a slider jumps often.
_KEY_FRAMES = 15


class Video:
    """A video that is being written; see `written_video`. count: pictures so far."""

    def __init__(self, path: Path, fps: float, quality: int, most: float | None) -> None:
        import av  # takes a while to load

        self.count = 0
        options = {"movflags": "+faststart"}  # playable before all of it is read
        self._container = av.open(str(path), "w", format="mp4", container_options=options)
        rate = Fraction(fps).limit_denominator(1001)
        self._stream = self._container.add_stream("libx264", rate=rate)
        self._stream.pix_fmt = "yuv420p"  # browsers play no other
        self._stream.options = {
            "crf": str(quality), "preset": "veryfast", "g": str(_KEY_FRAMES)
        }  # fmt: skip
        if most is not None:
            self._stream.options |= {"maxrate": str(int(most)), "bufsize": str(int(most))}

    def write(self, picture: np.ndarray) -> None:
        """Add a picture (h, w, 3) uint8 BGR, of the first one's size."""
        import av

        picture = _with_even_sides(picture)
        if not self.count:
            self._stream.height, self._stream.width = picture.shape[:2]
        frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
        frame.pts = self.count
        self._container.mux(self._stream.encode(frame))
        self.count += 1

    def close(self, whole: bool) -> None:
        """End the file; `whole`: with what the encoder still holds."""
        if whole and self.count:
            self._container.mux(self._stream.encode())
        self._container.close()


@contextmanager
def written_video(
    path: str | Path, fps: float, quality: int = QUALITY, most: float | None = None
) -> Iterator[Video]:
    """Give a video to `write` to, that has its name once it is whole: closed, read again and its
    pictures counted.

    fps: pictures per second. quality: x264's constant rate factor. most: bits per second. Raises
    InputError if it cannot be written, or if nothing was.
    """
    import av

    path = Path(path)
    with written_whole(path) as temporary:
        try:
            video = Video(temporary, fps, quality, most)
            whole = False
            try:
                yield video
                whole = True
            finally:
                video.close(whole)
            found = frames_of(temporary) if video.count else 0
        except av.FFmpegError as error:
            raise InputError(f"{path}: the video cannot be written: {error.strerror}") from None
        if not video.count or found != video.count:
            raise InputError(f"{path}: {found} of {video.count} pictures could be written")


def frames_of(path: Path) -> int:
    """Return the number of pictures in a video's file."""
    import av

    with av.open(str(path)) as container:
        return sum(packet.size > 0 for packet in container.demux(video=0))


def _with_even_sides(picture: np.ndarray) -> np.ndarray:
    """Return the picture, its last row and column doubled where sides are odd, as H.264 wants."""
    height, width = picture.shape[:2]
    return np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
