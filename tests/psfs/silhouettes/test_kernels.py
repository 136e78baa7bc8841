"""Each kernel of the silhouettes on every OpenCL device, given what the others left, against the
twin of that step."""

import numpy as np
import pytest
from helpers import scenes
from helpers.parity import Traced, traced
from scipy import ndimage

from cl import Device
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import CELL, cells
from psfs.reference.appearance import NumpyForeground
from psfs.reference.light import apply_light
from psfs.reference.silhouette import (
    _log_ratios,
    _sum_evidence,
    _to_counts,
    expand_cells,
    find_near_foreground,
    floor_light,
    mixed_ratio,
    picture_masks,
    smooth_evidence,
)
from psfs.reference.surface import surface_voxels
from psfs.silhouettes.appearance import BINS, Foreground, ForegroundPrior
from psfs.silhouettes.config import EvidenceSmoothingConfig, SilhouetteConfig
from psfs.silhouettes.silhouette import Silhouette

CONFIG = SilhouetteConfig()
Shaded = tuple[CameraRig, Background, np.ndarray]


@pytest.fixture(scope="module", params=[(3, (50, 37)), (2, (161, 121))], ids=str)
def shaded(request: pytest.FixtureRequest) -> Shaded:
    """A noisy textured scene with the test body, whose mixed edges are soft, and a shadow."""
    views, size = request.param
    rig = scenes.ring(views, size)
    frame, background = scenes.pictures_of(rig, seed=views)
    images = frame.images.astype(float)
    images[:, rig.height // 2 :, : rig.width // 2] *= 0.7
    soft = ndimage.gaussian_filter(frame.masks / 255.0, (0, 1, 1))[..., None]
    images = (1 - soft) * images + soft * [30, 160, 60]
    images *= [0.8, 0.9, 1.05]  # another light
    return rig, background, np.clip(images, 0, 255).astype(np.uint8)


def launch_of(
    device: Device, kernel: str, rig: CameraRig, background: Background, images, config=CONFIG
) -> Traced:
    silhouette = Silhouette(device, rig, background, config)
    with traced(f"reconstruction/{kernel}") as launches:
        silhouette(images)
    (launch,) = launches
    return launch


def in_light_of(launch: Traced, background: Background) -> Background:
    """The background in the light that a launch was given."""
    return apply_light(background, launch.before["light"].astype(float), CONFIG.background)


@pytest.mark.parity("reconstruction/floor_light.floor_light")
def test_light_on_the_floor(device: Device, shaded: Shaded) -> None:
    rig, background, images = shaded
    launch = launch_of(device, "floor_light.floor_light", *shaded)
    bordered = launch.after["floor_light"]
    background = in_light_of(launch, background)
    inner = bordered[:, 1:-1, 1:-1]
    np.testing.assert_array_equal(bordered, np.pad(inner, ((0, 0), (1, 1), (1, 1)), "edge"))
    expected = floor_light(images, rig, background, CONFIG)
    y, x = np.indices((rig.height, rig.width)) / CELL - (CELL - 1) / (2 * CELL)
    for light, wanted in zip(inner, expected, strict=True):
        found = ndimage.map_coordinates((light >> 1) / 127, [y, x], order=1, mode="nearest")
        found = np.where(expand_cells(light & 1, found.shape), found, np.nan)
        # A cell whose factor rounding takes over a limit, and the pixels between it and the next.
        assert np.isclose(found, wanted, atol=1e-6, equal_nan=True).mean() > 0.99
    assert (expected < 1).any()


@pytest.mark.parity("reconstruction/silhouette.log_ratio")
def test_log_ratios(device: Device, shaded: Shaded) -> None:
    rig, background, images = shaded
    launch = launch_of(device, "silhouette.log_ratio", *shaded)
    lit, ratios = in_light_of(launch, background), launch.after["ratios"]
    expected = CONFIG.evidence.ratio_steps * np.stack(
        _log_ratios(images, rig, background, lit, CONFIG)
    )
    wrong = np.abs(ratios[:, 1:-1, 1:-1] - _to_counts(expected, CONFIG))[picture_masks(rig)]
    # Half a count may round either way; the light of a cell differs as above.
    assert (wrong > 1).mean() < 2e-3 and (wrong > 0).mean() < 0.02
    assert not ratios[:, [0, -1]].any() and not ratios[..., [0, -1]].any()


@pytest.mark.parity("reconstruction/silhouette.silhouette")
def test_sums_of_ratios(device: Device, shaded: Shaded) -> None:
    launch = launch_of(device, "silhouette.silhouette", *shaded)
    inside = picture_masks(shaded[0])
    ratios = np.where(inside, launch.before["ratios"][:, 1:-1, 1:-1], 0).astype(int)
    expected = _sum_evidence(ratios, inside, CONFIG)
    np.testing.assert_array_equal(launch.after["evidence"], expected)


@pytest.mark.parity("reconstruction/silhouette.rim")
def test_ratios_of_mixed_pixels(device: Device, shaded: Shaded) -> None:
    rig, background, images = shaded
    launch = launch_of(device, "silhouette.rim", *shaded)
    background = in_light_of(launch, background)
    seen = zip(images, background.mean, background.std, launch.before["evidence"], strict=True)
    nats = np.stack([mixed_ratio(*view, CONFIG) for view in seen])
    mixed = _to_counts(CONFIG.evidence.ratio_steps * nats, CONFIG)
    before, after = (which["ratios"][:, 1:-1, 1:-1] for which in (launch.before, launch.after))
    wrong = np.abs(after - np.maximum(before, mixed))[picture_masks(rig)]
    assert wrong.max() <= 1 and (wrong > 0).mean() < 5e-3  # half a count
    assert ((after != before) & picture_masks(rig)).any()


@pytest.mark.parity("reconstruction/silhouette.smoothed_evidence")
@pytest.mark.parametrize("smoothing", [EvidenceSmoothingConfig(), EvidenceSmoothingConfig(reach=1)])
def test_smoothed_evidence(
    device: Device, shaded: Shaded, smoothing: EvidenceSmoothingConfig
) -> None:
    (rig, _, images), config = shaded, CONFIG.replace(smoothing=smoothing)
    launch = launch_of(device, "silhouette.smoothed_evidence", *shaded, config)
    before, ratios = launch.before["evidence"], launch.before["ratios"][:, 1:-1, 1:-1]
    near = np.stack([find_near_foreground(view) for view in before]) & picture_masks(rig)
    smoothed = [smooth_evidence(*view, config) for view in zip(images, ratios, strict=True)]
    expected = np.where(near, np.stack(smoothed), before)
    wrong = np.abs(launch.after["evidence"].astype(int) - expected)
    # Half a count of the mean, or half a grey level of luma, may round either way.
    assert (wrong > 2).mean() < 2e-3 and (wrong > 0).mean() < 0.02
    np.testing.assert_array_equal(launch.after["evidence"][~near], before[~near])
    assert (before != expected).any()


@pytest.mark.parity(
    "reconstruction/appearance.mark",
    "reconstruction/appearance.observe",
    "reconstruction/appearance.fade",
    "reconstruction/appearance.colour_table",
)
@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("shown", ["body", "few voxels", "nobody", "foreground all over"])
def test_what_is_learnt(device: Device, views: int, shown: str) -> None:
    """Three frames from given evidence and voxels, so that nothing before decides."""
    rig, grid = scenes.ring(views, size=(201, 153)), scenes.small_grid()
    surface = surface_voxels(scenes.solid(grid.centres()).reshape(grid.shape)).astype(np.int32)
    surface = {"few voxels": surface[:3], "nobody": surface[:0]}.get(shown, surface)
    random, person = np.random.default_rng(views), scenes.masks_of(rig) > 0
    twin, shape = NumpyForeground(rig, CONFIG), (views, rig.height, rig.width)
    inputs = [device.zeros((*shape, 3), np.uint8), device.zeros(shape, np.int8)]
    cell_odds = device.zeros((views, *cells(rig)), np.int8)
    prior = ForegroundPrior(device.zeros(BINS**3, np.int8), cell_odds)
    foreground = Foreground(device, rig, CONFIG, *inputs, prior)
    voxels = scenes.voxels_at(device, grid, surface)
    for _ in range(3):
        images = np.where(person[..., None], [40, 90, 200], random.integers(0, 256, (*shape, 3)))
        images = images.astype(np.uint8)
        evidence = np.where(person | (shown == "foreground all over"), 9, -9).astype(np.int8)
        for array, values in zip(inputs, (images, evidence), strict=True):
            array.set(values)
        foreground.learn(voxels)
        twin.learn(images, evidence, grid, surface)
        size = 2 * CONFIG.appearance.reach + 1
        near = ndimage.binary_dilation(twin.marked, np.ones((1, size, size)))
        # The edge of a voxel's box in the middle between two cells.
        assert ((foreground.near.get() > 0) != near).mean() < 5e-3
        assert (prior.location.get() != twin.location).mean() < 0.02
        difference = np.abs(prior.colours.get().astype(int) - twin.colours)
        assert difference.max() <= 1 and (difference > 0).mean() < 5e-3
    assert twin.colours.any() or shown != "body"
