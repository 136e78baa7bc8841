"""The frames of a video: when each was taken, and a decoder that checks what it returns."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import chain, dropwhile, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from cl import InputError
from psfs.common.ranges import check_picture_size
from psfs.common.reading import open_input

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.video.frame import VideoFrame

#: Containers that store their number of frames; others' headers estimate it from the duration.
_COUNTING_FORMATS = {"mov", "avi"}
#: A jump ahead of at most this many frames, or one without a key in between, is decoded instead of
#: sought.
_SHORT_JUMP = 32


@dataclass(frozen=True, eq=False)
class VideoIndex:
    """The frames of a video in the order in which they are shown.

    size: (width, height) px, as shown. rotation: by which stored pictures are turned for that,
    degrees. stamps: (F,) int64, ascending, in `tick` s. keys: (K,) stamps of the frames from which
    decoding can start; None where frames bear no stamps and are numbered. rate: that the file
    states, frames/s. interlaced: whether frames consist of two fields.
    """

    path: Path
    size: tuple[int, int]
    rotation: int
    stamps: np.ndarray
    tick: float
    keys: np.ndarray | None
    rate: float
    interlaced: bool

    @cached_property
    def times(self) -> np.ndarray:
        """The time (F,) s of each frame after the first."""
        return (self.stamps - self.stamps[0]) * self.tick

    @cached_property
    def fps(self) -> float:
        """The usual rate, frames/s, gaps left out: the stated one where it agrees to a tick."""
        intervals = np.diff(self.times)
        if not len(intervals):
            return self.rate
        usual = np.median(intervals)
        usual = float(intervals[abs(intervals - usual) < usual / 2].mean())
        return self.rate if abs(usual - 1 / self.rate) <= self.tick else 1 / usual


def index_video(path: Path) -> VideoIndex:
    """List the frames of a video. Raises InputError if the file is no video, or ends early."""
    with open_input(path, "a video") as file:
        status = os.fstat(file.fileno())
    return _index_version(path, status.st_mtime_ns, status.st_size)


@lru_cache(64)
def _index_version(path: Path, modified: int, n_bytes: int) -> VideoIndex:
    """List the frames of a video of which there may be several versions.

    The packets' stamps are taken if the frames at both ends are decoded as these promise, else all
    frames are decoded.
    """
    with _open(path) as container:
        stream = container.streams.video[0]
        packets = list(_demux(container))
        tick = float(stream.time_base or 1)
        rate = float(stream.average_rate or stream.base_rate or 25)
        counted = stream.frames if _COUNTING_FORMATS & set(container.format.name.split(",")) else 0
        hides = stream.codec_context.name == "vp8"  # has packets that are never shown
    if counted > len(packets):
        _check_whole(path, counted)
    first = next(_decode(path), None)
    if first is None:
        raise InputError(f"{path}: no frame can be decoded; expected a video")
    size = (first.height, first.width) if first.rotation % 180 else (first.width, first.height)
    shown = [packet.pts for packet in packets if not packet.is_discard]
    stamps = np.unique([pts for pts in shown if pts is not None]).astype(np.int64)
    keys = np.unique([p.pts for p in packets if p.is_keyframe and p.pts is not None])
    index = VideoIndex(path, size, first.rotation, stamps, tick, keys, rate, first.interlaced_frame)
    if len(keys) and len(stamps) == len(shown) and stamps[0] == first.pts and not hides:
        end = [frame.pts for frame in _decode(path, keys[-1]) if not frame.is_corrupt]
        if [pts for pts in end if pts >= keys[-1]] == stamps[stamps >= keys[-1]].tolist():
            return index
    decoded = [(frame.is_corrupt, frame.pts) for frame in _decode(path)]
    # A recording that begins between two keys begins with frames that cannot be decoded.
    usable = [pts for _, pts in dropwhile(lambda frame: frame[0], decoded)]
    if not usable:
        raise InputError(f"{path}: no frame can be decoded without errors; the file is damaged")
    if set(usable) <= set(stamps) and (np.diff(np.array(usable, np.int64)) > 0).all():
        return replace(index, stamps=np.array(usable), keys=keys)
    return replace(index, stamps=np.arange(len(decoded)), tick=1 / rate, keys=None)


def _check_whole(path: Path, promised: int) -> None:
    """Raise InputError if a file lacks frames beside those that its edit list hides.

    An encoder that drops frames at the end leaves the header a few frames wrong; more means damage.
    """
    with _open(path, ignore_editlist="1") as container:
        count = len(list(_demux(container)))
    if promised - count > max(5, promised // 100):
        raise InputError(
            f"{path}: only {count} of the {promised} frames that its header promises are there; "
            "the file is damaged or truncated"
        )


def _open(path: Path, **options: str) -> InputContainer:
    import av  # slow to import

    try:
        container = av.open(str(path), options={"protocol_whitelist": "file", **options})
    except (av.FFmpegError, OSError) as error:
        raise InputError(
            f"{path}: cannot be opened as a video; it is damaged or truncated"
        ) from error
    try:
        context = next((stream.codec_context for stream in container.streams.video), None)
        if context is None:
            raise InputError(f"{path}: holds no pictures that can be decoded; expected a video")
        check_picture_size((context.width, context.height), f"{path}: claims pictures of")
    except InputError:
        container.close()
        raise
    return container


def _demux(container: InputContainer) -> Iterator[Any]:
    """Yield the packets of the first video stream, as far as the file can be read."""
    import av

    with suppress(av.FFmpegError):
        for packet in container.demux(container.streams.video[0]):
            if packet.size:
                yield packet


def _decode(path: Path, key: int | None = None) -> Iterator[VideoFrame]:
    """Decode a video from its start, or from the frame with the stamp `key` or an earlier one.
    Packets that cannot be decoded are passed over."""
    import av

    with _open(path) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        if key is not None:
            container.seek(int(key), stream=stream)
        for packet in chain(_demux(container), [None]):
            with suppress(av.FFmpegError):
                yield from cast("Any", stream).decode(packet)


def _deinterlace(frames: Iterable[VideoFrame]) -> Iterator[VideoFrame]:
    """Interpolate the missing lines of the first field of each interlaced frame, in between the
    frames before and after (FFmpeg's bwdif)."""
    import av

    graph = None
    for frame in chain(frames, [None]):
        if graph is None and frame is not None:
            graph = av.filter.Graph()
            source = graph.add_buffer(
                width=frame.width, height=frame.height, format=frame.format,
                time_base=frame.time_base or Fraction(1, 1000),  # of no matter here
            )  # fmt: skip
            filtering = graph.add("bwdif", "mode=send_frame:deint=interlaced")
            graph.link_nodes(source, filtering, graph.add("buffersink")).configure()
        if graph is not None:
            graph.push(frame)
            with suppress(BlockingIOError, EOFError):
                while True:
                    yield cast("VideoFrame", graph.pull())


class VideoDecoder:
    """Decoder of a video: ascending reads decode on, only far jumps seek.

    Interlaced frames are deinterlaced, pictures of phones turned upright. picks: the frames that
    are counted, all by default.
    """

    def __init__(self, index: VideoIndex, picks: Sequence[int] | None = None) -> None:
        from av.video.reformatter import VideoReformatter

        self._index, self._picks = index, picks
        self._converter = VideoReformatter()
        self._frames: Iterator[VideoFrame] = self._run(0, None)
        self._next = 0

    def read(self, index: int, into: np.ndarray | None = None) -> np.ndarray:
        """Decode one frame, (h, w, 3) uint8 BGR, in `into`, a contiguous array of that size, if
        there is one. Raises InputError naming file and frame."""
        index = index if self._picks is None else self._picks[index]
        far = not self._next <= index <= self._next + _SHORT_JUMP
        if far and (index < self._next or self._passes_key(index)):
            self._jump(index)
        frame = next(islice(self._frames, index - self._next, None), None)
        if frame is None and far:  # one in between may be corrupt
            self._jump(index)
            frame = next(islice(self._frames, index - self._next, None), None)
        self._next = index + 1
        if frame is None:
            self._frames = iter(())
            raise InputError(
                f"{self._index.path}: frame {index} of {len(self._index.stamps)} cannot be "
                "decoded; the file is damaged or truncated"
            )
        return self._convert(frame, into)

    def close(self) -> None:
        self._frames = iter(())

    def _passes_key(self, index: int) -> bool:
        """Return whether there is a key to decode from between the next frame and a later one."""
        keys, stamps = self._index.keys, self._index.stamps
        between = slice(self._next + 1, index + 1)
        return keys is not None and bool(np.isin(stamps[between], keys).any())

    def _jump(self, index: int) -> None:
        """Go to a frame: by one of the two keys before it, or from the start if these do not lead
        there."""
        start = max(index - self._index.interlaced, 0)  # a field needs those before and after
        keys = np.empty(0) if self._index.keys is None else self._index.keys
        keys = keys[keys <= self._index.stamps[start]]
        for key in (*keys[:-3:-1], None):
            frames = self._run(start, key)
            first = next(frames, None)
            if first is not None:
                self._frames, self._next = chain((first,), frames), start
                return
        self._frames, self._next = iter(()), index

    def _run(self, start: int, key: int | None) -> Iterator[VideoFrame]:
        frames = self._check(start, _decode(self._index.path, key))
        return _deinterlace(frames) if self._index.interlaced else frames

    def _check(self, start: int, frames: Iterable[VideoFrame]) -> Iterator[VideoFrame]:
        """Yield the frames from `start` on, up to one that is not the one expected or corrupt."""
        numbered = self._index.keys is None
        expected = self._index.stamps[start:]
        for number, frame in enumerate(frames):
            stamp = number if numbered else frame.pts
            if stamp < expected[0]:
                continue
            if stamp != expected[0] or frame.is_corrupt:
                return
            yield frame
            expected = expected[1:]
            if not len(expected):
                return

    def _convert(self, frame: VideoFrame, into: np.ndarray | None) -> np.ndarray:
        """Return the picture as it is shown, in `into` if that is there."""
        frame = self._converter.reformat(frame, format="bgr24", interpolation="BICUBIC")
        plane = frame.planes[0]
        lines = np.frombuffer(memoryview(plane), np.uint8).reshape(frame.height, plane.line_size)
        picture = lines[:, : 3 * frame.width].reshape(frame.height, frame.width, 3)
        picture = np.rot90(picture, self._index.rotation // 90)
        if picture.shape[1::-1] != self._index.size:
            width, height = self._index.size
            raise InputError(
                f"{self._index.path}: pictures of {picture.shape[1]} x {picture.shape[0]} px; "
                f"expected {width} x {height} as in the first frame"
            )
        if into is None:
            return np.ascontiguousarray(picture)
        into[...] = picture
        return into
