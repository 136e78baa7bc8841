"""Estimation of the empty scene from a take with a moving person, by all cameras together."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from psfs.background.config import BackgroundConfig, LightConfig
from psfs.background.estimation_config import BackgroundModelConfig, TakeConfig
from psfs.background.gaussian import (
    VIEWS_AT_ONCE,
    Background,
    median_moments,
    sort_stack,
    stack_views,
    with_prior,
)
from psfs.background.hull import CoarseHull
from psfs.background.light import GRID, fit_light, relight_picture
from psfs.background.person_search import (
    N_COLOURS,
    PersonSearch,
    moving_region,
    person_colours,
)
from psfs.background.standing import StandingPeople
from psfs.cameras.camera import CameraRig
from psfs.cameras.scaling import scale_picture
from psfs.footage.media import Media

#: Standard deviation, grey levels, with which a channel's normal density peaks at the uniform
#: foreground's, 1/256.
_UNIFORM_STD = 256 / np.sqrt(2 * np.pi)


@dataclass(frozen=True, eq=False)
class _View:
    """A camera's samples: numbers of the frames, their light (n, LIGHT_FLOATS) relative to that of
    their median, and small pictures (n, h, w, 3) uint8 relit by the median's light."""

    numbers: list[int]
    light: np.ndarray
    small: np.ndarray


def estimate_background_from_take(
    rig: CameraRig,
    media: Sequence[Media],
    model: BackgroundModelConfig | None = None,
    config: TakeConfig | None = None,
    standing: StandingPeople | None = None,
    near: bool = False,
) -> Background:
    """Estimate the background from frames spread over the sequence itself.

    Each frame is relit by the light of the pixels' median. Then two steps alternate in small
    pictures: the pixels whose colours are the person's rather than the background's, see
    `PersonSearch`, are carved to a coarse hull by all cameras; the background becomes the median of
    the frames in which that hull appears elsewhere, and the person's colours those inside. The
    background behind a person who hides it in nearly all frames is unknown; its density is lower
    than the foreground's.

    standing: places of people, known from an earlier estimate. If that was poor, the space that
    they take up hides the background, too, and nothing is extrapolated into it. near: nothing is
    hidden far from them.
    """
    model, config = model or BackgroundModelConfig(), config or TakeConfig()
    factor = rig.factor_within(config.longest_side)
    small = rig.scaled(factor)
    with ThreadPoolExecutor(min(VIEWS_AT_ONCE, os.cpu_count() or 1)) as pool:
        views = list(pool.map(lambda own: _read_samples(own, factor, model), media))
        hidden, unseen, hull, poor = _find_hidden(small, views, pool, model, config)
        if poor and standing is not None:
            numbers = [view.numbers for view in views]
            covered = _cover_with_people(hull, standing, numbers)
            if near:
                hidden &= _cover_with_people(hull, standing, numbers, config.still.girth)
            hidden |= covered
            unseen[covered.mean(1) > config.still.covered_share] = np.nan
        again = partial(_estimate_again, model=model, config=config)
        moments = pool.map(again, media, views, hidden, unseen)
        return Background(*stack_views(rig, moments, model), poor=poor)


def _read_samples(media: Media, factor: float, model: BackgroundModelConfig) -> _View:
    numbers = media.spread(model.samples)
    frames = np.stack(list(media.frames(numbers)))
    median, _ = median_moments(frames, model)
    light = np.stack([_estimate_frame_light(frame, median) for frame in frames])
    own = [relight_picture(frame, of) for frame, of in zip(frames, light, strict=True)]
    small = [scale_picture(picture, factor) for picture in own]
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
    return fit_light(shown, scene, (width, height), LightConfig())


def _find_hidden(
    rig: CameraRig,
    views: list[_View],
    pool: ThreadPoolExecutor,
    model: BackgroundModelConfig,
    config: TakeConfig,
) -> tuple[np.ndarray, np.ndarray, CoarseHull, bool]:
    """Return the pixels that the person may cover in each sample (V, n, h, w) bool, and the
    extrapolated background's mean and standard deviation (V, h, w, 4), in small pictures; the
    hull; and whether that shows people poorly."""
    frames = _stack([view.small for view in views], rig)
    regions = np.stack(list(pool.map(lambda own: moving_region(own, config), frames)))
    hull = CoarseHull(rig, regions, config.voxels)
    regions &= hull.reproject(hull.inside, config.margin)
    hidden = np.zeros(frames.shape[:-1], bool)

    def search(own: np.ndarray, region: np.ndarray) -> PersonSearch:
        return PersonSearch(own, region, *median_moments(own, model), config)

    searches = list(pool.map(search, frames, regions))
    colours = np.ones(N_COLOURS)
    explained = _measure_explained(hull, searches, config)
    still = explained < config.explained
    if still:
        for of in searches:
            of.expect_room()
        for _ in range(config.rounds):
            counts = [of.count_unexplained(colours) for of in searches]
            colours = person_colours(counts, config.unexplained)
        for of in searches:
            of.trust_median(colours)
    for _ in range(config.rounds):
        before = hidden
        evidence = [of.evidence(colours) for of in searches]
        hidden = _cover_with_hull(hull, searches, evidence, config)
        if still:
            free = [of.find_free(*own) for of, *own in zip(searches, evidence, hidden, strict=True)]
            hidden &= ~np.stack(free)
        if (hidden != before).mean() < config.converged_share:
            break

        def learn(view: int, hidden: np.ndarray = hidden) -> None:
            searches[view].learn(*masked_moments(frames[view], hidden[view], model, config))

        list(pool.map(learn, range(len(searches))))
        shown = [of.colours(colours, own) for of, own in zip(searches, hidden, strict=True)]
        colours = person_colours(shown, config.unexplained)
    unseen = np.stack([of.extrapolate(colours) for of in searches])
    return hidden, unseen, hull, explained < config.still.explained


def _cover_with_people(
    hull: CoarseHull, standing: StandingPeople, numbers: list[list[int]], girth: float = 1.0
) -> np.ndarray:
    """Return (V, n, h, w) bool: the pixels where people who stand, `girth` times as stout, appear
    in the samples, whose frames have these `numbers` in each view."""
    samples = zip(*numbers, strict=False)
    shown = [
        hull.reproject(hull.inside & standing.contain(hull.centres, own[0], girth), 0)
        for own in samples
    ]
    return np.stack(shown, axis=1)


def _measure_explained(hull: CoarseHull, searches: list[PersonSearch], config: TakeConfig) -> float:
    """Return the share of the silhouettes against the medians that their common hull covers; it is
    low if the medians show a person."""
    evidence = [of.evidence(np.ones(N_COLOURS))[:: config.explained_stride] for of in searches]
    person = np.stack(evidence) > 0
    covered = [hull.reproject(hull.find_occupied(own), 0) for own in np.moveaxis(person, 1, 0)]
    shown = person & np.stack(covered, axis=1)
    return float((shown.sum((0, 2, 3)) / np.maximum(person.sum((0, 2, 3)), 1)).mean())


def _cover_with_hull(
    hull: CoarseHull,
    searches: list[PersonSearch],
    evidence: list[np.ndarray],
    config: TakeConfig,
) -> np.ndarray:
    """Return (V, n, h, w) bool: the pixels where the common hull of the evidence (n, h, w) of each
    view appears and which do not look like background themselves."""
    shown = []
    possible = [of.find_possible(own) for of, own in zip(searches, evidence, strict=True)]
    for maps, near in zip(zip(*evidence, strict=True), np.stack(possible, 1), strict=True):
        person = np.stack(maps) > config.least_evidence
        occupied = hull.find_occupied(person, config.contradicting_cameras) & (
            hull.sum_maps(maps) > 0
        )
        shown.append(hull.reproject(occupied, config.margin) & near)
    return np.stack(shown, axis=1)


def _stack(pictures: list[np.ndarray], rig: CameraRig) -> np.ndarray:
    """Return the pictures (n, h, w, 3) of all views stacked, (V, n, H, W, 3), zero padded."""
    count = min(map(len, pictures))
    stack = np.zeros((len(rig), count, rig.height, rig.width, 3), np.uint8)
    for own, picture in zip(stack, pictures, strict=True):
        own[:, : picture.shape[1], : picture.shape[2]] = picture[:count]
    return stack


def masked_moments(
    frames: np.ndarray, hidden: np.ndarray, model: BackgroundModelConfig, config: TakeConfig
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return median and 1.4826 x median absolute deviation (h, w, 3) float32, and known (h, w)
    bool.

    They are those of the frames (n, h, w, 3) uint8 in which a pixel is not `hidden` (n, h, w).
    known: whether these frames are enough; elsewhere the median is that of all frames.
    """
    count = len(frames)
    free = count - np.count_nonzero(hidden, axis=0)
    known = free >= max(config.least_free, config.free_share * count)
    used = hidden & known
    number = np.where(known, free, count)[..., None]
    middle = _upper_median(np.where(used[..., None], np.uint8(255), frames), number)
    deviation = np.maximum(frames, middle) - np.minimum(frames, middle)
    deviation[used] = 255
    spread = _upper_median(deviation, number).astype(np.float32)
    std = with_prior((1.4826 * spread) ** 2, number, model)
    return middle.astype(np.float32), std.astype(np.float32), known


def _upper_median(values: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Return the upper median (h, w, c) of the `number` (h, w, 1) lowest of values (n, h, w, c).
    The values are sorted in place."""
    ordered = sort_stack(values)
    middle = np.broadcast_to(number // 2, values.shape[1:])[None]
    return np.take_along_axis(ordered, middle, axis=0)[0]


def _estimate_again(
    media: Media,
    view: _View,
    hidden: np.ndarray,
    unseen: np.ndarray,
    model: BackgroundModelConfig,
    config: TakeConfig,
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

    def enlarge(mask: np.ndarray) -> np.ndarray:
        small = mask[:rows, :columns].astype(np.uint8)
        large = cv2.resize(small, (width, height), interpolation=cv2.INTER_NEAREST)
        return np.asarray(large, bool)

    mean, std = np.empty((2, height, width, 3), np.float32)
    masks, band = np.stack([enlarge(mask) for mask in hidden]), max(1, 2**21 // frames[:, 0].size)
    known = np.ones((height, width), bool)
    for top in range(0, height, band):
        part = np.s_[:, top : top + band]
        own = masked_moments(frames[part], masks[part], model, config)
        mean[top : top + band], std[top : top + band], known[top : top + band] = own
    std[~known] = _UNIFORM_STD * np.exp(config.hidden_prior / 3)
    large = cv2.resize(unseen[:rows, :columns], (width, height), interpolation=cv2.INTER_NEAREST)
    known |= np.isnan(large[..., 3])
    mean[~known], std[~known] = large[~known][:, :3], large[~known][:, 3:]
    return mean, std
