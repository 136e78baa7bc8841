"""Densities of a pixel's colour where a static camera shows the background, and a person."""

from __future__ import annotations

import cv2
import numpy as np

from psfs.background.config import BackgroundConfig
from psfs.background.gaussian import Moments, masked_moments, select_rank
from psfs.common.colours import N_BINS, colour_bins

#: Least change of a pixel over a take that is motion, grey levels: more than shades of a shadow and
#: than three times the noise.
_MOTION = 18.0
#: Width of gaps in moving regions that are closed, and the area of the largest one that is noise.
_GAP_PX, _SPECK_PX2 = 9, 40.0
#: Least standard deviation of an estimated background, and that of an extrapolated one, grey
#: levels.
_LEAST_STD, _EXTRAPOLATED_STD = 5.0, 10.0
#: Standard deviation of the light factor of background pixels around 1.
_SHADE = 0.06
#: Share of every density that is another: what no model explains.
_UNEXPLAINED = 0.05
#: Width of the border outside of a region, px, on which it is measured what an extrapolation
#: explains.
_BORDER_PX = 12
#: Squared distance, standard deviations, from which densities are next to nothing beside what is
#: unexplained: exponentials of larger ones are slow.
_FARTHEST = 100.0
#: Bound of the evidence of a single pixel, nats.
_LIMIT = 4.0


def find_moving_region(frames: np.ndarray) -> np.ndarray:
    """Return (h, w) bool: the pixels where frames (n, h, w, 3) uint8 of a static camera change,
    with holes filled. A person who moves a little at times is inside the region."""
    smooth = np.stack([cv2.GaussianBlur(frame, (0, 0), 1.0) for frame in frames])
    outliers = 1 if len(frames) > 3 else 0  # at either end
    high, low = (select_rank(smooth, k) for k in (len(frames) - 1 - outliers, outliers))
    change = (high - low).max(-1).astype(np.float32)
    changes = (change > max(_MOTION, 3 * float(np.median(change)))).view(np.uint8)
    return close_region(changes)


def close_region(changes: np.ndarray) -> np.ndarray:
    """Return (h, w) bool: the pixels that change, uint8, with holes filled and without specks."""
    moving = cv2.morphologyEx(changes, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    gap = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_GAP_PX, _GAP_PX))
    closed = cv2.morphologyEx(moving, cv2.MORPH_CLOSE, gap)
    outlines, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros(moving.shape, np.uint8)
    large = [outline for outline in outlines if cv2.contourArea(outline) > _SPECK_PX2]
    cv2.drawContours(filled, large, -1, 1, cv2.FILLED)
    return cv2.dilate(filled, np.ones((3, 3), np.uint8)) > 0


def find_same(mean: np.ndarray, std: np.ndarray, film: Moments) -> np.ndarray:
    """Return (h, w) bool: whether a film of the empty scene shows what the frames do; both moments
    (h, w, 3). It is likelier than any colour."""
    shown, height = film[0].reshape(1, -1, 3).transpose(2, 0, 1), len(mean)
    both = np.hypot(std, film[1]).reshape(-1, 3)
    density = _background_density(shown, mean.reshape(-1, 3), both) + _UNEXPLAINED
    ratio = np.clip(np.log(density), -_LIMIT, _LIMIT).reshape(height, -1)
    return np.asarray(cv2.blur(ratio, (3, 3)) > 0)


class PixelDensities:
    """Log ratios of the person's colours over the background's in one camera's frames.

    frames: (n, h, w, 3) uint8. region: (h, w) bool, beyond which nobody is. moments: the frames'.
    from_median: whether they are the background at first; else it is the `film` of the empty scene
    or, without one, extrapolated from the nearest pixels outside of the region on either side,
    above and below. same: (h, w) bool, where the film holds. known: (h, w) bool, where frames show
    the background.

    All densities are relative to the uniform one, which is the person's at first.
    """

    def __init__(
        self,
        frames: np.ndarray,
        region: np.ndarray,
        moments: Moments,
        film: Moments | None,
        from_median: bool,
    ) -> None:
        self._region, self._shape = region, frames.shape[:3]
        self._pixels, self._film = np.flatnonzero(region), film
        self._frames = frames.reshape(len(frames), -1, 3).take(self._pixels, axis=1)
        self._shown = np.moveaxis(self._frames, -1, 0).astype(np.float32, "C")
        self._bins = colour_bins(self._frames)
        picture = cv2.blur(moments[0], (3, 3))
        self._around = _find_surroundings(picture, region)
        self._unexplained = max(_UNEXPLAINED, _measure_unexplained(moments[0], picture, region))
        self._unseen = self._surrounding_density(self._shown)
        self._person = np.ones(N_BINS, np.float32)
        self._moments = moments[0].copy(), moments[1].copy()
        self.known = from_median | ~region
        self._update(np.zeros((1, len(self._pixels)), bool))

    @property
    def explained(self) -> float:
        """The share of the background that an extrapolation explains, 1 at most."""
        return (1 - self._unexplained) / (1 - _UNEXPLAINED)

    def learn(self, covered: np.ndarray) -> np.ndarray:
        """Learn the background from the frames in which a pixel is not `covered` (n, h, w). Return
        the histogram of those that are, see `count_colours`."""
        region, inside = self._region, self._inside(covered)
        mean, std, count = masked_moments(self._frames, inside)
        for values, new in zip((*self._moments, self.known), (mean, std, count > 0), strict=True):
            values[region] = new
        self._update(inside)
        return self.count_colours(covered)

    def _update(self, covered: np.ndarray) -> None:
        """Update the density of the background. Frames in which a pixel has the same colour show
        the same: what is `covered` (n, pixels) in most of them is no background."""
        region, (mean, std), known = self._region, self._moments, self.known
        self.same = np.zeros(region.shape, bool)
        if self._film is not None:
            self.same = find_same(mean, std, self._film) | ~known
            mean, std = (
                np.where(self.same[..., None], *both)
                for both in zip(self._film, (mean, std), strict=True)
            )
        estimated = _background_density(self._shown, mean[region], std[region])
        alike = estimated > np.maximum(self._unseen, 1)
        known[region] &= 2 * (alike & covered).sum(0) <= alike.sum(0)
        known |= self.same
        mixed = (1 - _UNEXPLAINED) * estimated + _UNEXPLAINED * self._unseen
        self._background = np.where(known[region], mixed, self._unseen)

    def learn_person(self, histograms: list[np.ndarray]) -> None:
        """Take the colours of the cameras' histograms (N_BINS,) for the person's. Each camera
        counts alike; neighbouring colours share their counts."""
        shares = [own / max(own.sum(), 1e-6) for own in histograms]
        size = round(N_BINS ** (1 / 3))
        cube = np.mean(shares, axis=0).reshape(3 * [size]).astype(np.float32)
        for axis in range(3):
            flat = np.moveaxis(cube, axis, 0).reshape(size, -1)
            flat = cv2.GaussianBlur(flat, (1, 0), sigmaX=0.1, sigmaY=0.7)
            cube = np.moveaxis(flat.reshape(3 * [size]), 0, axis)
        share = (1 - _UNEXPLAINED) * N_BINS / max(float(cube.sum()), 1e-6)
        self._person = (share * cube.ravel() + _UNEXPLAINED).astype(np.float32)

    def _inside(self, pictures: np.ndarray) -> np.ndarray:
        """Return the region's pixels (n, pixels) of pictures (n, h, w)."""
        return pictures.reshape(len(pictures), -1).take(self._pixels, axis=1)

    def count_colours(self, covered: np.ndarray) -> np.ndarray:
        """Return the histogram (N_BINS,) of the pixels that are `covered` (n, h, w)."""
        return np.bincount(self._bins[self._inside(covered)], minlength=N_BINS)

    def evidence(self) -> np.ndarray:
        """Return (n, h, w) float32: the log ratio, person over background, the mean over 3 x 3
        pixels."""
        ratios = np.log(self._person[self._bins] / self._background)
        pictures = np.full(self._shape, -_LIMIT, np.float32)
        pictures[:, self._region] = np.clip(ratios, -_LIMIT, _LIMIT)
        return np.stack([cv2.blur(picture, (3, 3)) for picture in pictures])

    def extrapolate(self) -> np.ndarray:
        """Return the extrapolated background's mean and standard deviation (h, w, 4) float32, NaN
        outside of the region and where it may look like the person."""
        colours, shares = (np.stack(of) for of in zip(*self._around, strict=True))
        mean = np.einsum("kp,kpc->pc", shares, colours)
        variance = np.einsum("kp,kpc->p", shares, (colours - mean) ** 2) / 3
        std = np.sqrt(variance + _EXTRAPOLATED_STD**2)
        ratio = np.log(
            self._person[colour_bins(mean)] / self._surrounding_density(mean.T[:, None])[0]
        )
        std[ratio > -_LIMIT / 2] = np.nan
        picture = np.full((*self._shape[1:], 4), np.nan, np.float32)
        picture[self._region] = np.concatenate([mean, std[:, None]], -1)
        return picture

    def _surrounding_density(self, shown: np.ndarray) -> np.ndarray:
        """Return the density (n, pixels) of the colours `shown` (3, n, pixels) if the background
        looks as it does around the region."""
        unexplained = self._unexplained
        return np.asarray(
            (1 - unexplained) * _mix_densities(shown, self._around) + unexplained, np.float32
        )


def _mix_densities(
    shown: np.ndarray, surroundings: list[tuple[np.ndarray, np.ndarray]]
) -> np.ndarray:
    """Return the density (n, pixels) of the colours `shown` (3, n, pixels) before backgrounds of
    the colours and shares of `_find_surroundings`."""
    std = np.float32(_EXTRAPOLATED_STD)
    densities = (
        share * _background_density(shown, colour, np.full_like(colour, std))
        for colour, share in surroundings
    )
    return np.asarray(sum(densities))


def _measure_unexplained(mean: np.ndarray, picture: np.ndarray, region: np.ndarray) -> float:
    """Return the share of the pixels just outside of a region (h, w) bool whose colours the uniform
    density explains better than one that is extrapolated from farther outside. mean: (h, w, 3) of
    the frames. picture: the same, smoothed."""
    kernel = np.ones((2 * _BORDER_PX + 1, 2 * _BORDER_PX + 1), np.uint8)
    dilated = cv2.dilate(region.view(np.uint8), kernel) > 0
    border = dilated & ~region
    if not border.any():
        return 0.0
    pixels = border[dilated]
    surroundings = _find_surroundings(picture, dilated)
    surroundings = [(colour[pixels], share[pixels]) for colour, share in surroundings]
    return float(np.mean(_mix_densities(mean[border].T[:, None], surroundings) < 1))


def _background_density(shown: np.ndarray, mean: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Return the density (n, pixels) of the colours `shown` (3, n, pixels) before a background
    of these moments (pixels, 3), brighter or darker."""
    light, weight = BackgroundConfig(), np.maximum(std, _LEAST_STD) ** -2
    lit = weight * mean
    factor, rest = np.zeros((2, *shown.shape[1:]), np.float32)  # in place: new arrays are slow
    for colour, own in zip(shown, lit.T.copy(), strict=True):
        factor += np.multiply(colour, own, out=rest)
    factor /= (lit * mean).sum(-1) + 1e-6
    np.clip(factor, light.shadow_low, light.shadow_high, out=factor)
    distance = np.zeros_like(factor)
    for colour, own, sure in zip(shown, mean.T.copy(), weight.T.copy(), strict=True):
        np.multiply(factor, own, out=rest)
        np.subtract(colour, rest, out=rest)
        rest *= rest
        rest *= sure
        distance += rest
    np.subtract(1, factor, out=rest)
    rest /= _SHADE
    rest *= rest
    distance += rest
    np.minimum(distance, _FARTHEST, out=distance)
    distance *= -0.5
    density = np.exp(distance, out=distance)
    density *= 256**3 * (2 * np.pi) ** -1.5 * np.sqrt(weight.prod(-1))
    return density


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
    nearest = []
    for y, x in ((row, left), (row, right), (above, column), (below, column)):
        y, x = y[region], x[region]
        inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
        distance = abs(y - row[region]) + abs(x - column[region])
        colour = picture[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)]
        nearest.append((colour, np.where(inside, 1 / (1 + distance), 1e-9)))
    total = sum(share for _, share in nearest)
    return [(colour, (share / total).astype(np.float32)) for colour, share in nearest]
