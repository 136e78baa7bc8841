"""Estimation of the empty scene from a take with people in it, by all cameras together.

Expectation maximisation over frames spread over the take, in small pictures. Unknown are each
camera's background and which of its pixels people cover in each frame. The expectation of the
latter takes the evidence of the pixel itself, and that of the other cameras: a person is where
their rays meet. The background is then the median of the frames in which a pixel is not covered,
and the person's colours are those of the pixels that are.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from psfs.background.config import BackgroundConfig
from psfs.background.coverage import Coverage, Rays
from psfs.background.gaussian import (
    SAMPLES,
    VIEWS_AT_ONCE,
    Background,
    median_moments,
    sort_stack,
    stack_views,
    with_prior,
)
from psfs.background.light import GRID, fit_light, relight_picture
from psfs.background.pixel_densities import PixelDensities, find_moving_region
from psfs.cameras.camera import CameraRig
from psfs.cameras.scaling import scale_picture
from psfs.footage.media import Media

#: Longest side of the small pictures in which people are searched, px.
_LONGEST_SIDE = 320
#: Greatest number of alternations of expectation and maximisation, and the share of pixels that
#: change label below which they end.
_ROUNDS, _CONVERGED = 8, 0.002
#: Least number of frames in which a background pixel is visible: the fewest with a median that one
#: wrong frame does not move.
_LEAST_FREE = 3
#: Standard deviation, grey levels, with which a channel's normal density peaks at the uniform
#: foreground's, 1/256; and its factor where nothing is known of the background: one nat less.
_UNIFORM_STD = 256 / np.sqrt(2 * np.pi) * np.exp(1 / 3)


@dataclass(frozen=True, eq=False)
class _View:
    """A camera's samples: numbers of the frames, their light (n, LIGHT_FLOATS) relative to that of
    their median, and small pictures (n, h, w, 3) uint8 relit by the median's light."""

    numbers: list[int]
    light: np.ndarray
    small: np.ndarray


def estimate_background_from_take(rig: CameraRig, media: Sequence[Media]) -> Background:
    """Estimate the background from frames spread over the sequence itself.

    Each frame is relit by the light of the pixels' median. Where people are is found in small
    pictures, see `find_covered`. The background behind a person who covers it in nearly all frames
    is unknown; it is extrapolated from around, or its density is lower than the foreground's.
    """
    factor = rig.factor_within(_LONGEST_SIDE)
    with ThreadPoolExecutor(min(VIEWS_AT_ONCE, os.cpu_count() or 1)) as pool:
        views = list(pool.map(partial(_read_samples, factor=factor), media))
        small = rig.scaled(factor)
        covered, unseen = find_covered(small, _stack([v.small for v in views], small), pool)
        moments = pool.map(_estimate_view, media, views, covered, unseen)
        return Background(*stack_views(rig, moments))


def find_covered(
    rig: CameraRig, frames: np.ndarray, pool: ThreadPoolExecutor
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pixels that people cover in each frame (V, n, h, w) bool, and the mean and
    standard deviation (V, h, w, 4) of backgrounds that are extrapolated from around, NaN where that
    is not known.

    frames: (V, n, h, w, 3) uint8 small pictures of the rig.

    The background is at first the median, or, if people stay in a place and are thus in the median,
    extrapolated from around all that moves. Of the two results, that one is returned in which the
    cameras agree better.
    """
    regions = np.stack(list(pool.map(find_moving_region, frames)))
    rays = Rays(rig, regions)
    moments = list(pool.map(median_moments, frames))
    results = []
    for from_median in (True, False):
        densities = [
            PixelDensities(own, region, *of, from_median)
            for own, region, of in zip(frames, rays.regions, moments, strict=True)
        ]
        results.append(_maximise(rays, frames, densities, pool))
    best = max(results, key=lambda result: result[0])
    return best[1], best[2]


def _maximise(
    rays: Rays,
    frames: np.ndarray,
    densities: list[PixelDensities],
    pool: ThreadPoolExecutor,
) -> tuple[float, np.ndarray, np.ndarray]:
    """Alternate between who covers which pixel and what is behind, until nothing changes. Return
    the agreement of the cameras, and the results of `find_covered`."""
    coverage = Coverage(rays)
    covered = np.zeros(frames.shape[:-1], bool)
    for _ in range(_ROUNDS):
        before = covered
        covered = coverage.update(list(pool.map(PixelDensities.evidence, densities)))
        if (covered != before).mean() < _CONVERGED:
            break

        def learn(view: int, covered: np.ndarray = covered) -> np.ndarray:
            densities[view].learn(*masked_moments(frames[view], covered[view]))
            return densities[view].count_colours(covered[view])

        colours = list(pool.map(learn, range(len(densities))))
        for of in densities:
            of.learn_person(colours)
    return coverage.agreement, covered, np.stack([of.extrapolate() for of in densities])


def _read_samples(media: Media, factor: float) -> _View:
    numbers = media.spread(SAMPLES)
    frames = np.stack(list(media.frames(numbers)))
    median, _ = median_moments(frames)
    light = np.stack([_estimate_frame_light(frame, median) for frame in frames])
    relit = [relight_picture(frame, of) for frame, of in zip(frames, light, strict=True)]
    small = [scale_picture(picture, factor) for picture in relit]
    return _View(numbers, light, np.stack(small))


def _estimate_frame_light(frame: np.ndarray, median: np.ndarray) -> np.ndarray:
    """Return the light (LIGHT_FLOATS,) of a frame (h, w, 3) relative to the median of all."""
    height, width = frame.shape[:2]
    x, y = (
        ((np.arange(n) + 0.5) / n * size).astype(int)
        for n, size in zip(GRID, (width, height), strict=True)
    )
    at = np.ix_(y, x)
    place = np.stack(np.meshgrid(2 * (x + 0.5) / width - 1, 2 * (y + 0.5) / height - 1))
    mean = np.moveaxis(median[at], -1, 0)
    weight = np.full(mean.shape, BackgroundConfig().sigma_floor ** -2)
    scene = np.concatenate([mean, weight, place]).reshape(8, -1).astype(np.float64)
    shown = frame[at].reshape(-1, 3).astype(np.float64)
    return fit_light(shown, scene, (width, height))


def _stack(pictures: list[np.ndarray], rig: CameraRig) -> np.ndarray:
    """Return the pictures (n, h, w, 3) of all views stacked, (V, n, H, W, 3), zero padded."""
    count = min(map(len, pictures))
    stack = np.zeros((len(rig), count, rig.height, rig.width, 3), np.uint8)
    for padded, picture in zip(stack, pictures, strict=True):
        padded[:, : picture.shape[1], : picture.shape[2]] = picture[:count]
    return stack


def masked_moments(
    frames: np.ndarray, covered: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return median and 1.4826 x median absolute deviation (h, w, 3) float32, and known (h, w)
    bool.

    They are those of the frames (n, h, w, 3) uint8 in which a pixel is not `covered` (n, h, w).
    known: whether these frames are enough; elsewhere the median is that of all frames.
    """
    count = len(frames)
    free = count - np.count_nonzero(covered, axis=0)
    known = free >= _LEAST_FREE
    left_out = covered & known
    number = np.where(known, free, count)[..., None]
    middle = _upper_median(np.where(left_out[..., None], np.uint8(255), frames), number)
    deviation = np.maximum(frames, middle) - np.minimum(frames, middle)
    deviation[left_out] = 255
    spread = _upper_median(deviation, number).astype(np.float32)
    std = with_prior((1.4826 * spread) ** 2, number)
    return middle.astype(np.float32), std.astype(np.float32), known


def _upper_median(values: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Return the upper median (h, w, c) of the `number` (h, w, 1) lowest of values (n, h, w, c).
    The values are sorted in place."""
    ordered = sort_stack(values)
    middle = np.broadcast_to(number // 2, values.shape[1:])[None]
    return np.take_along_axis(ordered, middle, axis=0)[0]


def _estimate_view(
    media: Media,
    view: _View,
    covered: np.ndarray,
    unseen: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard deviation (h, w, 3) float32 of a view's background. Where the
    background is never visible, it is extrapolated as `unseen` (h, w, 4) says; where that is not
    known, its density is below the foreground's."""
    width, height = media.size
    seen = media.frames(view.numbers)
    frames = np.stack(
        [relight_picture(frame, of) for frame, of in zip(seen, view.light, strict=True)]
    )
    rows, columns = view.small.shape[1:3]

    def enlarge(picture: np.ndarray) -> np.ndarray:
        size = (width, height)
        return np.asarray(
            cv2.resize(picture[:rows, :columns], size, interpolation=cv2.INTER_NEAREST)
        )

    mean, std = np.empty((2, height, width, 3), np.float32)
    masks = np.stack([enlarge(mask.view(np.uint8)).astype(bool) for mask in covered])
    known, band = np.ones((height, width), bool), max(1, 2**21 // frames[:, 0].size)
    for top in range(0, height, band):
        part = np.s_[:, top : top + band]
        own = masked_moments(frames[part], masks[part])
        mean[top : top + band], std[top : top + band], known[top : top + band] = own
    std[~known] = _UNIFORM_STD
    large = enlarge(unseen)
    known |= np.isnan(large[..., 3])
    mean[~known], std[~known] = large[~known][:, :3], large[~known][:, 3:]
    return mean, std
