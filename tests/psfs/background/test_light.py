"""The light of a picture is told from that of the background, whoever stands before it."""

import numpy as np
import pytest
from helpers import scenes
from helpers.parity import traced

from cl import Device
from psfs.background.config import LightConfig
from psfs.background.gaussian import Background
from psfs.background.light import relight_picture
from psfs.reconstructor import ReconstructionConfig, Reconstructor
from psfs.reference.light import estimate_light
from psfs.silhouettes.config import AppearanceConfig, SilhouetteConfig
from psfs.silhouettes.silhouette import Silhouette

CONFIG = SilhouetteConfig()
GAINS = np.array([0.8, 0.95, 1.25])


def changed(views: int, size: tuple[int, int], gains=GAINS, slope: float = 0.0):
    """A rig, a background, and a picture of the test body in other light."""
    rig = scenes.ring(views, size)
    frame, background = scenes.pictures_of(rig, seed=views)
    darker = Background(0.6 * background.mean, background.std)
    noise = np.random.default_rng(views).normal(0, 2, background.mean.shape)
    x = np.linspace(-1, 1, rig.width)[None, None, :, None]
    scene = darker.mean * gains * (1 + slope * x) + noise
    images = np.where(frame.masks[..., None] > 0, 128.0, scene)
    return rig, darker, np.clip(images, 0, 255).astype(np.uint8)


def estimated(rig, background, images, config: LightConfig = CONFIG.light) -> np.ndarray:
    return estimate_light(images, rig, background, config, CONFIG.background)


@pytest.mark.parity("reconstruction/light.estimate_light")
@pytest.mark.parametrize("slope", [0.0, 0.15])
@pytest.mark.parametrize(("views", "size"), [(1, (97, 75)), (3, (201, 153)), (2, (17, 40))])
def test_the_light_agrees_with_the_twin(
    device: Device, views: int, size: tuple[int, int], slope: float
) -> None:
    rig, background, images = changed(views, size, slope=slope)
    with traced("reconstruction/light.estimate_light") as launches:
        Silhouette(device, rig, background, CONFIG)(images)
    light = launches[0].after["light"]
    expected = estimated(rig, background, images)
    np.testing.assert_allclose(light[:, :3], expected[:, :3], atol=2e-3)
    np.testing.assert_allclose(light[:, 3:6], expected[:, 3:6], atol=0.2)
    np.testing.assert_allclose(light[:, 6:9], expected[:, 6:9], atol=2e-3)
    np.testing.assert_allclose(light[:, 9:11], expected[:, 9:11], rtol=0.02, atol=5e-3)


@pytest.mark.parametrize("gains", [GAINS, np.full(3, 0.6)])
def test_gains_are_found(gains: np.ndarray) -> None:
    """The test body hides a sixth of the pictures."""
    rig, background, images = changed(3, (201, 153), gains)
    light = estimated(rig, background, images)
    middle = light[:, :3] + light[:, 3:6] / 75  # beside a background of middle brightness
    np.testing.assert_allclose(middle, np.tile(gains, (3, 1)), atol=0.015)
    assert (light[:, 9] > 0.8).all()


def test_a_field_is_found() -> None:
    rig, background, images = changed(2, (201, 153), slope=0.2)
    light = estimated(rig, background, images)
    for own, camera in zip(light, rig, strict=True):
        growth = own[7] * (rig.width - 1) / (own[6] + own[7] * camera.size[0] / 2)
        assert growth == pytest.approx(0.4, abs=0.05)


def test_unexplained_light_widens_the_noise() -> None:
    rig, background, images = changed(2, (201, 153))
    bands = np.where(np.arange(rig.width) // 8 % 2, 1.25, 0.8)[None, None, :, None]
    striped = np.clip(images * bands, 0, 255).astype(np.uint8)
    assert (estimated(rig, background, striped)[:, 9] < 0.5).all()


def test_pictures_are_brought_to_the_backgrounds_light() -> None:
    rig, background, images = changed(2, (201, 153), slope=0.1)
    light = estimated(rig, background, images)
    free = scenes.masks_of(rig) == 0
    own = np.stack([relight_picture(*view) for view in zip(images, light, strict=True)]).astype(
        float
    )
    inside = free & (background.mean.max(-1) > 0)
    assert np.median(np.abs(own - background.mean)[inside]) < 3


def test_silhouettes_stay_when_the_light_steps(device: Device) -> None:
    rig, background, _ = changed(3, (201, 153))
    true = scenes.masks_of(rig) > 0
    for follow, least, most in ((True, 0.8, 1.0), (False, 0.0, 0.6)):
        silhouettes = SilhouetteConfig(
            light=LightConfig(follow=follow), appearance=AppearanceConfig(learn=follow)
        )
        config = ReconstructionConfig(silhouette=silhouettes)
        reconstruct = Reconstructor(device, rig, scenes.small_grid(), background, config)
        for index, gain in enumerate((1.0, 1.0, 0.7, 1.4)):
            images = changed(3, (201, 153), gain * np.ones(3))[2]
            reconstruct(scenes.frame(index, images))
        shown = reconstruct.evidence() > 0
        assert least <= (shown & true).sum() / (shown | true).sum() <= most
