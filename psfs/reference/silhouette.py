"""Silhouette likelihood maps, Song et al. eq. (1)-(2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from psfs.background.chroma_key import AREA, BRIGHT, DARK, LEAST_SPREAD, LIGHT_STD, NOISE, ChromaKey
from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import CELL, floor_points
from psfs.common.colours import chromaticity
from psfs.reference.light import apply_light, estimate_light
from psfs.silhouettes.appearance import BINS
from psfs.silhouettes.config import PIXEL, SPAN, SilhouetteConfig

if TYPE_CHECKING:
    from psfs.background.gaussian import Background
    from psfs.reference.appearance import NumpyForeground


def chroma_ratio(image: np.ndarray, background: ChromaKey, view: int) -> np.ndarray:
    """Return (H, W) log of the screen's density over the foreground's, of chromaticities.

    The screen's chromaticity has a normal distribution, which is wider for dark pixels, since noise
    affects these more. More saturated pixels count as screen, too, since shaded folds are more
    saturated; less saturated ones are the person, since clothes tinted by the screen's light keep
    most of their colour. Brightness beyond the screen's range lowers its density. The foreground is
    uniform. See `ChromaKey`.
    """
    key, spread = background.key[view], np.maximum(background.spread[view], LEAST_SPREAD)
    saturation = np.linalg.norm(key)
    direction = key / saturation
    shown = chromaticity(image)
    along = np.minimum(shown @ direction - saturation, 0)
    across = shown @ np.array([-direction[1], direction[0]])
    total = image.astype(np.float64).sum(-1) + 1
    variance = spread**2 + (NOISE / total[..., None]) ** 2
    light = total / background.light[view]
    off = np.maximum(DARK - light, 0) + np.maximum(light - BRIGHT, 0)
    least = along**2 / variance[..., 0] + across**2 / variance[..., 1] + (off / LIGHT_STD) ** 2
    peak = np.log(AREA / (2 * np.pi)) - 0.5 * np.log(variance).sum(-1)
    return peak - 0.5 * least


def silhouette_evidence(
    images: np.ndarray,
    rig: CameraRig,
    background: Background,
    config: SilhouetteConfig,
    foreground: NumpyForeground | None = None,
    light: np.ndarray | None = None,
) -> np.ndarray:
    """Return evidence counts (V, H, W) int8 of pictures (V, H, W, 3) uint8; 0 outside the pictures.

    The log ratios of background over foreground, clipped and rounded to counts, are summed over 3x3
    pixels, with 0 outside the pictures; if `smoothing.reach` is 0, they are not summed.
    `foreground` None: the foreground is uniform. light: (V, LIGHT_FLOATS) of the pictures, by
    default estimated relative to the background.
    """
    lit = background
    if not isinstance(background, ChromaKey):
        if light is None:
            light = estimate_light(images, rig, background, config.light, config.background)
        lit = apply_light(background, light, config.background)
    ratios = []
    for view, nats in enumerate(_log_ratios(images, rig, background, lit, config)):
        ratios.append(
            config.evidence.ratio_steps * nats - _appearance_counts(foreground, view, images[view])
        )
    inside = picture_masks(rig)
    seen = background.screen > 0 if isinstance(background, ChromaKey) else inside
    counts = np.where(seen, _to_counts(np.stack(ratios), config), 0)
    evidence = _sum_evidence(counts, inside, config)
    if isinstance(background, ChromaKey):
        return evidence
    for view, (image, mean, std) in enumerate(zip(images, lit.mean, lit.std, strict=True)):
        if config.rim.on:
            mixed = mixed_ratio(image, mean, std, evidence[view], config)
            mixed = config.evidence.ratio_steps * mixed - _appearance_counts(
                foreground, view, image
            )
            counts[view] = np.maximum(counts[view], _to_counts(mixed, config))
        smoothed = smooth_evidence(image, counts[view], config)
        near = find_near_foreground(evidence[view])
        evidence[view] = np.where(near & inside[view], smoothed, evidence[view])
    return evidence


def _appearance_counts(
    foreground: NumpyForeground | None, view: int, image: np.ndarray
) -> np.ndarray:
    """Return (H, W) counts of foreground by the person's colours and location."""
    if foreground is None:
        return np.zeros(image.shape[:2], int)
    blue, green, red = np.moveaxis(image.astype(int) * BINS // 256, -1, 0)
    colours = foreground.colours[(blue * BINS + green) * BINS + red].astype(int)
    return colours + expand_cells(foreground.location[view], image.shape)


def _to_counts(ratios: np.ndarray, config: SilhouetteConfig) -> np.ndarray:
    lowest, highest = config.evidence.ratio_range
    return np.floor(np.clip(ratios, lowest, highest) + 0.5).astype(int)


def _sum_evidence(counts: np.ndarray, inside: np.ndarray, config: SilhouetteConfig) -> np.ndarray:
    sums = box_sums(counts) if config.smoothing.sum_reach else 9 * counts
    table = config.evidence.ratio_counts()[sums - 9 * config.evidence.ratio_range[0]]
    return np.where(inside, table, 0).astype(np.int8)


def find_near_foreground(evidence: np.ndarray) -> np.ndarray:
    """Return (H, W) bool: pixels whose span of CELL x SPAN pixels, or one of its eight neighbours,
    contains positive evidence. The outermost two pixels are false and do not count."""
    height, width = evidence.shape
    rows, columns = -(-height // CELL), -(-width // SPAN)
    shown = np.zeros((rows * CELL, columns * SPAN), bool)
    shown[2 : height - 2, 2 : width - 2] = evidence[2:-2, 2:-2] > 0
    spans = shown.reshape(rows, CELL, columns, SPAN).any((1, 3))
    near = scipy.ndimage.binary_dilation(spans, np.ones((3, 3)))
    inside = np.zeros(evidence.shape, bool)
    inside[2:-2, 2:-2] = True
    return near.repeat(CELL, 0).repeat(SPAN, 1)[:height, :width] & inside


def smooth_evidence(image: np.ndarray, counts: np.ndarray, config: SilhouetteConfig) -> np.ndarray:
    """Return (H, W) evidence counts of a picture (H, W, 3), from the weighted mean of its log
    ratios `counts` (H, W) over the pixels within smoothing.reach.

    The weight is 1 / (1 + (d / smoothing.contrast)^2)^2 for a difference d of luma from the middle
    pixel's. Beyond the border ratios and luma are 0.
    """
    reach, (height, width) = config.smoothing.reach, counts.shape
    luma = np.floor(_luma_chroma(image.astype(np.float64))[0][..., 0] + 0.5)
    lumas, ratios = np.pad(luma, reach), np.pad(counts, reach)
    total, weights = np.zeros(counts.shape), np.zeros(counts.shape)
    for y, x in np.ndindex(2 * reach + 1, 2 * reach + 1):
        part = slice(y, y + height), slice(x, x + width)
        # Not to the power of -2, which NumPy takes ten times as long for.
        weight = 1 / (1 + ((lumas[part] - luma) / PIXEL.contrast) ** 2) ** 2
        total += weight * ratios[part]
        weights += weight
    place = 9 * total / weights - 9 * config.evidence.ratio_range[0]
    return config.evidence.ratio_counts()[np.floor(place + 0.5).astype(int)]


def mixed_ratio(
    image: np.ndarray,
    mean: np.ndarray,
    std: np.ndarray,
    evidence: np.ndarray,
    config: SilhouetteConfig,
) -> np.ndarray:
    """Return (H, W) log ratio of the pixels of the rim under the mixture of background and person
    that fits best; -inf elsewhere.

    The luma y of I - mu is a share a <= `rim_share` of that of I_p - mu_p, and its chroma (b - y,
    r - y) any share up to 1, but for noise: that of the green channel, times `rim_chroma_noise` for
    the chroma. A pixel of the rim has positive evidence, and so has p, two pixels away in one of
    eight directions (the best one counts); two pixels in the opposite direction it is negative.
    """
    weight = _weight(std, config)
    luma, chroma = _luma_chroma(image - mean.astype(np.float64))
    least = np.full(evidence.shape, np.inf)
    y, x = 2 + np.array(np.nonzero(evidence[2:-2, 2:-2] > 0))
    for dy, dx in ((dy, dx) for dy in (-2, 0, 2) for dx in (-2, 0, 2)):
        on_rim = (evidence[y + dy, x + dx] > 0) & (evidence[y - dy, x - dx] < 0)
        here, ahead = (y[on_rim], x[on_rim]), (y[on_rim] + dy, x[on_rim] + dx)
        left = _rest(luma[here], luma[ahead], PIXEL.rim_share)
        left += _rest(chroma[here], chroma[ahead], 1) / PIXEL.rim_chroma_noise**2
        least[here] = np.minimum(least[here], weight[here][:, 1] * left)
    peak = np.log(256 * np.sqrt(weight / (2 * np.pi))).sum(-1)
    return peak - PIXEL.rim_cost - 0.5 * least


def _luma_chroma(colours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return luma (..., 1) and chroma (..., 2) of colours (..., 3) BGR or differences of them."""
    luma = colours @ np.array([[0.114], [0.587], [0.299]])
    return luma, colours[..., ::2] - luma


def _rest(shown: np.ndarray, person: np.ndarray, most: float) -> np.ndarray:
    """Return (n,) the squared distance of `shown` (n, c) to the nearest share of `person` (n, c)
    from 0 to `most`."""
    share = (shown * person).sum(-1) / ((person**2).sum(-1) + 1e-3)
    rest: np.ndarray = shown - np.clip(share, 0, most)[:, None] * person
    return (rest**2).sum(-1)


def _log_ratios(
    images: np.ndarray,
    rig: CameraRig,
    background: Background,
    lit: Background,
    config: SilhouetteConfig,
) -> list[np.ndarray]:
    """Return, for every view, (H, W) log of the background's density over the uniform foreground's;
    `lit` is the background relit by the pictures' light."""
    if isinstance(background, ChromaKey):
        return [chroma_ratio(image, background, v) for v, image in enumerate(images)]
    floor = floor_light(images, rig, lit, config)
    widths = config.background.shadow_width(background.mean.astype(np.float64))
    views = zip(images, lit.mean, lit.std, floor, widths, strict=True)
    return [background_ratio(image, mean, std, config, *more) for image, mean, std, *more in views]


def box_sums(counts: np.ndarray) -> np.ndarray:
    """Return the sums over 3x3 pixels of each view (V, H, W), zero padded."""
    padded = np.pad(counts, ((0, 0), (1, 1), (1, 1)))
    rows = padded[:, :-2] + padded[:, 1:-1] + padded[:, 2:]
    return rows[..., :-2] + rows[..., 1:-1] + rows[..., 2:]


def mask_evidence(masks: np.ndarray, rig: CameraRig, config: SilhouetteConfig) -> np.ndarray:
    """Return evidence counts (V, H, W) int8 of ready masks (V, H, W) uint8, 255 = person."""
    counts = config.evidence.mask_counts(np.arange(256))[masks]
    return np.where(picture_masks(rig), counts, 0).astype(np.int8)


def floor_light(
    images: np.ndarray, rig: CameraRig, background: Background, config: SilhouetteConfig
) -> np.ndarray:
    """Return (V, H, W) light on the floor at each pixel, relative to the empty scene's; NaN where
    there is no floor. Twin of floor_light.cl.

    The light is computed in the middle of every cell of CELL x CELL pixels and interpolated
    linearly. Of the light factors that the other cameras see at that point of the floor, it is the
    second nearest to the cell's own factor, or the nearest if fewer than floor_enough cameras have
    a factor; at most 1. A camera has no factor there if its pixel cannot be floor, shaded or not.
    The light is 1 if no other camera has a factor, or if the cell's own pixel shows the floor fully
    lit. It is rounded to steps of 1 / 127.
    """
    factors, left = [], []
    for image, mean, std in zip(images, background.mean, background.std, strict=True):
        alpha, distance = light_factor(image, mean, _weight(std, config))
        factors.append(alpha)
        left.append(distance)
    points = floor_points(rig, config.floor.seen_height)
    light = np.empty(images.shape[:3])
    for view, shown in enumerate(points):
        on_floor = np.isfinite(shown[..., 0])
        lit = (factors[view] > PIXEL.floor_lit) & (left[view] < PIXEL.floor_nearest)
        where = np.column_stack([shown[on_floor], np.full(on_floor.sum(), config.floor.height)])
        own = _sample_cells(factors[view])[on_floor]
        others = np.full((len(rig), len(where)), np.inf)
        for other, camera in enumerate(rig):
            if other == view:
                continue
            seen, row, column, _ = camera.look_up(where)
            alpha, distance = factors[other][row, column], left[other][row, column]
            is_floor = (distance < PIXEL.floor_nearest) & (alpha < config.background.shadow_high)
            others[other, seen] = np.where(is_floor, alpha, np.inf)
        agreed = _agreed_factor(others, own, PIXEL.floor_enough)
        cells = np.ones(on_floor.shape)
        agreed[_sample_cells(lit)[on_floor]] = 1
        cells[on_floor] = np.floor(127 * agreed + 0.5) / 127
        between = _interpolate_cells(cells, light.shape[1:])
        light[view] = np.where(expand_cells(on_floor, light.shape[1:]), between, np.nan)
    return light


def _agreed_factor(others: np.ndarray, own: np.ndarray, enough: int) -> np.ndarray:
    """Return (n,) of the light factors `others` (V, n), inf for none, the one second nearest to
    `own` (n,), at most 1; the nearest if there are fewer than `enough`; 1 if there is none."""
    nearest = np.take_along_axis(others, np.argsort(np.abs(others - own), 0, kind="stable"), 0)
    several = np.isfinite(others).sum(0) >= enough
    return np.clip(np.where(several, nearest[:2][-1], nearest[0]), 0, 1)


def expand_cells(cells: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return the values (rows, columns) of the cells for each of their pixels (H, W)."""
    return cells.repeat(CELL, 0).repeat(CELL, 1)[: shape[0], : shape[1]]


def _sample_cells(pixels: np.ndarray) -> np.ndarray:
    """Return the values (H, W) of pixels for each cell: that of the pixel in its middle."""
    rows, columns = (-(-n // CELL) for n in pixels.shape)
    y = np.minimum(CELL * np.arange(rows) + CELL // 2, pixels.shape[0] - 1)
    x = np.minimum(CELL * np.arange(columns) + CELL // 2, pixels.shape[1] - 1)
    return pixels[np.ix_(y, x)]


def _interpolate_cells(cells: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return the values (H, W) interpolated linearly between the middles of the cells."""
    y, x = np.indices(shape[:2]) / CELL - (CELL - 1) / (2 * CELL)
    return scipy.ndimage.map_coordinates(cells, [y, x], order=1, mode="nearest")


def _weight(std: np.ndarray, config: SilhouetteConfig) -> np.ndarray:
    return np.maximum(std, config.background.sigma_floor).astype(np.float64) ** -2


def _weighted_product(weight: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the sum of weight x y over the channels, the last axis."""
    return np.einsum("...c,...c,...c->...", weight, x, y)


def _fit_factor(weight: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the factor of y that fits x best (weighted least squares)."""
    return _weighted_product(weight, x, y) / (_weighted_product(weight, y, y) + 1e-6)


def _remaining_distance(
    weight: np.ndarray, x: np.ndarray, factor: np.ndarray, y: np.ndarray
) -> np.ndarray:
    """Return the weighted squared distance that is left with a factor."""
    rest = x - factor[..., None] * y
    return _weighted_product(weight, rest, rest)


def light_factor(
    image: np.ndarray, mean: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return alpha (H, W) for which alpha mu is nearest to the picture, and the squared distance
    that is left.

    image, mean, weight: (H, W, 3), the weight being 1 / sigma^2.
    """
    image, mean = image.astype(np.float64), mean.astype(np.float64)
    alpha = _fit_factor(weight, image, mean)
    return alpha, _remaining_distance(weight, image, alpha, mean)


def background_ratio(
    image: np.ndarray,
    mean: np.ndarray,
    std: np.ndarray,
    config: SilhouetteConfig,
    light: np.ndarray | None = None,
    shadow_width: np.ndarray | None = None,
) -> np.ndarray:
    """Return (H, W) log of the background's density over the uniform foreground's, (1/256)^3.

    The background is N(I; alpha mu, sigma) with the better of two alphas: 1, and the best fitting
    light factor within a range. Usually that is the shadow range, with a penalty of ((1 - alpha) /
    shadow_width)^2 / 2; shadow_width is by default that of `mean`. On the floor, where `light` (H,
    W) is not NaN, alpha may be lower, with penalties of ((1 - alpha) / floor_depth)^2 / 2
    and of ((light - alpha) / width)^2 / 2. There the width is `floor_lit_std` where the floor is
    lit; where it is shaded, it is `floor_std` plus the noise.
    """
    image, mean = image.astype(np.float64), mean.astype(np.float64)
    weight = _weight(std, config)
    factor = _fit_factor(weight, image, mean)

    def distance(alpha: np.ndarray) -> np.ndarray:
        return _remaining_distance(weight, image, alpha, mean)

    alpha = np.clip(factor, config.background.shadow_low, config.background.shadow_high)
    if shadow_width is None:
        shadow_width = config.background.shadow_width(mean)
    dimmed = distance(alpha) + ((1 - alpha) / shadow_width) ** 2
    if light is not None:
        alpha = np.clip(factor, PIXEL.floor_low, config.background.shadow_high)
        lit = light > PIXEL.floor_fully_lit
        width = np.where(lit, PIXEL.floor_lit_std, PIXEL.floor_std)
        noise = np.where(lit, 0, 1 / (_weighted_product(weight, mean, mean) + 1e-6))
        price = (light - alpha) ** 2 / (width**2 + noise)
        on_floor = distance(alpha) + price + ((1 - alpha) / PIXEL.floor_depth) ** 2
        dimmed = np.where(np.isnan(light), dimmed, on_floor)
    least = np.minimum(distance(np.ones(factor.shape)), dimmed)
    peak = np.log(256 * np.sqrt(weight / (2 * np.pi))).sum(-1)
    return peak - 0.5 * least


def picture_masks(rig: CameraRig) -> np.ndarray:
    """Return (V, height, width) bool: pixels that exist in a view; views may be smaller than the
    rig."""
    inside = np.zeros((len(rig), rig.height, rig.width), bool)
    for view, camera in enumerate(rig):
        inside[view, : camera.size[1], : camera.size[0]] = True
    return inside
