"""Search for a person in frames of a static camera whose empty scene is unknown.

Two things are known before anything else: around the region where something moves, the median shows
the background; and the person's colours are those in the region that this background does not
explain, in all cameras alike.
"""

from __future__ import annotations

import cv2
import numpy as np

from psfs.background.config import BackgroundConfig
from psfs.background.estimation_config import TakeConfig

#: Colour bins per channel.
_BINS = 16
#: Pixels around one that looks like the person, which may belong to the person, too.
_NEAR = np.ones((3, 3), np.uint8)
#: Number of colour bins.
N_COLOURS = _BINS**3


def moving_region(frames: np.ndarray, config: TakeConfig) -> np.ndarray:
    """Return (h, w) bool: the pixels where frames (n, h, w, 3) uint8 of a static camera change,
    with holes filled. A person who moves a little at times is inside the region."""
    changes = (measure_changes(frames, config) > 1).view(np.uint8)
    moving = cv2.morphologyEx(changes, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    gap = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (config.gap, config.gap))
    closed = cv2.morphologyEx(moving, cv2.MORPH_CLOSE, gap)
    outlines, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros(moving.shape, np.uint8)
    large = [outline for outline in outlines if cv2.contourArea(outline) > config.least_area]
    cv2.drawContours(filled, large, -1, 1, cv2.FILLED)
    return cv2.dilate(filled, np.ones((3, 3), np.uint8)) > 0


def measure_changes(frames: np.ndarray, config: TakeConfig) -> np.ndarray:
    """Return (h, w) float32: by how much, in the channel that does most, the pixels of frames (n,
    h, w, 3) uint8 of a static camera change; as a multiple of the least change that is motion."""
    smooth = np.stack([cv2.GaussianBlur(frame, (0, 0), 1.0) for frame in frames])
    ordered = np.sort(smooth, axis=0)
    outliers = 1 if len(frames) > 3 else 0  # at either end
    change = (ordered[-1 - outliers] - ordered[outliers]).max(-1).astype(np.float32)
    noise = float(np.median(change))
    return change / max(config.moving, 3 * noise)


class PersonSearch:
    """Log ratios of the person's colours over the background's in one camera's frames.

    frames: (n, h, w, 3) uint8. region: (h, w) bool, beyond which nobody is. mean, std: (h, w, 3),
    the frames' moments.

    All densities are relative to the uniform one. The background is the median at first. If that
    shows a person, it counts only as far as it resembles the background that is extrapolated from
    the nearest pixels outside of the region on either side, above and below.
    """

    def __init__(
        self,
        frames: np.ndarray,
        region: np.ndarray,
        mean: np.ndarray,
        std: np.ndarray,
        config: TakeConfig,
    ) -> None:
        self.region, self._config = region, config
        self._shape = frames.shape[:3]
        self._shown = frames[:, region].astype(np.float32)
        self._colours = colour_bins(self._shown)
        self._around = _find_surroundings(cv2.blur(mean, (3, 3)), region)
        self._unseen = self._surrounding_density(self._shown)
        self._median = mean[region], std[region]
        self._room = colour_bins(mean[~cv2.dilate(region.view(np.uint8), _NEAR).astype(bool)])
        self._change = measure_changes(frames, config)
        self._proven = np.ones_like(region)
        self.learn(mean, std, np.ones_like(region))

    def expect_room(self) -> None:
        """Expect the colours of the picture around the region behind all pixels that change.

        What looks the same in all frames proves no background: somebody may keep still there.
        """
        proven = self._change > self._config.still.proof
        self._proven = cv2.dilate(proven.view(np.uint8), _NEAR) > 0
        seen = np.bincount(self._room, minlength=N_COLOURS).astype(float)
        density = person_colours([seen], self._config.unexplained)[self._colours]
        share = np.float32(self._config.still.room) * self._proven[self.region]
        self._unseen = np.asarray((1 - share) * self._unseen + share * density, np.float32)

    def count_unexplained(self, person: np.ndarray) -> np.ndarray:
        """Return the histogram (N_COLOURS,) of the pixels that the colours `person` (N_COLOURS,)
        explain better than the extrapolated background."""
        density = person[self._colours]
        return self._histogram(density / (density + self._unseen))

    def colours(self, person: np.ndarray, within: np.ndarray) -> np.ndarray:
        """Return the histogram (N_COLOURS,) of the pixels `within` (n, h, w) bool that the colours
        `person` (N_COLOURS,) explain better than the background."""
        density = person[self._colours]
        return self._histogram(density / (density + self._background) * within[:, self.region])

    def trust_median(self, person: np.ndarray) -> None:
        """Take the median for background as far as it does not look like the person's colours
        (N_COLOURS,)."""
        mean, std = self._median
        unseen = self._surrounding_density(mean[None])[0]
        share = self._picture((unseen / (unseen + person[colour_bins(mean)]))[None], 0.0)[0]
        share = cv2.GaussianBlur(share, (0, 0), self._config.median_blur)[self.region]
        trust = (1 - self._config.unsure) * np.clip(4 * share - 1.5, 0, 1)
        trust *= self._proven[self.region]
        estimated = self._density(self._shown, mean, std)
        self._background = trust * estimated + (1 - trust) * self._unseen

    def learn(self, mean: np.ndarray, std: np.ndarray, known: np.ndarray) -> None:
        """Take the moments (h, w, 3) for the background of the pixels that are `known` (h, w)."""
        where = self.region
        estimated = self._density(self._shown, mean[where], std[where])
        mixed = (1 - self._config.unsure) * estimated + self._config.unsure * self._unseen
        self._background = np.where((known & self._proven)[where], mixed, self._unseen)

    def evidence(self, person: np.ndarray) -> np.ndarray:
        """Return (n, h, w) float32: the log ratio for the person's colours (N_COLOURS,), the mean
        over 3 x 3 pixels."""
        limit = self._config.colour_limit
        ratios = np.log(person[self._colours] / self._background)
        pictures = self._picture(np.clip(ratios, -limit, limit), -limit)
        return np.stack([cv2.blur(picture, (3, 3)) for picture in pictures])

    def find_possible(self, evidence: np.ndarray) -> np.ndarray:
        """Return (n, h, w) bool: where the `evidence` (n, h, w) lets somebody be seen; with less
        evidence in pixels that never change, whose background nothing proves."""
        config = self._config
        person = (evidence > config.least_evidence).view(np.uint8)
        near = np.stack([cv2.dilate(own, _NEAR) for own in person]) > 0
        return near | ((evidence > config.still.least_evidence) & ~self._proven)

    def find_free(self, evidence: np.ndarray, hidden: np.ndarray) -> np.ndarray:
        """Return (n, h, w) bool: the frames with least `evidence` (n, h, w) of the pixels that
        change, yet are `hidden` (n, h, w) nearly always: they show their background at times."""
        config = self._config.still
        low, high = np.quantile(evidence, (config.extremes, 1 - config.extremes), axis=0)
        always = hidden.mean(0) > config.hidden_share
        two = always & (self._change > config.contrast) & (high - low > config.least_range)
        return two & (evidence < (low + high) / 2)

    def extrapolate(self, person: np.ndarray) -> np.ndarray:
        """Return the extrapolated background's mean and standard deviation (h, w, 4) float32, NaN
        outside of the region and where it may look like the person's colours (N_COLOURS,)."""
        colours, shares = (np.stack(of) for of in zip(*self._around, strict=True))
        mean = np.einsum("kp,kpc->pc", shares, colours)
        variance = np.einsum("kp,kpc->p", shares, (colours - mean) ** 2) / 3
        std = np.sqrt(variance + self._config.extrapolated_std**2)
        ratio = np.log(person[colour_bins(mean)] / self._surrounding_density(mean[None])[0])
        limits = self._config.still.least_evidence, self._config.least_extrapolated_evidence
        std[ratio > np.where(self._proven[self.region], limits[1], limits[0])] = np.nan
        picture = np.full((*self._shape[1:], 4), np.nan, np.float32)
        picture[self.region] = np.concatenate([mean, std[:, None]], -1)
        return picture

    def _histogram(self, weights: np.ndarray) -> np.ndarray:
        return np.bincount(self._colours.ravel(), weights.ravel(), N_COLOURS)

    def _picture(self, values: np.ndarray, outside: float) -> np.ndarray:
        """Return values (n, pixels of the region) as pictures (n, h, w) float32."""
        pictures = np.full((len(values), *self._shape[1:]), outside, np.float32)
        pictures[:, self.region] = values
        return pictures

    def _surrounding_density(self, shown: np.ndarray) -> np.ndarray:
        """Return the density (n, pixels) of the colours `shown` (n, pixels, 3) if the background
        looks as it does around the region."""
        std = np.float32(self._config.extrapolated_std)
        near = sum(
            share * self._density(shown, colour, np.full_like(colour, std))
            for colour, share in self._around
        )
        uniform = self._config.unexplained
        return np.asarray((1 - uniform) * near + uniform, np.float32)

    def _density(self, shown: np.ndarray, mean: np.ndarray, std: np.ndarray) -> np.ndarray:
        """Return the density (n, pixels) of the colours `shown` (n, pixels, 3) before a background
        of these moments (pixels, 3), brighter or darker."""
        light, weight = BackgroundConfig(), np.maximum(std, self._config.least_std) ** -2
        lit = weight * mean
        factor = np.einsum("npc,pc->np", shown, lit) / ((lit * mean).sum(-1) + 1e-6)
        factor = np.clip(factor, light.shadow_low, light.shadow_high)
        rest = shown - factor[..., None] * mean
        distance = np.einsum("npc,npc,pc->np", rest, rest, weight)
        distance += ((1 - factor) / self._config.shadow_width) ** 2
        peak = 256**3 * (2 * np.pi) ** -1.5 * np.sqrt(weight.prod(-1))
        return np.asarray(peak * np.exp(-0.5 * distance), np.float32)


def colour_bins(colours: np.ndarray, levels: int = _BINS) -> np.ndarray:
    """Return the number of the bin (...) of colours (..., 3), with `levels` bins per channel, a
    power of 2."""
    bins = (colours // (256 // levels)).astype(np.intp)
    return (bins[..., 0] * levels + bins[..., 1]) * levels + bins[..., 2]


def person_colours(histograms: list[np.ndarray], unexplained: float) -> np.ndarray:
    """Return the person's colours (N_COLOURS,), a density relative to the uniform one, from the
    cameras' histograms; the share `unexplained` is uniform. Each camera counts alike; neighbouring
    colours share their counts."""
    shares = [own / max(own.sum(), 1e-6) for own in histograms]
    cube = np.mean(shares, axis=0).reshape(3 * [_BINS]).astype(np.float32)
    for axis in range(3):
        flat = np.moveaxis(cube, axis, 0).reshape(_BINS, -1)
        flat = cv2.GaussianBlur(flat, (1, 0), sigmaX=0.1, sigmaY=0.7)
        cube = np.moveaxis(flat.reshape(3 * [_BINS]), 0, axis)
    total = max(float(cube.sum()), 1e-6)
    return np.asarray((1 - unexplained) * N_COLOURS / total * cube.ravel() + unexplained)


def _find_surroundings(
    picture: np.ndarray, region: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return colours (pixels, 3) and shares (pixels,) of the nearest pixels of a picture (h, w, 3)
    outside of the region (h, w), to the left, to the right, above and below each of its pixels."""
    height, width = region.shape
    indices: np.ndarray = np.indices(region.shape)
    row, column = indices[0], indices[1]
    left = np.maximum.accumulate(np.where(region, -1, column), 1)
    right = np.minimum.accumulate(np.where(region, width, column)[:, ::-1], 1)[:, ::-1]
    above = np.maximum.accumulate(np.where(region, -1, row), 0)
    below = np.minimum.accumulate(np.where(region, height, row)[::-1], 0)[::-1]
    found = []
    for y, x in ((row, left), (row, right), (above, column), (below, column)):
        y, x = y[region], x[region]
        inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
        distance = abs(y - row[region]) + abs(x - column[region])
        colour = picture[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
        found.append((colour, np.where(inside, 1 / (1 + distance), 1e-9)))
    total = sum(share for _, share in found)
    return [(colour, share / total) for colour, share in found]
