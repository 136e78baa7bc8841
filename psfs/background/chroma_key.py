"""A screen of one colour as background: chroma key."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from cl import Array, Device, InputError, Launch
from cl.workgroups import row_group
from psfs.background.config import EvidenceConfig
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.common.colours import chromaticity, parse_colour
from psfs.footage.media import Media

#: Area of all chromaticities (a triangle), over which the foreground is uniform.
AREA = float(np.sqrt(3) / 2)
_CELLS = 64  # of the chromaticities' histogram, along each axis
#: Frames of every camera from which the screen's colour is estimated, and the stride, px, of the
#: pixels in them.
_SAMPLES, _STRIDE = 12, 2
#: Brightest channel, grey levels, below which a pixel's chromaticity is noise.
_BRIGHTEST = 30.0
#: Least saturation of a screen, see `psfs.common.colours.chromaticity`, and the distance of
#: chromaticities within which a pixel is of its colour.
_SATURATION, _NEAR = 0.12, 0.12
#: Least share of the pictures that a screen fills, and the edge, px, of gaps that are closed in it.
_LEAST_SHARE, _CLOSING = 0.1, 9
#: Standard deviation of the screen's colour where that is stated, not measured, grey levels.
_STATED_STD = 2.0
#: Least standard deviation of the screen's chromaticity, and a channel's noise, grey levels: dark
#: pixels have no sure chromaticity.
LEAST_SPREAD, NOISE = 0.03, 3.0
#: Least and greatest light of the screen, as shares of its usual one (darker is black clothes,
#: brighter a lamp), and the standard deviation of the light beyond that range.
DARK, BRIGHT, LIGHT_STD = 0.3, 2.0, 0.05


@dataclass(frozen=True, eq=False)
class ChromaKey(Background):
    """The colour of the screen that each camera sees; see `chromaticity`.

    key: (V, 2) the screen's chromaticity. spread: (V, 2) its standard deviation along the direction
    of `key` (saturation) and across it (hue). light: (V,) brightness, the sum of the channels.
    screen: (V, H, W) uint8, 0 where the camera does not see the screen or has no pixel: there is no
    evidence there.
    """

    key: np.ndarray
    spread: np.ndarray
    light: np.ndarray
    screen: np.ndarray

    def packed(self) -> np.ndarray:
        """Return the parameters (V, 8) float32 in the layout of chroma_key.cl."""
        saturation = np.linalg.norm(self.key, axis=1)
        spread = np.maximum(self.spread, LEAST_SPREAD)
        packed = np.zeros((len(self.key), 8))
        packed[:, :2] = self.key / saturation[:, None]
        packed[:, 2], packed[:, 3:5], packed[:, 5] = saturation, spread**2, self.light
        return packed.astype(np.float32)


def key_from_media(
    rig: CameraRig,
    media: Sequence[Media],
    empty: bool,
    colour: str | None = None,
) -> ChromaKey:
    """Find the screen's colour in each camera's pictures: near the stated `colour` (#rrggbb) or,
    without one, the saturated colour that fills most of them.

    `empty`: the pictures show the screen without a person; then pixels beside the screen give no
    evidence. Raises InputError for a camera that sees no screen.
    """
    stated = None if colour is None else _parse_key(colour)
    shape = (len(rig), rig.height, rig.width)
    screen = np.zeros(shape, np.uint8)
    means, keys, spreads, lights = [], [], [], []
    for view, item in enumerate(media):
        frames = np.stack(list(item.frames(item.spread(_SAMPLES))))
        seen = frames[:, ::_STRIDE, ::_STRIDE]
        key, spread, mean = _estimate_screen(seen, stated, item, colour)
        rows, columns = frames.shape[1:3]
        screen[view, :rows, :columns] = _find_screen(frames, key) if empty else 1
        keys.append(key)
        spreads.append(spread)
        means.append(mean)
        lights.append(mean.sum() + 1)
    mean = np.broadcast_to(np.array(means, np.float32)[:, None, None], (*shape, 3))
    std = np.broadcast_to(np.float32(_STATED_STD), (*shape, 3))
    return ChromaKey(mean, std, np.array(keys), np.array(spreads), np.array(lights), screen)


def _parse_key(colour: str) -> np.ndarray:
    """Return the chromaticity (2,) of `#rrggbb`. Raises InputError for what is nearly grey."""
    stated = chromaticity(parse_colour(colour))
    if np.linalg.norm(stated) < _SATURATION:
        raise InputError(f"key = {colour!r} is nearly grey; expected the colour of a screen")
    return stated


def _estimate_screen(
    frames: np.ndarray,
    stated: np.ndarray | None,
    media: Media,
    colour: str | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the screen's chromaticity (2,), its spread along and across (2,), and its median
    colour (3,). Raises InputError if too little of the pictures is of one saturated colour."""
    pixels = frames.reshape(-1, 3)
    pixels = pixels[pixels.max(1) > _BRIGHTEST]
    shown = chromaticity(pixels)
    saturated = np.linalg.norm(shown, axis=1) > _SATURATION
    pixels, shown = pixels[saturated], shown[saturated]
    key = _find_mode(shown) if stated is None else stated
    near = np.zeros(0, bool)
    for _ in range(4):
        near = np.linalg.norm(shown - key, axis=1) < _NEAR
        if near.sum() < _LEAST_SHARE * frames[..., 0].size:
            what = "colour fills" if colour is None else f"colour near {colour} fills"
            raise InputError(
                f"{media.where}: no saturated {what} {_LEAST_SHARE:.0%} of the pictures; "
                "expected a screen of one colour"
            )
        key = np.median(shown[near], axis=0)
    direction = key / np.linalg.norm(key)
    offsets = shown[near] - key
    along = offsets @ direction
    across = offsets @ np.array([-direction[1], direction[0]])
    spread = 1.4826 * np.median(np.abs([along, across]), axis=1)
    return key, spread, np.median(pixels[near], axis=0)


def _find_mode(shown: np.ndarray) -> np.ndarray:
    """Return the mode (2,) of chromaticities (N, 2); the origin if N is 0."""
    if not len(shown):
        return np.zeros(2)
    edges = np.linspace(-0.85, 0.85, _CELLS + 1)
    counts, _, _ = np.histogram2d(shown[:, 0], shown[:, 1], [edges, edges])
    smooth = cv2.GaussianBlur(counts.astype(np.float32), (0, 0), 1.0)
    row, column = np.unravel_index(int(np.argmax(smooth)), smooth.shape)
    return (edges[[row, column]] + edges[[row + 1, column + 1]]) / 2


def _find_screen(frames: np.ndarray, key: np.ndarray) -> np.ndarray:
    """Return (h, w) uint8: 1 where the empty pictures show the screen, small gaps closed."""
    typical = np.median(frames, axis=0)
    shown = np.linalg.norm(chromaticity(typical) - key, axis=-1) < _NEAR
    gap = np.ones((_CLOSING, _CLOSING), np.uint8)
    closed = cv2.morphologyEx(shown.astype(np.uint8), cv2.MORPH_CLOSE, gap)
    return np.asarray(closed, np.uint8)


def key_launch(
    device: Device,
    background: ChromaKey,
    evidence: EvidenceConfig,
    pictures: Array,
    ratios: Array,
) -> Launch:
    """Return the launch from pictures to log ratios of screen over foreground; the arrays are those
    of `Silhouette`."""
    views, height, width = background.screen.shape
    keys = device.to_device(background.packed(), "the screens' colours")
    screen = device.to_device(background.screen, "the screens")
    kernel = device.kernel(
        "reconstruction/chroma_key",
        "chroma_ratio",
        STEPS=float(evidence.ratio_steps),
        **{"LOWEST": evidence.ratio_range[0], "HIGHEST": evidence.ratio_range[1]},
        **{
            "AREA": AREA,
            "NOISE": NOISE,
            "DARK": DARK,
            "BRIGHT": BRIGHT,
        },
        LIGHT_WEIGHT=LIGHT_STD**-2,
    )
    arrays = {"images": pictures, "keys": keys, "screen": screen, "ratios": ratios}
    size, group = (width, height), row_group(device)
    return device.launch(kernel, (*size, views), group, picture=size, **arrays)
