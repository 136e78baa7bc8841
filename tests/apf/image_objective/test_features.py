"""Image features on every OpenCL device against their NumPy twin, and what they find."""

import cv2
import numpy as np
import pytest
from helpers import scenes

from apf.image_objective.config import FeatureConfig, ProximityConfig
from apf.image_objective.features import Features, distance_launch
from apf.reference.image_objective.features import NumpyFeatures, region, sobel_edges
from cl import Device, NumpyDevice
from psfs.background.gaussian import Background
from psfs.reference.reprojection import proximity

#: Pictures as narrow as the tests' would shrink all lengths to a pixel.
WIDE = {"dilation": 20, "margin": 40}
FAR = ProximityConfig(farthest=90)


def pictures(rig, masks: np.ndarray, seed: int = 0) -> np.ndarray:
    """A striped, noisy person before a smooth, noisy wall."""
    random = np.random.default_rng(seed)
    stripes = 60 + 120 * (np.arange(rig.width) // 9 % 2)
    images = np.where(masks[..., None] > 0, stripes[:, None], np.array([180, 140, 90]))
    return np.clip(images + random.normal(0, 4, (*masks.shape, 3)), 0, 255).astype(np.uint8)


def plate(rig) -> Background:
    shape = (len(rig), rig.height, rig.width, 3)
    mean = np.broadcast_to(np.array([180, 140, 90], np.float32), shape)
    return Background(np.ascontiguousarray(mean), np.full(shape, 5, np.float32))


def both(device: Device, rig, background, frame, config):
    features = Features(device, rig, background, config)
    twin = NumpyFeatures(NumpyDevice(), rig, background, config)
    return features(frame).get(), features.roi.get(), twin(frame), twin.roi


@pytest.mark.parity("image/features.region")
@pytest.mark.parametrize(
    ("edges", "proximity"),
    [
        pytest.param("sobel", "impulse", marks=pytest.mark.parity(
            "image/features.gradient_rows", "image/features.gradient_edges")),
        pytest.param("canny", "proportional", marks=pytest.mark.parity(
            "image/features.masked_edges")),
        pytest.param("outline", "exponential", marks=pytest.mark.parity(
            "image/features.outline_edges")),
    ],
)  # fmt: skip
def test_masks_and_twin_agree_exactly(device: Device, edges, proximity) -> None:
    rig = scenes.ring(3)
    masks = scenes.masks_of(rig)
    frame = scenes.frame(images=pictures(rig, masks), masks=masks)
    config = FeatureConfig(edges=edges, proximity=FAR.replace(function=proximity), **WIDE)
    maps, roi, expected, expected_roi = both(device, rig, None, frame, config)
    assert (expected[..., 1] == 255).any() and (expected[..., 0] == 0).any()
    np.testing.assert_array_equal(roi, expected_roi)
    np.testing.assert_array_equal(maps, expected)


def test_background_and_twin_agree(device: Device) -> None:
    rig = scenes.ring(3)
    masks = scenes.masks_of(rig)
    frame, config = scenes.frame(images=pictures(rig, masks)), FeatureConfig(proximity=FAR, **WIDE)
    config = config.replace(edges="sobel")
    maps, roi, expected, expected_roi = both(device, rig, plate(rig), frame, config)
    assert np.abs(roi - expected_roi).max() <= 8  # a cell may have one pixel more
    assert (maps[..., 0] != expected[..., 0]).mean() < 1e-3
    assert (maps[..., 1] != expected[..., 1]).mean() < 2e-2  # a moved edge moves what is near it
    true, found = masks > 0, maps[..., 0] > 0
    assert (true & found).sum() > 0.85 * (true | found).sum()


def test_the_next_frame_leaves_nothing_of_the_last(device: Device) -> None:
    rig = scenes.ring(2)
    masks = scenes.masks_of(rig)
    features = Features(device, rig, None, FeatureConfig(edges="outline"))
    features(scenes.frame(masks=masks))
    assert features.maps.get().any()
    empty = features(scenes.frame(masks=np.zeros_like(masks)))
    assert not empty.get().any() and not features.roi.get().any()


def test_region_has_a_margin_and_no_specks() -> None:
    silhouette = np.zeros((100, 120), bool)
    silhouette[33:61, 42:70] = True
    silhouette[5:8, 100:103] = True  # nine pixels are a speck
    assert region(silhouette, 10).tolist() == [30, 22, 82, 74]  # in cells of 8 px
    assert region(silhouette, 50).tolist() == [0, 0, 120, 100]
    silhouette[33:61, 42:70] = False
    assert region(silhouette, 10).tolist() == [0, 0, 0, 0]
    for k, side in enumerate((20, 16, 20, 16, 16)):  # of as many pixels the first blobs count
        silhouette[16 * k + 8 : 16 * k + 16, 24 * k : 24 * k + side] = True
    assert region(silhouette, 0, 4).tolist() == [0, 8, 88, 64]
    assert region(silhouette, 0).tolist() == [0, 8, 112, 80]


@pytest.mark.parity("image/features.blob_region")
@pytest.mark.parametrize("blobs", [1, 4])
def test_regions_of_the_largest_blobs_agree(device: Device, blobs: int) -> None:
    rig = scenes.ring(3)
    random = np.random.default_rng(blobs)
    shape = (3, -(-rig.height // 5), -(-rig.width // 5))
    coarse = random.random(shape) < [[[0.2]], [[0.35]], [[0.0]]]  # crooked blobs, and none
    masks = np.kron(coarse, np.ones((1, 5, 5)))[:, : rig.height, : rig.width]
    masks = np.where(masks > 0, np.uint8(255), np.uint8(0))
    config = FeatureConfig(edges="outline", margin=0, blobs=blobs)
    maps, roi, expected, expected_roi = both(device, rig, None, scenes.frame(masks=masks), config)
    np.testing.assert_array_equal(roi, expected_roi)
    np.testing.assert_array_equal(maps, expected)
    sizes = [roi[view, 2:] - roi[view, :2] for view in range(3)]
    assert (sizes[0] < (rig.width, rig.height)).any() and not roi[2].any()


def test_sobel_as_opencv_has_it() -> None:
    random = np.random.default_rng(0)
    image = cv2.GaussianBlur(random.integers(0, 256, (60, 80, 3), np.uint8), (0, 0), 3)
    image = np.clip(image * 3.0 - 250, 0, 255).astype(np.uint8)
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    grey = cv2.GaussianBlur(grey, (3, 3), 0, borderType=cv2.BORDER_REPLICATE)
    magnitude = np.hypot(cv2.Sobel(grey, cv2.CV_64F, 1, 0), cv2.Sobel(grey, cv2.CV_64F, 0, 1))
    expected = (magnitude >= 60)[2:-2, 2:-2]
    assert 0.05 < expected.mean() < 0.95
    found = sobel_edges(image, FeatureConfig(threshold=60))[2:-2, 2:-2]
    assert (found != expected).mean() < 0.02  # OpenCV rounds the blurred picture


@pytest.mark.parity("image/distance.edge_proximity")
@pytest.mark.parametrize(
    ("reach", "metric", "densities"),
    [
        (0, "euclidean", [0.2]),
        (7, "euclidean", [0.0, 0.001, 0.2]),
        (200, "chessboard", [0.001, 0.2]),
    ],
)
def test_exact_distances(device: Device, reach: int, metric: str, densities: list[float]) -> None:
    """Against the twin: a table that tells all squared distances from each other."""
    shape = (2, 61, 193)  # a diagonal of more than 200 px
    roi = np.array([[0, 0, 193, 61], [11, 7, 109, 40]], np.int32)
    table = (np.arange(reach**2 + 2) * 37 % 251).astype(np.uint8)
    for density in densities:
        random = np.random.default_rng(int(1000 * density))
        edges = np.where(random.random(shape) < density, np.uint8(255), np.uint8(0))
        maps = device.zeros((*shape, 2), np.uint8)
        evidence = device.zeros(shape, np.int8)
        arrays = (evidence, device.to_device(edges), device.to_device(roi), table, maps)
        distance_launch(device, *arrays, metric=metric)()
        for view, (x0, y0, x1, y1) in enumerate(roi):
            expected = np.zeros(shape[1:], np.uint8)
            expected[y0:y1, x0:x1] = proximity(edges[view, y0:y1, x0:x1] > 0, table, metric)
            np.testing.assert_array_equal(maps.get()[view, ..., 1], expected)


def test_proximity_tables() -> None:
    """Rymut 2016, figure 4.12: his proportional and exponential functions."""
    rig = scenes.ring(1, size=(640, 480))
    d = np.array([0, 10, 55, 99, 100])

    def values(**settings: object) -> np.ndarray:
        config = ProximityConfig(nearest=10, farthest=100, **settings)  # type: ignore[arg-type]
        return config.table(rig)[d**2] / 255

    np.testing.assert_allclose(
        values(function="proportional", span=0.25), [1, 1, 0.875, 0.7525, 0], atol=0.003
    )
    expected = [1, 1, 0.5 + 0.5 * np.exp(-2.5), 0.5 + 0.5 * np.exp(-5 * 89 / 90), 0]
    np.testing.assert_allclose(values(function="exponential", span=0.5), expected, atol=0.003)
    assert ProximityConfig(function="impulse").table(rig).tolist() == [255, 0]
