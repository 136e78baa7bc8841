"""The background is learnt from a take in which somebody moves, whatever the light does."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from helpers import scenes

from psfs.background.coverage import Coverage, Rays
from psfs.background.gaussian import median_moments
from psfs.background.pixel_densities import PixelDensities, find_moving_region
from psfs.background.take import estimate_background_from_take
from psfs.reference.silhouette import picture_masks

SIZE = (201, 153)
#: Pictures of takes in which nothing is measured along an outline.
SMALL = (121, 91)
#: Least standard deviation where the background was never seen.
EXTRAPOLATED = 10.0


class Pictures:
    """A camera's pictures in memory: as much of `Media` as is asked for."""

    name, paths = "c", ()

    def __init__(self, frames: np.ndarray) -> None:
        self.held, self.count, self.size = frames, len(frames), (frames.shape[2], frames.shape[1])

    def frames(self, indices=slice(None)):
        return iter(self.held[indices])

    __iter__ = frames


def take(
    shifts: np.ndarray, gains: np.ndarray, posters: bool = False, rooted: float = 0.0,
    hidden: bool = False, size=SMALL,
):  # fmt: skip
    """Rig, empty scene (V, H, W, 3) and pictures of a block that stands at `shifts` (n, 2) m, in
    light of `gains` (n, 3). rooted: height, m, of the leg, which stays in its place. hidden:
    whether it is as wide as the rest and has between knee and foot the colours of the scene in
    shadow."""
    rig, random = scenes.ring(5, size), np.random.default_rng(3)
    axes = [np.arange(-0.2, 0.2, 0.015), np.arange(-0.15, 0.15, 0.015), np.arange(0, 1.5, 0.015)]
    block = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    block[block[:, 2] < rooted, :2] *= 1.0 if hidden else 0.3
    y, x = np.indices((rig.height, rig.width))
    x, y, poster = x * SIZE[0] / size[0], y * SIZE[0] / size[0], size[0] // 10
    scene = 110 + 30 * np.sin(x / 23)[..., None] + 20 * np.cos(y / 31)[..., None] * [1, 0.5, 0.2]
    scene = np.tile(scene, (len(rig), 1, 1, 1))
    for _ in range(60 * posters):
        view, left, top = random.integers([0, 0, 0], [len(rig), size[0] - poster, size[1] - poster])
        scene[view, top : top + poster, left : left + poster] = random.uniform(20, 200, 3)
    frames = np.empty((len(rig), len(shifts), *scene.shape[1:]), np.uint8)
    for k, (shift, gain) in enumerate(zip(shifts, gains, strict=True)):
        for view, camera in enumerate(rig):
            image = scene[view].copy()
            moves = block[:, 2:] >= rooted
            _, row, column, _ = camera.look_up(block + moves * np.array([*shift, 0]))
            image[row, column] = 30, 40, 190
            shank = hidden & (block[:, 2] > 0.3) & (block[:, 2] < 0.75)
            image[row[shank], column[shank]] = 0.75 * scene[view, row[shank], column[shank]]
            noise = random.normal(0, 1.5, image.shape)
            frames[view, k] = np.clip(image * gain + noise, 0, 255)
    media = [
        Pictures(own[:, : camera.size[1], : camera.size[0]])
        for own, camera in zip(frames, rig, strict=True)
    ]
    return rig, scene, media


def wrong_share(background, scene: np.ndarray, rig) -> float:
    """Share of the pixels that are believed to be of another colour than they are, relative to the
    brightness of each view."""
    known = picture_masks(rig) & (background.std.max(-1) < EXTRAPOLATED)
    ratio = np.median((background.mean / scene)[known], axis=0)
    return float((np.abs(background.mean - ratio * scene)[known].max(-1) > 12).mean())


def test_somebody_who_walks_about_is_not_in_it() -> None:
    turn = np.linspace(0, 2 * np.pi, 13)[:-1]
    shifts = 0.5 * np.stack([np.cos(turn), np.sin(turn)], -1)
    gains = np.linspace(0.85, 1.2, 12)[:, None] * np.linspace([1, 1, 1], [1.1, 1, 0.9], 12)
    gains[5:] *= 0.85
    rig, scene, media = take(shifts, gains, posters=True)
    media[1] = Pictures(media[1].held[:-2])  # a view that ends earlier
    background = estimate_background_from_take(rig, media)
    assert wrong_share(background, scene, rig) < 2e-3
    assert (background.std < 6).mean() > 0.97


def test_somebody_who_stays_in_a_place_is_unknown() -> None:
    """He stands there all the time, swaying a little above the knees."""
    sway = np.arange(12.0)
    shifts = 0.08 * np.stack([np.sin(sway), np.cos(1.7 * sway)], -1)
    rig, scene, media = take(shifts, np.ones((12, 3)), rooted=0.6, size=SIZE)
    background = estimate_background_from_take(rig, media)
    assert wrong_share(background, scene, rig) < 0.01
    height, width = media[0].size[::-1]
    there = np.abs(media[0].held - scene[0, :height, :width]).max(-1) > 15
    always = there.all(0)
    unknown = background.std[0, :height, :width].max(-1) >= EXTRAPOLATED
    assert unknown[always].mean() > 0.98 and unknown.mean() < 1.4 * always.mean()
    assert unknown[~there.any(0)].mean() <= 0.01


@pytest.mark.parametrize("moves", ["nothing", "trunk"])
def test_a_film_of_the_empty_scene_is_one_more_observation(moves: str) -> None:
    """It was made in other light. Who keeps still, or their feet, is known by it alone; something
    has come since in a picture of those who move."""
    sway, still = np.arange(12.0) * (moves != "nothing"), moves == "nothing"
    shifts = 0.08 * np.stack([np.sin(sway), np.cos(1.7 * sway)], -1)
    rig, scene, media = take(shifts, np.ones((12, 3)), rooted=0.75 * (not still), hidden=not still)
    empty = np.clip(0.8 * scene + 5 + np.random.default_rng(4).normal(0, 1.5, scene.shape), 0, 255)
    films = [
        Pictures(of[None, : c.size[1], : c.size[0]].astype(np.uint8))
        for of, c in zip(empty, rig, strict=True)
    ]
    if not still:
        media[0].held[:, 3:21, 3:18] = scene[0, 3:21, 3:18] = 40, 160, 60
    background = estimate_background_from_take(rig, media, films)
    assert wrong_share(background, scene, rig) < 2e-3
    for view, camera in enumerate(rig):
        assert (
            background.std[view, : camera.size[1], : camera.size[0]] < EXTRAPOLATED
        ).mean() > 0.99


def swaying(count: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Frames (n, 90, 120, 3) uint8 of a red block that sways by its own width and hides the middle
    of it always, and where it is (n, 90, 120) bool."""
    random = np.random.default_rng(0)
    frames = np.clip(120 + random.normal(0, 2, (count, 90, 120, 3)), 0, 255).astype(np.uint8)
    person = np.zeros(frames.shape[:3], bool)
    for k in range(count):
        person[k, 30:70, 50 + 2 * (k % 4) : 65 + 2 * (k % 4)] = True
    frames[person] = [20, 30, 160]
    return frames, person


def densities(frames: np.ndarray, region: np.ndarray) -> PixelDensities:
    return PixelDensities(frames, region, median_moments(frames), None, False)


def test_the_persons_colours_are_found_although_the_median_shows_them() -> None:
    frames, person = swaying()
    region = find_moving_region(frames)
    search = densities(frames, region)
    for _ in range(3):
        search.learn_person([search.count_colours(search.evidence() > 0)])
    found = search.evidence() > 0
    assert (found & person).sum() > 0.9 * (found | person).sum()
    extrapolated = search.extrapolate()
    assert np.isnan(extrapolated[~region]).all()
    assert np.median(np.abs(extrapolated[person[0] & region][:, :3] - 120)) < 6


def test_what_is_covered_in_most_frames_that_look_alike_is_no_background() -> None:
    """The person, who hides a part always, is overlooked in some frames."""
    frames, person = swaying()
    search = densities(frames, person.any(0))
    covered = person.copy()
    covered[:4] = False
    search.learn(covered)
    assert not search.known[person.all(0)].any()
    assert search.known[~person.any(0)].all()


def test_others_cameras_say_where_the_person_is_who_hides_from_one() -> None:
    """In one camera the person looks like the background, in another something else moves. Where
    few other cameras look it may be a person."""
    rig = scenes.ring(6, SIZE)
    masks = scenes.masks_of(rig) > 0
    coverage = Coverage(Rays(rig, np.ones(masks.shape, bool)))
    evidence = np.where(masks, 4.0, -4.0)[:, None].astype(np.float32)
    evidence[0] = -0.5
    beside = ~masks[1] & (np.arange(rig.width) < 30)
    evidence[1, 0, beside] = 4.0
    pool = ThreadPoolExecutor(2)
    covered = coverage.update(list(evidence), pool)[:, 0]
    assert (covered[0] & masks[0]).sum() > 0.5 * (covered[0] | masks[0]).sum()
    assert covered[1, beside].mean() < 0.3 and covered[1, masks[1]].mean() > 0.95
    clean = Coverage(Rays(rig, np.ones(masks.shape, bool)))
    clean.update(list(np.where(masks, 4.0, -4.0)[:, None].astype(np.float32)), pool)
    assert clean.agreement > coverage.agreement
