"""Silhouette likelihood maps on every OpenCL device against the NumPy twin, and their meaning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scenes

from cl import Device, UserError
from psfs.config import SilhouetteConfig
from psfs.reference.silhouette import background_ratio, mask_evidence, silhouette_evidence
from psfs.silhouette import Silhouette

CONFIGS = [
    SilhouetteConfig(),
    SilhouetteConfig(occlusion_prior=0.2, foreground_prior=0.3, clamp=1e-3),
    SilhouetteConfig(shadow_low=1.0, shadow_high=1.0, sigma_floor=4.0),
]


@pytest.mark.parametrize("config", CONFIGS)
@pytest.mark.parametrize("views", [1, 3])
def test_pictures_agree_with_the_twin(device: Device, views: int, config: SilhouetteConfig) -> None:
    rig = scenes.ring(views)
    frame, background = scenes.pictures_of(rig)
    counts = Silhouette(device, rig, background, config)(frame.images).get()
    expected = silhouette_evidence(frame.images, rig, background, config)
    difference = np.abs(counts.astype(int) - expected)
    assert difference.max() <= 1  # the table's resolution
    assert (difference > 0).mean() < 0.03


def test_black_and_noiseless_backgrounds(device: Device) -> None:
    rig = scenes.ring(2)
    shape = (2, rig.height, rig.width, 3)
    background = scenes.Plate(np.zeros(shape, np.float32), np.zeros(shape, np.float32))
    images = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    config = SilhouetteConfig()
    counts = Silhouette(device, rig, background, config)(images).get()
    expected = silhouette_evidence(images, rig, background, config)
    assert np.abs(counts.astype(int) - expected).max() <= 1


def test_masks_agree_with_the_twin(device: Device) -> None:
    rig = scenes.ring(3)
    masks = np.random.default_rng(0).integers(0, 256, (3, rig.height, rig.width)).astype(np.uint8)
    config = SilhouetteConfig()
    counts = Silhouette(device, rig, None, config)(masks).get()
    np.testing.assert_array_equal(counts, mask_evidence(masks, rig, config))
    for view, camera in enumerate(rig):
        outside = np.ones((rig.height, rig.width), bool)
        outside[: camera.size[1], : camera.size[0]] = False
        assert not counts[view, outside].any()


def test_evidence_is_songs(device: Device) -> None:
    config = replace(SilhouetteConfig(), clamp=1e-3)
    slm = np.array([0.0, 0.01, 0.5, 0.8, 1.0])
    expected = np.log(np.clip(slm, 1e-3, 1 - 1e-3) / 0.5)
    np.testing.assert_allclose(config.evidence(slm, config.clamp), expected)
    for occlusion in (0.1, 0.5, 0.9):
        other = replace(config, occlusion_prior=occlusion)
        assert (np.sign(other.evidence(slm, 1e-3)) == np.sign(slm - 0.5)).all()


def ratio(colour: list[float], background: list[float], config: SilhouetteConfig) -> float:
    std = np.full((1, 1, 3), 2.0)
    return float(
        background_ratio(np.array([[colour]]), np.array([[background]]), std, config)[0, 0]
    )


def test_shadows_are_background_and_clothes_are_not() -> None:
    config, carpet = SilhouetteConfig(), [90.0, 160.0, 30.0]
    assert ratio(carpet, carpet, config) > 5
    assert ratio([c * 0.8 for c in carpet], carpet, config) > 0  # its shadow
    assert ratio([128.0, 128.0, 40.0], carpet, config) < 0  # as bright, other colour
    assert ratio([c * 0.3 for c in carpet], carpet, config) < 0  # too dark for a shadow
    grey = [150.0, 150.0, 150.0]
    assert ratio([c * 0.97 for c in grey], grey, config) > 0
    assert ratio([c * 0.8 for c in grey], grey, config) < 0  # grey clothes before a grey wall


@pytest.mark.parametrize(
    "wrong",
    [{"clamp": 0.6}, {"foreground_prior": 1.0}, {"shadow_low": 0.0}, {"sigma_floor": -1.0}],
)
def test_wrong_parameters_are_named(wrong: dict[str, float]) -> None:
    with pytest.raises(UserError, match=next(iter(wrong)).split("_")[0]):
        SilhouetteConfig(**wrong)
