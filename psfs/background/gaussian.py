"""The empty scene: per-pixel mean and standard deviation (Song et al. eq. (1))."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import TypeAlias

import cv2
import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.common.progress import map_in_threads
from psfs.footage.media import Media

#: Mean and standard deviation (h, w, 3) of pixels, grey levels.
Moments: TypeAlias = tuple[np.ndarray, np.ndarray]

_BAND_BYTES = 2**20  # processed at a time: this fits into a cache
_VIEWS_AT_ONCE = 4  # estimated in parallel at most; more need more memory for frames
_LOT = 255  # frames with exact sums: of squares in float32, of counts in a byte
_HELD_BYTES = 2**26  # greatest size of a view's frames that are decoded once only
#: Least standard deviation of a background's estimate, grey levels: without it, the density of a
#: noiseless background would be unbounded.
STD_FLOOR = 2.0
#: Prior standard deviation of a pixel, grey levels, and its weight in frames: a background of a
#: single picture thus has a standard deviation of 4.9 grey levels.
PRIOR_STD, PRIOR_FRAMES = 6.0, 2.0
#: Least number of frames in which a background pixel is visible: the fewest with a median that one
#: wrong frame does not move.
_LEAST_FREE = 3
#: Distance from the mean, in standard deviations, beyond which a value is left out of it.
_CLIP = 3.0


@dataclass(frozen=True, eq=False)
class Background:
    """The empty scene as a Gaussian per pixel.

    mean, std: (V, H, W, 3) float32 grey levels, BGR. H and W are the rig's; smaller views are
    padded with zeros in `mean` and with `STD_FLOOR` in `std`.
    """

    mean: np.ndarray
    std: np.ndarray

    @classmethod
    def blank(cls, rig: CameraRig) -> Background:
        """Return a background of a rig that is to be filled."""
        shape = (len(rig), rig.height, rig.width, 3)
        return cls(np.zeros(shape, np.float32), np.full(shape, STD_FLOOR, np.float32))

    def views(self, rig: CameraRig) -> list[Moments]:
        """Return the moments (h, w, 3) of each view: parts of these arrays."""
        both = self.mean, self.std, [camera.size for camera in rig]
        return [(m[:h, :w], s[:h, :w]) for m, s, (w, h) in zip(*both, strict=True)]


def estimate_background(rig: CameraRig, media: Sequence[Media]) -> Background:
    """Estimate the background from all frames of an empty scene, one video or list of images per
    view."""
    moments = map_in_threads(view_moments, media, _VIEWS_AT_ONCE)
    return stack_views(rig, moments)


def view_moments(view: Media) -> Moments:
    """Compute the `clipped_moments` of a view. If its frames fit into memory, they are decoded once
    and processed band by band, with the same result."""
    width, height = view.size
    if 3 * width * height * view.count > _HELD_BYTES:
        return clipped_moments(view)
    frames, rows = list(view), max(1, _BAND_BYTES // (8 * 3 * width))
    mean, std = np.empty((2, height, width, 3), np.float32)
    for top in range(0, height, rows):
        band = slice(top, top + rows)
        mean[band], std[band] = clipped_moments([frame[band] for frame in frames])
    return mean, std


def clipped_moments(
    frames: Iterable[np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard deviation (h, w, 3) float32 of frames (h, w, 3) uint8; the frames
    are iterated twice.

    The second pass leaves out values beyond `_CLIP` standard deviations of the first, such as
    a passing shadow or a compression artefact. Only a few pictures are in memory at a time, not the
    video.
    """
    mean, variance, number = _moments(frames, None)
    # Bounds are whole grey levels: comparing bytes takes a sixth of the time of floats.
    low, high = np.empty((2, *mean.shape), np.uint8)
    for band in _bands(mean):
        most = _CLIP * with_prior(variance[band], number[band].astype(np.float32))
        low[band] = np.ceil(mean[band] - most).clip(0, 255)
        high[band] = np.floor(mean[band] + most).clip(0, 255)
    del variance, number  # before there are others: of 4K they take 125 MB
    clipped, variance, number = _moments(frames, (low, high))
    for band in _bands(mean):
        np.copyto(clipped[band], mean[band], where=number[band] == 0)
        variance[band] = with_prior(variance[band], number[band].astype(np.float32))
    return clipped, variance


def _bands(picture: np.ndarray) -> Iterator[slice]:
    """Yield the rows of a picture (h, w, 3) float32 that are processed at a time."""
    rows = max(1, _BAND_BYTES // picture[0].nbytes)
    return (slice(top, top + rows) for top in range(0, len(picture), rows))


def _moments(
    frames: Iterable[np.ndarray], within: tuple[np.ndarray, np.ndarray] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean and variance (h, w, 3) float32, and the number (h, w, 3), of the values used:
    all, or those `within` the lowest and highest value (h, w, 3) uint8 of each pixel and
    channel."""
    left = iter(frames)
    lots = (_sums(first, islice(left, _LOT - 1), within) for first in left)
    total, squares, number = next(lots)
    for more in lots:  # beyond one, float32 is not exact
        total, squares, number = (
            sums.astype(np.float64) + of
            for sums, of in zip((total, squares, number), more, strict=True)
        )
    for band in _bands(total):  # float64 of all would take much memory
        used = np.maximum(number[band].astype(np.float64), 1)
        mean = total[band] / used
        squares[band] = np.maximum(squares[band] / used - mean * mean, 0)
        total[band] = mean
    return np.asarray(total, np.float32), np.asarray(squares, np.float32), number


def _sums(
    first: np.ndarray, more: Iterable[np.ndarray], within: tuple[np.ndarray, np.ndarray] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the sums (h, w, 3) float32 of frames (h, w, 3) uint8, the sums of their squares, and
    the number of values used, uint8. They are exact for up to `_LOT` frames."""
    flat = len(first), -1  # flat, since OpenCV's masks have no channels
    shape = first.reshape(flat).shape
    total, squares = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    number, used = np.zeros(shape, np.uint8), np.full(shape, 255, np.uint8)
    bounds = [bound.reshape(flat) for bound in within or ()]
    for frame in chain([first], more):
        values = frame.reshape(flat)
        if bounds:
            cv2.inRange(values, bounds[0], bounds[1], used)
        cv2.accumulate(values, total, used)
        cv2.accumulateSquare(values, squares, used)
        np.subtract(number, used, out=number)  # 255 more is 1 less
    return total.reshape(first.shape), squares.reshape(first.shape), number.reshape(first.shape)


def median_moments(frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return median and 1.4826 x median absolute deviation (h, w, 3) float32 of (n, h, w, 3) uint8.

    For even n the median is the upper of the two middle values.
    """
    count = len(frames)
    middle = select_rank(frames, count // 2)
    deviation = np.maximum(frames, middle)
    deviation -= np.minimum(frames, middle)
    spread = select_rank(deviation, count // 2)
    std = with_prior((1.4826 * spread.astype(np.float32)) ** 2, count)
    return middle.astype(np.float32), std.astype(np.float32)


def masked_moments(
    frames: np.ndarray, covered: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return median and 1.4826 x median absolute deviation (p, 3) float32 of p pixels, and the
    number (p,) of frames that they are of.

    These are the frames (n, p, 3) uint8 in which a pixel is not `covered` (n, p). Where they are
    not enough, the number is 0, and the median that of all frames.
    """
    n_pixels = frames.shape[1]
    median, std = np.empty((2, n_pixels, 3), np.float32)
    count, step = np.empty(n_pixels, int), max(1, 2 * _BAND_BYTES // (3 * len(frames)))
    for first in range(0, n_pixels, step):
        part = np.s_[first : first + step]
        shown = frames[:, part].reshape(len(frames), -1)  # NumPy is slow along an axis of three
        free = len(frames) - covered[:, part].view(np.uint8).sum(axis=0, dtype=np.int32)
        left_out = covered[:, part] & (free >= _LEAST_FREE)
        number = np.repeat(np.where(free >= _LEAST_FREE, free, len(frames)), 3)
        most = np.repeat(np.negative(left_out.view(np.uint8)), 3, axis=1)  # 255 where left out
        middle = select_rank(shown | most, number // 2)
        deviation = (np.maximum(shown, middle) - np.minimum(shown, middle)) | most
        spread = select_rank(deviation, number // 2).astype(np.float32)
        values = middle, with_prior((1.4826 * spread) ** 2, number)
        median[part], std[part] = (of.reshape(-1, 3) for of in values)
        count[part] = free * (free >= _LEAST_FREE)
    return median, std, count


def stack_median(stack: np.ndarray) -> np.ndarray:
    """Return the median (...) float64 along the first axis of (n, ...) uint8, like np.median."""
    low = select_rank(stack, (len(stack) - 1) // 2)
    high = low if len(stack) % 2 else select_rank(stack, len(stack) // 2)
    return 0.5 * (low.astype(float) + high)


def select_rank(stack: np.ndarray, rank: np.ndarray | int) -> np.ndarray:
    """Return the value (...) of a `rank`, from 0, along the first axis of (n, ...) uint8, bit by
    bit from the highest: several times as fast as np.partition along the first axis."""
    flat, most = stack.reshape(len(stack), -1), np.uint8 if len(stack) < 256 else np.int32
    found, ranks = np.zeros(flat.shape[1], np.uint8), np.asarray(rank, most)
    ranks, step = np.broadcast_to(ranks, stack.shape[1:]).ravel(), _BAND_BYTES // len(stack)
    for first in range(0, len(found), max(1, step)):
        part = np.s_[first : first + max(1, step)]
        values, chosen = flat[:, part], found[part]
        less = np.empty(values.shape, bool)
        for bit in (128, 64, 32, 16, 8, 4, 2, 1):
            tried = chosen | np.uint8(bit)
            np.less(values, tried, out=less)  # all at once: threads contend for Python's lock
            count = less.view(np.uint8).sum(axis=0, dtype=most)
            np.copyto(chosen, tried, where=count <= ranks[part])
    return found.reshape(stack.shape[1:])


def with_prior(variance: np.ndarray, count: np.ndarray | int) -> np.ndarray:
    """Return the standard deviation from the variance of `count` frames and the prior, at least the
    floor."""
    prior = PRIOR_FRAMES * PRIOR_STD**2
    std = np.sqrt((count * variance + prior) / (count + PRIOR_FRAMES))
    return np.maximum(std, STD_FLOOR)


def stack_views(
    rig: CameraRig,
    moments: Iterable[Moments],
) -> Background:
    """Return the background of these moments of each view."""
    background = Background.blank(rig)
    for place, found in zip(background.views(rig), moments, strict=True):
        for into, values in zip(place, found, strict=True):
            into[...] = values
    return background
