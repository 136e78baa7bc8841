"""Silhouette likelihood maps on every OpenCL device against the NumPy twin, and their meaning."""

from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from helpers import scenes

from cl import Device, InputError
from psfs.background.config import BackgroundConfig, EvidenceConfig
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.reference.silhouette import (
    background_ratio,
    floor_light,
    mask_evidence,
    picture_masks,
    silhouette_evidence,
)
from psfs.silhouettes.config import (
    EvidenceSmoothingConfig,
    FloorConfig,
    PixelModel,
    RimConfig,
    SilhouetteConfig,
)
from psfs.silhouettes.silhouette import Silhouette

#: Without shadows, mixed pixels and smoothing: one program, which leaves out what each compiles.
WITHOUT = SilhouetteConfig(
    background=BackgroundConfig(shadow_low=1.0, shadow_high=1.0),
    rim=RimConfig(on=False),
    smoothing=EvidenceSmoothingConfig(reach=0),
)
CONFIGS = [
    SilhouetteConfig(),
    SilhouetteConfig(
        evidence=EvidenceConfig(occlusion_prior=0.2, foreground_prior=0.3, clamp=1e-3)
    ),
    WITHOUT.replace(background=WITHOUT.background.replace(sigma_floor=4.0)),
    WITHOUT.replace(floor=FloorConfig(on=False), evidence=EvidenceConfig(independent_pixels=1.0)),
]


@pytest.mark.parametrize("config", [*CONFIGS, None])
def test_pictures_agree_with_the_twin(device: Device, config: SilhouetteConfig | None) -> None:
    """None: of anything before a black background without noise."""
    rig = scenes.ring(3)
    frame, background = scenes.pictures_of(rig)
    images = frame.images
    if config is None:
        config, black = SilhouetteConfig(), np.zeros_like(background.mean)
        background = Background(black, black)
        images = np.random.default_rng(0).integers(0, 256, black.shape).astype(np.uint8)
    counts = Silhouette(device, rig, background, config)(images).get()
    expected = silhouette_evidence(images, rig, background, config)
    difference = np.abs(counts.astype(int) - expected)
    assert (difference > 1).mean() < 2e-3  # where rounding decides which pixel shows the floor
    assert (difference > 0).mean() < 0.03  # the table's resolution


def test_a_pixel_by_itself_is_song_s_likelihood(device: Device) -> None:
    rig = scenes.ring(2)
    frame, background = scenes.pictures_of(rig)
    config = CONFIGS[-1]
    counts = Silhouette(device, rig, background, config)(frame.images).get()
    sigma = np.maximum(background.std, config.background.sigma_floor)
    away = (frame.images - background.mean) / sigma
    density = (np.exp(-(away**2) / 2) / (np.sqrt(2 * np.pi) * sigma)).astype(float).prod(-1)
    slm = 256.0**-3 / (256.0**-3 + density)  # Song et al. eq. (1)-(2)
    bounds = [config.evidence.clamp, 1 - config.evidence.clamp]
    said = config.evidence.likelihood(counts)
    step = config.evidence.step * slm + 1 / config.evidence.ratio_steps * slm * (1 - slm)
    wrong = np.abs(said - np.clip(slm, *bounds)) > 2 * step + 1e-3
    assert not wrong[picture_masks(rig)].any()


@pytest.mark.parity("reconstruction/silhouette.mask_silhouette")
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


def test_more_pictures_than_places_of_32_bits_are_refused(device: Device) -> None:
    rig = CameraRig(tuple(replace(scenes.ring(1)[0], name=f"c{k}", size=(3840, 2160))
                          for k in range(87)))  # fmt: skip
    with pytest.raises(InputError, match=r"87 cameras .* 3840 x 2160 px; expected at most 86"):
        Silhouette(device, rig, None)


def test_evidence_is_songs(device: Device) -> None:
    config = EvidenceConfig(clamp=1e-3)
    slm = np.array([0.0, 0.01, 0.5, 0.8, 1.0])
    expected = np.log(np.clip(slm, 1e-3, 1 - 1e-3) / 0.5)
    np.testing.assert_allclose(config.log_odds(slm, config.clamp), expected)
    for occlusion in (0.1, 0.5, 0.9):
        other = config.replace(occlusion_prior=occlusion)
        assert (np.sign(other.log_odds(slm, 1e-3)) == np.sign(slm - 0.5)).all()


def ratio(colour: npt.ArrayLike, background: npt.ArrayLike, light: float | None = None) -> float:
    """Of one pixel; light: the share of its light that other cameras see on the floor there."""
    colour, background = (np.reshape(values, (1, 1, 3)) for values in (colour, background))
    floor = () if light is None else (np.array([[light]]),)
    std = np.full((1, 1, 3), 2.0 if light is None else 3.0)
    return float(background_ratio(colour, background, std, SilhouetteConfig(), *floor)[0, 0])


def test_shadows_are_background_and_clothes_are_not() -> None:
    carpet, grey = np.array([90.0, 160.0, 30.0]), np.full(3, 150.0)
    assert ratio(carpet, carpet) > 5
    assert ratio(0.8 * carpet, carpet) > 0  # its shadow
    assert ratio([128.0, 128.0, 40.0], carpet) < 0  # as bright, other colour
    assert ratio(0.3 * carpet, carpet) < 0  # too dark for a shadow
    assert ratio(0.97 * grey, grey) > 0
    assert ratio(0.8 * grey, grey) < 0  # grey clothes before a grey wall


def test_light_on_the_floor_tells_shade_from_arms_and_shoes() -> None:
    """The arm has the floor's colour; the shoe is no lighter shadow than two cameras see there."""
    wood, tiles = np.array([84.0, 119.0, 153.0]), np.array([160.0, 160.0, 165.0])
    assert ratio(0.88 * wood, wood, 1.0) < 0 < ratio(0.88 * wood, wood, 0.88)
    assert ratio(wood, wood, 1.0) - ratio(1.1 * wood, wood, 1.0) > 5  # nor brighter
    assert ratio(0.8 * tiles, tiles, 0.5) < 0 < ratio(0.5 * tiles, tiles, 0.5)


def shadowed_floor(views: int):
    """A grey floor, on it a disc of shadow and a dark post that looks like shadow."""
    rig = scenes.ring(views, size=(161, 121))
    shape = (views, rig.height, rig.width)
    plate = Background(np.full((*shape, 3), 120, np.float32), np.full((*shape, 3), 2, np.float32))
    images = np.full((*shape, 3), 120, np.uint8)
    post = np.zeros(shape, bool)
    for view, camera in enumerate(rig):
        columns, rows = np.meshgrid(np.arange(rig.width), np.arange(rig.height))
        x, y = floor_of(camera, np.column_stack([columns.ravel(), rows.ravel()])).T
        images[view].reshape(-1, 3)[np.hypot(x - 0.3, y) < 0.4] = 66
        height = np.linspace(0, 1, 200)
        column = np.column_stack([np.full((200, 2), -0.3), height])
        for u, v in np.rint(camera.project(column)[0]).astype(int):
            post[view, max(v - 4, 0) : v + 5, max(u - 4, 0) : u + 5] = True
        images[view][post[view]] = 66
    return rig, plate, images, post


def floor_of(camera, pixels: np.ndarray) -> np.ndarray:
    rays = camera.rays(pixels)
    distance = -camera.centre[2] / rays[:, 2]
    hits = camera.centre + distance[:, None] * rays
    return np.where((distance > 0)[:, None], hits[:, :2], 1e3)


def test_light_on_the_floor(device: Device) -> None:
    rig, plate, images, post = shadowed_floor(4)
    config = SilhouetteConfig()
    counts = Silhouette(device, rig, plate, config)(images).get()
    expected = silhouette_evidence(images, rig, plate, config)
    assert (np.abs(counts.astype(int) - expected) > 1).mean() < 2e-3
    light = floor_light(images, rig, plate, config)
    assert 0.54 < np.nanmin(light) < 0.56 and np.nanmax(light) == 1
    inside = picture_masks(rig)
    person = (counts > 0) & inside
    shadow = (images[..., 0] == 66) & ~post & inside
    assert (person & shadow).sum() < 0.15 * shadow.sum()
    core = np.stack([cv2.erode(view.astype(np.uint8), np.ones((5, 5))) > 0 for view in post])
    assert (person & core).sum() > 0.7 * (core & inside).sum()  # all but what the disc hides
    assert (person & ~post & ~shadow).sum() < 0.02 * post.sum()


@pytest.mark.parametrize(("least", "expected"), [(2, 0.5), (4, 0.75)])
def test_two_cameras_must_agree_on_a_shadow_where_there_are_enough(
    least: int, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of three others sees a shoe as dark as this pixel, two see the shadow behind it."""
    rig, plate, _, _ = shadowed_floor(4)
    dark = np.rint(plate.mean * np.array([0.8, 0.75, 0.5, 0.5])[:, None, None, None])
    monkeypatch.setattr("psfs.reference.silhouette.PIXEL", PixelModel(floor_enough=least))
    light = floor_light(dark.astype(np.uint8), rig, plate, SilhouetteConfig())[0]
    assert abs(np.nanmedian(light) - expected) < 0.02
