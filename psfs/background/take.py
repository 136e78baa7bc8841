"""Estimation of the empty scene from a take with people in it, by all cameras together.

Expectation maximisation over frames spread over the take, in small pictures. Unknown are each
camera's background and which of its pixels people cover in each frame. The expectation of the
latter takes the evidence of the pixel itself, and that of the other cameras: a person is where
their rays meet. The background is then the median of the frames in which a pixel is not covered,
and the person's colours are those of the pixels that are.

A film of the empty scene, in light of its own, is the background where the frames do not contradict
it: furniture may have been moved since.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from operator import itemgetter

import cv2
import numpy as np

from psfs.background.config import BackgroundConfig
from psfs.background.coverage import Coverage, Rays
from psfs.background.gaussian import (
    Background,
    Moments,
    masked_moments,
    median_moments,
    select_rank,
    view_moments,
)
from psfs.background.light import GRID, fit_light, relight_picture, remove_light, scale_light
from psfs.background.pixel_densities import (
    PixelDensities,
    close_region,
    find_moving_region,
    find_same,
)
from psfs.cameras.camera import CameraRig
from psfs.common.numbers import pick_evenly
from psfs.common.pictures import scale_picture
from psfs.common.progress import map_in_threads
from psfs.footage.media import Media

#: Height of the floor, m.
_FLOOR = 0.0
#: Longest side of the small pictures in which people are searched, px.
_LONGEST_SIDE = 320
#: Greatest size of the frames of all views that are in memory at a time, bytes, with as many more
#: frames as the moments of a film are large.
_READ_BYTES, _OF_MOMENTS = 2**30, 16
#: Greatest number of alternations of expectation and maximisation, and the share of pixels that
#: change label below which they end.
_ROUNDS, _CONVERGED = 8, 0.002
#: Standard deviation, grey levels, with which a channel's normal density peaks at the uniform
#: foreground's, 1/256; and its factor where nothing is known of the background: one nat less.
_UNIFORM_STD = 256 / np.sqrt(2 * np.pi) * np.exp(1 / 3)


@dataclass(frozen=True, eq=False)
class _View:
    """A camera's samples: the frames (n, H, W, 3) uint8, None if they are too large to be kept;
    their light (n, LIGHT_FLOATS) relative to that of their median, and small pictures (n, h, w, 3)
    uint8 relit by the median's light. film: moments of a film of the empty scene in that light;
    None without a film."""

    frames: np.ndarray | None
    light: np.ndarray
    small: np.ndarray
    film: Moments | None


@dataclass(frozen=True, eq=False)
class Labels:
    """What a view's small pictures show.

    covered: (n, h, w) bool, where people are in each frame. unseen: (h, w, 4) mean and standard
    deviation of the background extrapolated from around, NaN where that is not known. same: (h, w)
    bool, where the film of the empty scene still holds.
    """

    covered: np.ndarray
    unseen: np.ndarray
    same: np.ndarray


def estimate_background_from_take(
    rig: CameraRig, media: Sequence[Media], films: Sequence[Media] | None = None
) -> Background:
    """Estimate the background from frames spread over the sequence itself and, if there are any,
    from `films` of the empty scene, one for each view.

    Each frame is relit by the light of the pixels' median. Where people are is found in small
    pictures, see `find_covered`. The background behind a person who covers it in nearly all frames
    is unknown; it is extrapolated from around, or its density is lower than the foreground's.
    """
    factor = rig.factor_within(_LONGEST_SIDE)
    numbers = pick_evenly(min(item.count for item in media)).tolist()
    n_bytes = 3 * (len(numbers) + _OF_MOMENTS) * rig.width * rig.height
    at_once = max(1, min(_READ_BYTES // n_bytes, os.cpu_count() or 1))
    with ThreadPoolExecutor(at_once) as readers, ThreadPoolExecutor() as pool:
        read = partial(_read_samples, numbers, factor, len(media) * n_bytes <= _READ_BYTES)
        background = Background.blank(rig)
        places = background.views(rig)
        views = list(readers.map(read, media, films or [None] * len(media), places))
        small = rig.scaled(factor)
        frames = _stack([view.small for view in views], small)
        shown = [[scale_picture(of, factor) for of in view.film] for view in views if view.film]
        film = _stack([np.stack(of) for of in shown], small) if shown else None
        labels = find_covered(small, frames, film, pool)
        estimates = readers.map(partial(_estimate_view, numbers), media, views, labels, places)
        deque(estimates, maxlen=0)
        return background


def find_covered(
    rig: CameraRig, frames: np.ndarray, film: np.ndarray | None, pool: ThreadPoolExecutor
) -> list[Labels]:
    """Return the labels of each view's pixels.

    frames: (V, n, h, w, 3) uint8 small pictures of the rig. film: (V, 2, h, w, 3) mean and standard
    deviation of the empty scene in the frames' light, if it was filmed.

    The background is at first the film. Without one, it is the median or, if people stay in a place
    and are thus in the median, extrapolated from around all that moves, and below it down to the
    floor, on which somebody who stays in a place stands; that one is taken with which the cameras
    agree better in the end. The agreement with an extrapolated one counts by the share of the
    background that it explains.
    """
    regions, medians = pool.map(find_moving_region, frames), pool.map(median_moments, frames)
    films = [None] * len(rig) if film is None else [(mean, std) for mean, std in film]
    moving = np.stack(list(regions))
    still = Rays(rig, moving)
    moments = list(medians)
    changes = moving
    if film is not None:
        # Somebody who sits moves in some views, or in none.
        seeds = moving | ~still.regions.any((1, 2), keepdims=True)
        changes = np.stack(list(pool.map(_find_changes, seeds, moments, films)))

    def label(to_floor: bool) -> tuple[float, list[Labels]]:
        rays = Rays(rig, changes, _FLOOR) if to_floor else still
        learn = partial(PixelDensities, from_median=not to_floor)
        densities = list(pool.map(learn, frames, rays.regions, moments, films))
        coverage = Coverage(rays)
        labels = _maximise(coverage, densities, pool)
        explained = np.mean([of.explained for of in densities]) if to_floor else 1.0
        return coverage.agreement * explained, labels

    starts = map_in_threads(label, (False, True) if film is None else (True,))
    return max(starts, key=itemgetter(0))[1]


def _find_changes(seeds: np.ndarray, moments: Moments, film: Moments) -> np.ndarray:
    """Return (h, w) bool: the regions in which something has come since the film that reach any of
    the `seeds` (h, w), which are such pixels."""
    changes = close_region((~find_same(*moments, film)).view(np.uint8))
    changes |= seeds & ~seeds.all()
    _, parts = cv2.connectedComponents(changes.view(np.uint8))
    return np.asarray(changes & np.isin(parts, np.unique(parts[seeds])))


def _update(
    coverage: Coverage, densities: list[PixelDensities], pool: ThreadPoolExecutor
) -> np.ndarray:
    """Return (V, n, h, w) bool: which pixels people cover, given the densities."""
    return coverage.update(list(pool.map(PixelDensities.evidence, densities)), pool)


def _maximise(
    coverage: Coverage, densities: list[PixelDensities], pool: ThreadPoolExecutor
) -> list[Labels]:
    """Alternate between what is behind and who covers which pixel until nothing changes."""
    covered = _update(coverage, densities, pool)
    before = np.zeros_like(covered)
    for _ in range(_ROUNDS):
        if (covered != before).mean() < _CONVERGED:
            break
        colours = list(pool.map(PixelDensities.learn, densities, covered))
        for of in densities:
            of.learn_person(colours)
        before, covered = covered, _update(coverage, densities, pool)
    unseen = pool.map(PixelDensities.extrapolate, densities)
    return [
        Labels(mask | ~of.known, picture, of.same)
        for of, mask, picture in zip(densities, covered, unseen, strict=True)
    ]


def _read_samples(
    numbers: list[int],
    factor: float,
    keep: bool,
    media: Media,
    film: Media | None,
    place: Moments,
) -> _View:
    """Return the samples of a view. place: receives the moments of the film, if there is one."""
    frames = np.empty((len(numbers), *media.size[::-1], 3), np.uint8)
    for into, frame in zip(frames, media.frames(numbers), strict=True):
        into[...] = frame
    row, column = _grid(media.size)
    shown = frames[:, row[:, None], column]
    median = select_rank(shown, len(numbers) // 2)
    light = _estimate_light(shown, median, media.size)
    scaled = (scale_picture(picture, factor) for picture in frames)
    small = np.stack([*map(relight_picture, scaled, scale_light(light, factor))])
    if film is None:
        return _View(frames if keep else None, light, small, None)
    mean, std = view_moments(film)
    (of,) = _estimate_light(mean[None, row[:, None], column], median, media.size)
    place[0][...] = np.stack([*remove_light(mean, of)], -1)
    of[3:6] = 0  # a deviation has no offset
    place[1][...] = np.stack([*remove_light(std, of)], -1)
    return _View(frames if keep else None, light, small, place)


def _grid(size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows and the columns of the pixels from which the light of pictures is
    estimated."""
    column, row = (
        ((np.arange(n) + 0.5) / n * of).astype(int) for n, of in zip(GRID, size, strict=True)
    )
    return row, column


def _estimate_light(shown: np.ndarray, median: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return the light (n, LIGHT_FLOATS) of pictures of a size relative to that of their median,
    from the colours (n, h, w, 3) and (h, w, 3) of the pixels of `_grid`."""
    row, column = (2 * (of + 0.5) / n - 1 for of, n in zip(_grid(size), size[::-1], strict=True))
    mean = np.moveaxis(median.astype(np.float64), -1, 0)
    weight = np.full(mean.shape, BackgroundConfig().sigma_floor ** -2)
    scene = np.concatenate([mean, weight, np.stack(np.meshgrid(column, row))]).reshape(8, -1)
    return fit_light(shown.reshape(len(shown), -1, 3).astype(np.float64), scene, size)


def _stack(pictures: list[np.ndarray], rig: CameraRig) -> np.ndarray:
    """Return the pictures (n, h, w, 3) of all views stacked, (V, n, H, W, 3), zero padded."""
    stack = np.zeros((len(rig), len(pictures[0]), rig.height, rig.width, 3), pictures[0].dtype)
    for padded, picture in zip(stack, pictures, strict=True):
        padded[:, : picture.shape[1], : picture.shape[2]] = picture
    return stack


def _estimate_view(
    numbers: list[int], media: Media, view: _View, labels: Labels, place: Moments
) -> None:
    """Write mean and standard deviation of a view's background to a `place` (h, w, 3) float32,
    which holds those of the film, if there is one. Where the background is never visible, it is
    extrapolated; where that is not known, its density is below the foreground's."""
    rows, columns = view.small.shape[1:3]

    def enlarge(picture: np.ndarray) -> np.ndarray:
        cropped = picture[:rows, :columns]
        enlarged = cv2.resize(
            cropped.view(np.uint8) if cropped.dtype == bool else cropped,
            media.size,
            interpolation=cv2.INTER_NEAREST,
        )
        return np.asarray(enlarged).view(picture.dtype)

    unseen, learnt = enlarge(labels.unseen), ~enlarge(labels.same)
    some = np.s_[:] if learnt.all() else learnt.ravel()  # a slice copies nothing
    frames = np.empty((len(numbers), np.count_nonzero(learnt), 3), np.uint8)
    again = media.frames(numbers) if view.frames is None else view.frames
    for into, frame, light in zip(frames, again, view.light, strict=True):
        into[...] = relight_picture(frame, light).reshape(-1, 3)[some]
    covered = np.stack([enlarge(mask).ravel()[some] for mask in labels.covered])
    mean, std = place
    count = (~learnt).astype(int)
    for whole, part in zip((mean, std, count), masked_moments(frames, covered), strict=True):
        whole[learnt] = part
    known = count > 0
    std[~known] = _UNIFORM_STD
    known |= np.isnan(unseen[..., 3])
    mean[~known], std[~known] = unseen[~known][:, :3], unseen[~known][:, 3:]
