"""Estimation of every picture's light relative to the background's, on the device."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cl import Array, Device, Launch
from cl.workgroups import GROUP, pack_defines, size_defines
from psfs.background.config import BackgroundConfig
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig

#: Columns and rows of the grid of pixels from which a picture's light is estimated.
GRID = (64, 32)
#: Floats of a view's light: gains (3), offsets (3), the field at the first pixel and its growth per
#: pixel along x and y (3), 1 / spread^2, 3 log(spread), padding.
LIGHT_FLOATS = 12
#: Expected spread^2 if the noise is the background's, given the weights of the robust fit.
EXPECTED_SPREAD2 = 0.886
#: Scale of the residuals, in standard deviations, in the first step of the robust fit, wide enough
#: for a change of light by half, and in the last steps; it halves in each of the steps. Residuals
#: beyond a few of the narrowest belong to a person.
_WIDEST, _NARROWEST, _STEPS = 16.0, 3.0, 6
#: Share of the samples that count as independent measurements; the rest repeats its neighbours, so
#: that the priors keep their weight.
_INDEPENDENT = 0.02
#: Prior standard deviations: of a channel's gain around 1, of its offset in grey levels, and of the
#: share by which the light grows from the middle of a picture to its border, along each axis.
_GAIN_STD, _OFFSET_STD, _FIELD_STD = 0.3, 4.0, 0.1
#: Least and greatest gain of a channel.
GAINS = (0.3, 3.0)


def steady_light(views: int) -> np.ndarray:
    """Return the light (views, LIGHT_FLOATS) float32 of pictures that are lit like the
    background."""
    light = np.zeros((views, LIGHT_FLOATS), np.float32)
    light[:, [0, 1, 2, 6, 9]] = 1
    return light


def light_samples(rig: CameraRig) -> np.ndarray:
    """Return (V, samples, 2) column and row of the pixels from which the light is estimated."""
    u, v = ((np.arange(n) + 0.5) / n for n in GRID)
    spread = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
    return np.stack([(spread * camera.size).astype(int) for camera in rig])


def sampled_scene(
    rig: CameraRig, background: Background, config: BackgroundConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples' flat pixel indices (V, samples) int32 in a picture of the rig's width,
    and their scene (V, 8, samples) float32: mean (3), 1 / sigma^2 (3), column and row from -1 to
    1."""
    pixels = light_samples(rig)
    scene = np.empty((len(rig), 8, pixels.shape[1]), np.float32)
    for view, (x, y) in enumerate(np.moveaxis(pixels, -1, 1)):
        scene[view, :3] = background.mean[view, y, x].T
        scene[view, 3:6] = np.maximum(background.std[view, y, x].T, config.sigma_floor) ** -2
        scene[view, 6:] = (2 * (pixels[view] + 0.5) / rig.cameras[view].size - 1).T
    return (pixels[..., 1] * rig.width + pixels[..., 0]).astype(np.int32), scene


def fit_light(shown: np.ndarray, scene: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Estimate the light (F, LIGHT_FLOATS) of F pictures of `size` by iteratively reweighted least
    squares (Geman and McClure).

    shown: (F, n, 3) colours of the samples in the pictures. scene: (8, n), see `sampled_scene`.

    A sample weighs 1 / (1 + d^2 / (3 scale^2))^2 by its squared distance d^2 in standard deviations
    of the background, with a scale that shrinks. Each step fits gains and offsets given the
    previous field, and the field given the previous gains and offsets.
    """
    mean, weight, place = scene[:3, None], scene[3:6, None], scene[6:].T
    shown = np.ascontiguousarray(np.moveaxis(shown, -1, 0))  # NumPy is slow along an axis of three
    gain, offset = np.ones((3, shown.shape[1], 1)), np.zeros((3, shown.shape[1], 1))
    slope, spread = np.zeros((shown.shape[1], 2)), np.ones(shown.shape[1])
    for step in range(_STEPS):
        scale = max(_NARROWEST, _WIDEST / 2**step)
        lit = mean * np.stack([1 + place @ of for of in slope])
        rest = shown - (gain * lit + offset)
        distance = (weight * rest**2).sum(0)
        trust = (1 + distance / (3 * scale**2)) ** -2
        spread = (trust * distance).sum(-1) / (3 * EXPECTED_SPREAD2 * trust.sum(-1) + 1e-6)
        weights = _INDEPENDENT * trust * weight
        bright = gain * mean
        pull = weights * bright
        square, product = (pull * bright).sum(0), (pull * rest).sum(0)
        pull = weights * lit
        aa = (pull * lit).sum(-1, keepdims=True) + _GAIN_STD**-2
        bb = weights.sum(-1, keepdims=True) + _OFFSET_STD**-2
        ab, b = (of.sum(-1, keepdims=True) for of in (pull, weights * shown))
        a = (pull * shown).sum(-1, keepdims=True) + _GAIN_STD**-2
        determinant = aa * bb - ab * ab
        gain = np.clip((a * bb - b * ab) / determinant, *GAINS)
        offset = (aa * b - ab * a) / determinant
        if step:  # in step 0 the gains are still far off
            slope = slope + np.stack(
                [_slope_change(*of, place) for of in zip(square, product, slope, strict=True)]
            )
    spread, first = np.maximum(spread, 1.0), 1 + slope @ (1 / np.array(size) - 1)
    rest = np.stack([first, *(2 * slope / size).T, 1 / spread, 1.5 * np.log(spread), 0 * spread], 1)
    return np.concatenate([gain[..., 0].T, offset[..., 0].T, rest], 1)


def _slope_change(
    square: np.ndarray, product: np.ndarray, slope: np.ndarray, place: np.ndarray
) -> np.ndarray:
    """Return the change (2,) of the field's slope."""
    matrix = np.einsum("n,ni,nj->ij", square, place, place) + np.eye(2) * _FIELD_STD**-2
    return np.linalg.solve(matrix, product @ place - slope * _FIELD_STD**-2)


def light_field(light: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Return the share (...) float32 of a light that falls on these pixels."""
    field: np.ndarray = light[6] + light[7] * column + light[8] * row
    return field.astype(np.float32)


def scale_light(light: np.ndarray, factor: float) -> np.ndarray:
    """Return the lights (..., LIGHT_FLOATS) of pictures that are scaled by `factor`."""
    scaled, beside = light.copy(), 0.5 / factor - 0.5  # between the middles of the first pixels
    scaled[..., 6] += beside * (light[..., 7] + light[..., 8])
    scaled[..., 7:9] /= factor
    return scaled


def remove_light(picture: np.ndarray, light: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the channels (h, w) of a picture (h, w, 3) in grey levels, float32, in the background's
    light."""
    field = light_field(light, *np.ogrid[: picture.shape[0], : picture.shape[1]])
    for channel, (gain, offset) in enumerate(light[:6].astype(np.float32).reshape(2, 3).T):
        lit = np.subtract(picture[..., channel], offset, dtype=np.float32)
        lit /= gain * field
        yield lit  # NumPy is slow along an axis of three


def relight_picture(image: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 relit by the background's light, in whole grey levels from 0
    to 255."""
    relit = np.empty(image.shape, np.uint8)
    for channel, lit in enumerate(remove_light(image, light)):
        lit += np.float32(0.5)
        relit[..., channel] = np.clip(lit, 0, 255, out=lit)
    return relit


def light_launch(
    device: Device,
    rig: CameraRig,
    samples: tuple[np.ndarray, np.ndarray],
    pictures: Array,
    light: Array,
) -> Launch:
    """Return the launch that estimates `light` (V, LIGHT_FLOATS) from the `samples`, see
    `sampled_scene`, of `pictures` (V, H, W, 3).

    The light relative to the background's is a gain and an offset per channel, and a gain that
    varies linearly over the picture.

    The fit is robust: the person's pixels are outliers, which do not matter as long as they fill
    less than half of a picture. Each frame is fitted by itself, so a sudden change of light is
    corrected in the same frame. Twin: reference/light.py.
    """
    places, scene = samples
    packs = pack_defines(device, GROUP)
    kernel = device.kernel(
        "reconstruction/light",
        "estimate_light",
        **size_defines(device, rig.picture),
        SAMPLES=places.shape[1],
        **packs,
        STEPS=_STEPS,
        **{"WIDEST": _WIDEST, "NARROWEST": _NARROWEST},
        **{"INDEPENDENT": _INDEPENDENT, "GAIN_PRIOR": _GAIN_STD**-2},
        **{"OFFSET_PRIOR": _OFFSET_STD**-2},
        **{"FIELD_PRIOR": _FIELD_STD**-2, "EXPECTED": EXPECTED_SPREAD2},
        **{"LEAST_GAIN": GAINS[0], "MOST_GAIN": GAINS[1], "LIGHT_FLOATS": LIGHT_FLOATS},
    )
    sizes = device.to_device(np.array([camera.size for camera in rig], np.int32), "picture sizes")
    return device.launch(
        kernel,
        (packs["GROUP"] * len(rig),),
        (packs["GROUP"],),
        picture=rig.picture,
        images=pictures,
        sizes=sizes,
        places=device.to_device(places, "the light's samples"),
        scene=device.to_device(scene, "the light's samples"),
        light=light,
    )
