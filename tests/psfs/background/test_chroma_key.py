"""A screen of one colour as background: found, and kept apart from the person."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import footage, scenes
from helpers.commands import fail
from helpers.parity import traced

from cl import Device
from psfs.background.chroma_key import ChromaKey, key_from_media
from psfs.cameras.camera import CameraRig
from psfs.common.colours import chromaticity
from psfs.footage.media import open_media
from psfs.reconstructor import Reconstructor
from psfs.reference.silhouette import _to_counts, chroma_ratio
from psfs.sequence import Sequence
from psfs.silhouettes.config import SilhouetteConfig
from psfs.silhouettes.silhouette import Silhouette

GREEN = np.array([64.0, 177.0, 0.0])  # BGR


def key_of(rig: CameraRig, colour: np.ndarray = GREEN) -> ChromaKey:
    views = len(rig)
    shape = (views, rig.height, rig.width)
    screen = np.zeros(shape, np.uint8)
    for view, camera in enumerate(rig):
        screen[view, : camera.size[1], 10 : camera.size[0]] = 1  # a strip beside the screen
    return ChromaKey(
        np.broadcast_to(colour.astype(np.float32), (*shape, 3)),
        np.full((*shape, 3), 2.0, np.float32),
        np.tile(chromaticity(colour), (views, 1)),
        np.full((views, 2), 0.01),
        np.full(views, colour.sum()),
        screen,
    )


def near_the_screens_colour(rig: CameraRig) -> np.ndarray:
    """Pictures (V, H, W, 3): mostly the screen in all lights, anything else, and black."""
    random, shape = np.random.default_rng(len(rig)), (len(rig), rig.height, rig.width, 3)
    near = GREEN * random.uniform(0.2, 1.3, shape[:3])[..., None] + random.normal(0, 15, shape)
    anything = random.uniform(0, 256, shape)
    images = np.where(random.random(shape[:3])[..., None] < 0.7, near, anything)
    images[:, :20] = 0
    return np.clip(images, 0, 255).astype(np.uint8)


@pytest.mark.parity("reconstruction/chroma_key.chroma_ratio")
@pytest.mark.parametrize(("views", "size"), [(1, (97, 75)), (3, (50, 37)), (2, (17, 40))])
def test_ratios_agree_with_the_twin(device: Device, views: int, size: tuple[int, int]) -> None:
    rig = scenes.ring(views, size)
    background, config = key_of(rig), SilhouetteConfig()
    images = near_the_screens_colour(rig)
    with traced("reconstruction/chroma_key.chroma_ratio") as launches:
        Silhouette(device, rig, background, config)(images)
    found = launches[0].after["ratios"][:, 1:-1, 1:-1]
    for view, image in enumerate(images):
        nats = chroma_ratio(image, background, view)
        expected = _to_counts(config.evidence.ratio_steps * nats, config)
        wrong = np.abs(found[view] - np.where(background.screen[view] > 0, expected, 0))
        assert wrong.max() <= 1 and (wrong > 0).mean() < 5e-3  # half a count


def test_shadow_is_screen_and_spill_is_person() -> None:
    background = key_of(scenes.ring(1))

    def ratio(*colour: float) -> float:
        return float(chroma_ratio(np.array([[colour]]), background, 0)[0, 0])

    b, g, r = GREEN
    assert ratio(b, g, r) > 4 and ratio(0.4 * b, 0.4 * g, 0.4 * r) > 2  # lit, shaded
    assert ratio(b - 20, g, r) > 0  # more saturated
    assert ratio(100, 160, 110) < 0 and ratio(150, 190, 200) < 0  # tinted grey, tinted skin
    assert ratio(12, 12, 12) < 0 and ratio(250, 250, 250) < 0  # black, white
    assert ratio(177, 64, 0) < 0  # a blue shirt


def pictures(folder: Path, colour: np.ndarray, light: float = 1.0) -> Path:
    """Five cameras before a screen, lit unevenly; the test body moves a little and is grey."""
    rig = scenes.ring(5, size=(160, 120))
    random, masks, views = np.random.default_rng(0), scenes.masks_of(rig), []
    lit = light * np.linspace(0.7, 1.2, rig.width)[None, :, None] * colour
    for mask in masks:
        shown = lit + random.normal(0, 2, (3, *mask.shape, 3))
        shown[:, mask > 0] = [140, 150, 140]
        views.append(np.clip(shown, 0, 255).astype(np.uint8))
    return footage.write_take(folder, rig, views, "images")


@pytest.mark.parametrize("key", [None, "#00b140"])
def test_the_screen_is_found(tmp_path: Path, device: Device, key: str | None) -> None:
    sequence = Sequence.open(pictures(tmp_path / "a", GREEN, 0.8), background="chroma", key=key)
    background = sequence.background
    assert isinstance(background, ChromaKey) and sequence.empty_scene
    np.testing.assert_allclose(background.key, np.tile(chromaticity(GREEN), (5, 1)), atol=0.02)
    grid = scenes.small_grid()
    reconstruct = Reconstructor(device, sequence.rig, grid, background)
    reconstruct(sequence.read(0))
    shown, true = reconstruct.evidence() > 0, scenes.masks_of(sequence.rig) > 0
    assert (shown & true).sum() > 0.9 * (shown | true).sum()


def test_no_screen_is_an_error(tmp_path: Path) -> None:
    folder = pictures(tmp_path / "grey", np.array([120.0, 122.0, 121.0]))
    command = ["reconstruct", str(folder), "-o", str(tmp_path / "out"), "--background", "chroma"]
    for more, message in (
        ([], "no saturated colour fills 10%"),
        (["--key", "#00b140"], "no saturated colour near #00b140"),
        (["--key", "green"], "expected a colour #rrggbb"),
        (["--key", "#808080"], "nearly grey"),
    ):
        (line,) = fail("psfs", *command, *more).strip().splitlines()
        assert message in line


def test_an_empty_plate_says_where_the_screen_is(tmp_path: Path) -> None:
    rig = CameraRig((scenes.ring(1, size=(64, 48))[0],))
    plate = np.full((48, 64, 3), 100, np.uint8)
    plate[:, 20:] = GREEN.astype(np.uint8)
    path = tmp_path / "c0.png"
    assert cv2.imwrite(str(path), plate)
    media = (open_media("c0", [path]),)
    screen = key_from_media(rig, media, empty=True).screen[0]
    assert screen[:, 21:].all() and not screen[:, :19].any()
    assert key_from_media(rig, media, empty=False).screen.all()
