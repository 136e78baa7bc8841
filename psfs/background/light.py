"""The light of every picture beside that of the background, on the device."""

from __future__ import annotations

import numpy as np

from cl import Array, Device, Launch
from cl.workgroups import pack_defines
from psfs.background.config import BackgroundConfig, LightConfig
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig

#: Columns and rows of the pixels of a picture that its light is estimated from.
GRID = (64, 32)
#: Numbers that a view's light has: gains (3), offsets (3), the field at the first pixel and its
#: growth per pixel along x and y (3), 1 / spread^2, 3 log(spread), nothing.
LIGHT_FLOATS = 12
#: `light_spread` of noise as the background states it, by the weights of the robust fit.
EXPECTED_SPREAD2 = 0.886
#: Least and greatest gain of a channel.
GAINS = (0.3, 3.0)
_GROUP = 256  # work-items per view on a GPU


def steady_light(views: int) -> np.ndarray:
    """Return (views, LIGHT_FLOATS) float32 of pictures in the background's own light."""
    light = np.zeros((views, LIGHT_FLOATS), np.float32)
    light[:, [0, 1, 2, 6, 9]] = 1
    return light


def light_samples(rig: CameraRig) -> np.ndarray:
    """Return (V, samples, 2) column and row of the pixels that the light is estimated from."""
    u, v = ((np.arange(n) + 0.5) / n for n in GRID)
    spread = np.stack(np.meshgrid(u, v), -1).reshape(-1, 2)
    return np.stack([(spread * camera.size).astype(int) for camera in rig])


def sampled_scene(
    rig: CameraRig, background: Background, config: BackgroundConfig
) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples' places (V, samples) int32 in a picture of the rig's width, and their
    scene (V, 8, samples) float32: mean (3), 1 / sigma^2 (3), column and row from -1 to 1."""
    pixels = light_samples(rig)
    scene = np.empty((len(rig), 8, pixels.shape[1]), np.float32)
    for view, (x, y) in enumerate(np.moveaxis(pixels, -1, 1)):
        scene[view, :3] = background.mean[view, y, x].T
        scene[view, 3:6] = np.maximum(background.std[view, y, x].T, config.sigma_floor) ** -2
        scene[view, 6:] = (2 * (pixels[view] + 0.5) / rig.cameras[view].size - 1).T
    return (pixels[..., 1] * rig.width + pixels[..., 0]).astype(np.int32), scene


def light_launch(
    device: Device,
    rig: CameraRig,
    background: Background,
    config: LightConfig,
    density: BackgroundConfig,
    pictures: Array,
    light: Array,
) -> Launch:
    """Return the launch that estimates `light` (V, LIGHT_FLOATS) from `pictures` (V, H, W, 3): by
    which gain and offset of each channel, and by which gain that grows linearly over the picture,
    they are brighter than the background.

    The fit is robust: pixels that the person hides are outliers, and whoever fills less than half
    of a picture has no say. Nothing is remembered from frame to frame, so a step of the light is
    followed within the frame. Twin: reference/light.py.
    """
    places, scene = sampled_scene(rig, background, density)
    packs = pack_defines(device, _GROUP)
    kernel = device.kernel(
        "reconstruction/light",
        "estimate_light",
        **{"WIDTH": rig.width, "HEIGHT": rig.height, "SAMPLES": places.shape[1]},
        **packs,
        STEPS=config.steps,
        **{"WIDEST": float(config.widest), "NARROWEST": float(config.narrowest)},
        **{"INDEPENDENT": float(config.independent), "GAIN_PRIOR": float(config.gain_width**-2)},
        **{"OFFSET_PRIOR": float(config.offset_width**-2)},
        **{"FIELD_PRIOR": float(config.field_width**-2), "EXPECTED": EXPECTED_SPREAD2},
        **{"LEAST_GAIN": GAINS[0], "MOST_GAIN": GAINS[1], "LIGHT_FLOATS": LIGHT_FLOATS},
    )
    sizes = device.to_device(np.array([camera.size for camera in rig], np.int32), "picture sizes")
    return device.launch(
        kernel,
        (packs["GROUP"] * len(rig),),
        (packs["GROUP"],),
        images=pictures,
        sizes=sizes,
        places=device.to_device(places, "the light's samples"),
        scene=device.to_device(scene, "the light's samples"),
        light=light,
    )
