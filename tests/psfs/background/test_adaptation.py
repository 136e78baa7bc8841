"""The background takes on slow changes; who keeps still does not become part of it."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import scenes
from scipy import ndimage

from cl import Device, InputError
from psfs.background.adaptation import Adaptation, AdaptationArrays
from psfs.background.config import AdaptationConfig, LightConfig
from psfs.background.gaussian import Background
from psfs.background.light import steady_light
from psfs.cameras.cells import cells
from psfs.reconstructor import ReconstructionConfig, Reconstructor
from psfs.reference.adaptation import NumpyAdaptation
from psfs.reference.light import apply_light
from psfs.silhouettes.config import SilhouetteConfig
from psfs.silhouettes.silhouette import background_planes

CONFIG = SilhouetteConfig(adaptation=AdaptationConfig(rate=0.1))


@pytest.mark.parity("reconstruction/adaptation.adapt")
@pytest.mark.parametrize("views", [1, 3])
def test_the_drift_agrees_with_the_twin(device: Device, views: int) -> None:
    rig, random = scenes.ring(views), np.random.default_rng(views)
    shape = (views, rig.height, rig.width)
    plate = Background(
        random.uniform(0, 250, (*shape, 3)).astype(np.float32),
        random.uniform(0, 8, (*shape, 3)).astype(np.float32),
    )
    light = steady_light(views)
    light[:, :3], light[:, 3:6], light[:, 7], light[:, 9] = (0.9, 1.0, 1.1), 2.0, 1e-3, 0.8
    seen = apply_light(plate, light, CONFIG.background).mean + random.normal(0, 8, (*shape, 3))
    images = np.clip(seen, 0, 255).astype(np.uint8)
    evidence = np.where(random.random(shape) < 0.01, 20, -20).astype(np.int8)
    marks = random.random((views, *cells(rig))) < 0.01
    size = 2 * CONFIG.appearance.reach + 1
    near = ndimage.binary_dilation(marks, np.ones((1, size, size))).astype(np.uint8)
    before = background_planes(plate, CONFIG.background)
    planes = device.to_device(before)
    sizes = np.array([camera.size for camera in rig], np.int32)
    inputs = (device.to_device(array) for array in (images, evidence, near, sizes, light))
    arrays = AdaptationArrays(*inputs, planes)
    rates = CONFIG.adaptation, CONFIG.background
    ours = Adaptation(device, rig, *rates, arrays)
    twin = NumpyAdaptation(rig, plate, CONFIG)
    for _ in range(CONFIG.adaptation.period + 2):  # some rows of cells are looked at twice
        ours()
        twin(images, evidence, marks, light)
    after, expected = planes.get(), background_planes(twin.background, CONFIG.background)
    wrong = ~np.isclose(after, expected, rtol=2e-3, atol=2e-3).all(1)
    assert wrong.mean() < 1e-3  # pixels as far from the background as may be
    assert (after != before).any(1).mean() > 0.5


def shown(rig, background, images, device: Device, adapt: float, follow: bool) -> np.ndarray:
    """(V, H, W) bool silhouettes of the last of `images` (frames, V, H, W, 3)."""
    adaptation, light = AdaptationConfig(rate=adapt), LightConfig(follow=follow)
    config = ReconstructionConfig(silhouette=SilhouetteConfig(adaptation=adaptation, light=light))
    reconstruct = Reconstructor(device, rig, scenes.small_grid(), background, config)
    for index, image in enumerate(images):
        reconstruct(scenes.frame(index, image))
    return reconstruct.evidence() > 0


@pytest.fixture(scope="module")
def still() -> tuple:
    """The rig, the background and 100 noisy frames of the test body that keeps still."""
    rig, random = scenes.ring(5), np.random.default_rng(0)
    shape = (5, rig.height, rig.width, 3)
    grey = random.uniform(60, 140, shape[:3]).astype(np.float32)  # no chromaticity betrays shadows
    mean = np.repeat(grey[..., None], 3, axis=-1)
    background = Background(mean, np.full(shape, 3.0, np.float32))
    scene = np.where(scenes.masks_of(rig)[..., None] > 0, np.float32(220), mean)
    noise = random.normal(0, 3, (4, *shape)).astype(np.float32)
    frames = [np.clip(scene + noise[k % 4], 0, 255).astype(np.uint8) for k in range(100)]
    return rig, background, frames


def agreement(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def test_a_still_person_stays(still: tuple, device: Device) -> None:
    rig, background, frames = still
    true = scenes.masks_of(rig) > 0
    assert agreement(shown(rig, background, frames, device, 0.05, True), true) > 0.9


def test_light_may_fade(still: tuple, device: Device) -> None:
    """By a fifth in 100 frames."""
    rig, background, frames = still
    true = scenes.masks_of(rig) > 0
    fading = [(image * (1 - 0.002 * k)).astype(np.uint8) for k, image in enumerate(frames)]
    assert agreement(shown(rig, background, fading, device, 0.05, True), true) > 0.8
    assert agreement(shown(rig, background, fading, device, 0.0, False), true) < 0.5


def test_the_rate_is_checked() -> None:
    with pytest.raises(InputError, match="rate is 1"):
        AdaptationConfig(rate=1.0)
