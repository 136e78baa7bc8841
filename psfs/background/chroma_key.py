"""A screen of one colour as background: chroma key."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from cl import Array, Device, InputError, Launch
from cl.workgroups import row_group
from psfs.background.gaussian import STD_FLOOR, Background
from psfs.cameras.camera import CameraRig
from psfs.common.colours import chromaticity, parse_colour
from psfs.config import SilhouetteConfig
from psfs.footage.media import Media

#: Area of all chromaticities (a triangle), over which the foreground is uniform.
AREA = float(np.sqrt(3) / 2)
#: Grey levels of noise in a channel: dark pixels have no sure chromaticity.
NOISE = 3.0
#: The screen's light, as a share of its usual one, is within this range, but for a standard
#: deviation: darker is black clothes, brighter a lamp.
DARK, BRIGHT, LIGHT_WIDTH = 0.3, 2.0, 0.05
#: Frames of every camera, and every so many pixels, that the screen's colour is looked for in.
SAMPLES, STRIDE = 12, 2
#: Chromaticity: a screen is this saturated at least; its colour varies less than `NEAR`.
SATURATED, NEAR = 0.12, 0.12
#: Share of a picture that a screen fills at least.
LEAST_SHARE = 0.1
_CELLS = 64  # of a histogram along each axis of the chromaticities


@dataclass(frozen=True, eq=False)
class ChromaKey(Background):
    """The colour of the screen that each camera sees; see `chromaticity`.

    key: (V, 2) the screen's chromaticity. spread: (V, 2) its standard deviation along the
    direction of `key` (saturation) and across it (hue). light: (V,) brightness, the sum of the
    channels. screen: (V, H, W) uint8, 0 where the camera does not see the screen, or has no
    pixel: nothing is told from there.
    """

    key: np.ndarray
    spread: np.ndarray
    light: np.ndarray
    screen: np.ndarray

    def packed(self, config: SilhouetteConfig) -> np.ndarray:
        """(V, 8) float32 as chroma_key.cl takes it."""
        saturation = np.linalg.norm(self.key, axis=1)
        spread = np.maximum(self.spread, config.key_spread)
        packed = np.zeros((len(self.key), 8))
        packed[:, :2] = self.key / saturation[:, None]
        packed[:, 2], packed[:, 3:5], packed[:, 5] = saturation, spread**2, self.light
        return packed.astype(np.float32)


def key_from_media(
    rig: CameraRig, media: Sequence[Media], empty: bool, colour: str | None = None
) -> ChromaKey:
    """The screen's colour in each camera's pictures, near the stated `colour` (#rrggbb) or, without
    one, the saturated colour that fills most of them.

    `empty`: the pictures show the screen and nobody; then what is not screen has no say in the
    silhouettes. Raises InputError for a camera that sees no screen.
    """
    stated = None if colour is None else _stated(colour)
    shape = (len(rig), rig.height, rig.width)
    screen = np.zeros(shape, np.uint8)
    means, keys, spreads, lights = [], [], [], []
    for view, item in enumerate(media):
        frames = np.stack(list(item.frames(item.spread(SAMPLES))))
        key, spread, mean = _screen_of(frames[:, ::STRIDE, ::STRIDE], stated, item, colour)
        rows, columns = frames.shape[1:3]
        screen[view, :rows, :columns] = _seen(frames, key) if empty else 1
        keys.append(key)
        spreads.append(spread)
        means.append(mean)
        lights.append(mean.sum() + 1)
    mean = np.broadcast_to(np.array(means, np.float32)[:, None, None], (*shape, 3))
    std = np.broadcast_to(np.float32(STD_FLOOR), (*shape, 3))
    return ChromaKey(mean, std, np.array(keys), np.array(spreads), np.array(lights), screen)


def _stated(colour: str) -> np.ndarray:
    """Return the chromaticity (2,) of `#rrggbb`. Raises InputError for what is nearly grey."""
    stated = chromaticity(parse_colour(colour))
    if np.linalg.norm(stated) < SATURATED:
        raise InputError(f"key = {colour!r} is nearly grey; expected the colour of a screen")
    return stated


def _screen_of(
    frames: np.ndarray, stated: np.ndarray | None, media: Media, colour: str | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Chromaticity (2,), its spread along and across (2,), and median colour (3,) of the screen."""
    pixels = frames.reshape(-1, 3)
    pixels = pixels[pixels.max(1) > 10 * NOISE]
    places = chromaticity(pixels)
    saturated = np.linalg.norm(places, axis=1) > SATURATED
    pixels, places = pixels[saturated], places[saturated]
    key = _most_common(places) if stated is None else stated
    near = np.zeros(0, bool)
    for _ in range(4):
        near = np.linalg.norm(places - key, axis=1) < NEAR
        if near.sum() < LEAST_SHARE * frames[..., 0].size:
            what = "colour fills" if colour is None else f"colour near {colour} fills"
            raise InputError(
                f"{media.where}: no saturated {what} {LEAST_SHARE:.0%} of the pictures; "
                "expected a screen of one colour"
            )
        key = np.median(places[near], axis=0)
    direction = key / np.linalg.norm(key)
    offsets = places[near] - key
    along = offsets @ direction
    across = offsets @ np.array([-direction[1], direction[0]])
    spread = 1.4826 * np.median(np.abs([along, across]), axis=1)
    return key, spread, np.median(pixels[near], axis=0)


def _most_common(places: np.ndarray) -> np.ndarray:
    """(2,) the mode of chromaticities (N, 2); the origin if there is none."""
    if not len(places):
        return np.zeros(2)
    edges = np.linspace(-0.85, 0.85, _CELLS + 1)
    counts, _, _ = np.histogram2d(places[:, 0], places[:, 1], [edges, edges])
    smooth = cv2.GaussianBlur(counts.astype(np.float32), (0, 0), 1.0)
    row, column = np.unravel_index(int(np.argmax(smooth)), smooth.shape)
    return np.asarray((edges[[row, column]] + edges[[row + 1, column + 1]]) / 2)


def _seen(frames: np.ndarray, key: np.ndarray) -> np.ndarray:
    """(h, w) uint8: 1 where the empty pictures show the screen, small gaps closed."""
    typical = np.median(frames, axis=0)
    shown = np.linalg.norm(chromaticity(typical) - key, axis=-1) < NEAR
    closed = cv2.morphologyEx(shown.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 9), np.uint8))
    return np.asarray(closed, np.uint8)


def key_launch(
    device: Device,
    rig: CameraRig,
    background: ChromaKey,
    config: SilhouetteConfig,
    pictures: Array,
    ratios: Array,
) -> Launch:
    """Pictures to log ratios of screen over foreground; the arrays are those of `Silhouette`."""
    keys = device.to_device(background.packed(config), "the screens' colours")
    screen = device.to_device(background.screen, "the screens")
    kernel = device.kernel(
        "reconstruction/chroma_key",
        "chroma_ratio",
        **{"WIDTH": rig.width, "HEIGHT": rig.height, "STEPS": float(config.ratio_steps)},
        **{"LOWEST": config.ratio_range[0], "HIGHEST": config.ratio_range[1]},
        **{"AREA": AREA, "NOISE": NOISE, "DARK": DARK, "BRIGHT": BRIGHT},
        LIGHT_WEIGHT=LIGHT_WIDTH**-2,
    )
    size = (rig.width, rig.height, len(rig))
    group = row_group(device, rig.width)
    arrays = {"images": pictures, "keys": keys, "screen": screen, "ratios": ratios}
    return device.launch(kernel, size, group, **arrays)
