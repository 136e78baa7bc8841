"""A frame is divided among people: kernels against the twin, and by hand."""

import numpy as np
import pytest
from helpers import scenes

from cl import Device, InputError, NumpyDevice
from psfs.backend import make_division
from psfs.background.config import UNKNOWN, EvidenceConfig
from psfs.cameras.camera import CameraRig
from psfs.reconstructor import Reconstructor
from psfs.reference.division import divide_evidence
from psfs.reference.reconstructor import NumpyReconstructor
from psfs.voxels.division import BANDS, LEVELS, Division, find_bands, weigh_colours

GRID, CONFIG = scenes.small_grid(), EvidenceConfig()


def before(size: tuple[int, int], focal: float) -> CameraRig:
    """Return a camera at x = 4 m."""
    return CameraRig((scenes.pinhole("before", [4.0, 0, 0.8], [0.0, 0, 0.8], size, focal),))


def crowd(people: int, seed: int = 0) -> np.ndarray:
    """Spheres (P, 9, 4) of people somewhere in the grid; one is behind all cameras, one is none."""
    random = np.random.default_rng(seed)
    feet = random.uniform([-0.6, -0.5, 0], [0.7, 0.6, 0.1], (people, 1, 3))
    spheres = feet + [0, 0, 1.7] * np.linspace(0, 1, 9)[:, None] + random.normal(0, 0.05, (9, 3))
    spheres[0, 0] = 50.0, 50.0, 80.0
    spheres = np.concatenate([spheres, random.uniform(0.03, 0.2, (people, 9, 1))], -1)
    spheres[1, 3] = 0
    return spheres.astype(np.float32)


@pytest.mark.parity("reconstruction/people.project_people", "reconstruction/people.divide_evidence")
@pytest.mark.parametrize(("occlusion_prior", "coloured"), [(0.5, False), (0.3, True)])
def test_each_persons_evidence_equals_the_twins(
    device: Device, occlusion_prior: float, coloured: bool
) -> None:
    random, rig = np.random.default_rng(1), scenes.ring(3, size=(81, 63))
    shape = (3, rig.height, rig.width)
    evidence = random.integers(-128, 128, shape).astype(np.int8)
    images = random.integers(0, 256, (*shape, 3)).astype(np.uint8)
    everybody = Reconstructor(device, rig, GRID, None)
    config = CONFIG.replace(occlusion_prior=occlusion_prior)
    settings = everybody.config
    settings = settings.replace(silhouette=settings.silhouette.replace(evidence=config))
    everybody.silhouette.evidence.set(evidence)
    everybody.voxels.frame = scenes.frame(images=images)
    spheres, colours = crowd(3 if coloured else 2), None
    if coloured:
        colours = random.integers(0, 9, (3, BANDS, LEVELS**3)) ** 2.0
        colours[2, 1] = 0  # nothing is known
    divide = Division(device, rig, everybody.voxels, [GRID] * len(spheres), 9, settings, colours)
    divide.spheres.set(spheres)
    if divide.bands is not None:
        divide.bands.set(find_bands(spheres))
    maps = np.stack([part.evidence.get() for part in divide() if part.evidence is not None])
    weighed = None if colours is None else weigh_colours(colours)
    expected = divide_evidence(rig, evidence, spheres, config, images, weighed)
    apart = np.abs(maps.astype(int) - expected)
    # Whether a ray passes a sphere's rim is a difference of products of 9 m^2 in float32.
    assert (apart > 1).mean() < 5e-4 and (apart > 0).mean() < 2e-3
    assert UNKNOWN in expected[:, evidence > 0] and (expected[:, evidence > 0] < 0).any()


def test_colours_say_whose_a_pixel_is_where_both_are() -> None:
    rig = before((60, 60), 70)
    near = np.array([[0.5, 0.0, 0.8, 0.4]])
    spheres = np.stack([near, near - [1, 0, 0, 0]])
    pictures = np.zeros((1, 60, 60, 3), np.uint8)
    pictures[:, :, 30:] = 255  # the nearer one wears black, the other white
    colours = np.zeros((2, BANDS, LEVELS**3))
    colours[0, :, 0] = colours[1, :, -1] = 1
    evidence = np.full((1, 60, 60), 12, np.int8)
    own = divide_evidence(rig, evidence, spheres, CONFIG, pictures, weigh_colours(colours))[:, 0]
    black, white = own[:, 30, 28].tolist(), own[:, 30, 32].tolist()
    assert black[0] > 10 and black[1] == UNKNOWN and white[0] < -20 and white[1] > 10


def test_each_persons_voxels_equal_the_twins(device: Device) -> None:
    rig = scenes.without_distortion(scenes.ring(4))
    frame = scenes.frame(masks=scenes.masks_of(rig))
    spheres = np.array([[[0.0, 0.0, 0.5, 0.4]], [[0.0, 0.0, 1.4, 0.3]]], np.float32)
    clouds = []
    for reconstruct in (
        Reconstructor(device, rig, GRID, None),
        NumpyReconstructor(NumpyDevice(), rig, GRID, None),
    ):
        reconstruct(frame)
        divide = make_division(reconstruct.device, reconstruct, [GRID, GRID], 1)
        clouds.append([voxels.cloud() for voxels in divide(spheres, None)])
    for cloud, twin in zip(*clouds, strict=True):
        assert len(np.setxor1d(cloud.indices, twin.indices)) <= max(2, 0.01 * len(twin.indices))
    low, high = clouds[0]
    assert low.centres[:, 2].mean() < high.centres[:, 2].mean() - 0.4


def test_pixels_of_others_are_background_or_unknown_and_of_two_beside_each_other_shared() -> None:
    rig = before((120, 120), 140)
    low = np.array([[0.0, 0.0, 0.4, 0.2], [0.0, 0.0, 1.0, 0.2]])
    nearer, aside = low + np.array([1.0, 0, 0, 0]), low + np.array([0, 0.9, 0, 0])
    evidence = np.full((1, 120, 120), 12, np.int8)
    evidence[:, :4] = -9
    own = divide_evidence(rig, evidence, np.stack([low, nearer, aside]), CONFIG)[:, 0]

    def at(y: float) -> list[int]:
        column, row = rig[0].project(np.array([[0.0, y, 1.0]]))[0][0]
        return own[:, int(row), int(column)].tolist()

    none = int(CONFIG.counts(np.zeros(1))[0])
    behind, nearest, other = at(0.0)
    assert (behind, other) == (UNKNOWN, none) and 8 < nearest < 12  # perhaps it is not there
    assert at(0.9) == [none, none, 12]
    # Between the nearer one and the one aside both may be seen.
    assert ((own[1:] > none) & (own[1:] < 8)).all(0).any()
    assert (own[:, :4] == -9).all()
    assert own[:, 8, 4].tolist() == [none, none, none]  # too far from everybody


def test_voxels_without_evidence_are_refused(device: Device) -> None:
    rig = scenes.ring(3, size=(81, 63))
    everybody = Reconstructor(device, rig, GRID, None)
    everybody.voxels.evidence = None
    with pytest.raises(InputError, match="no evidence"):
        Division(device, rig, everybody.voxels, [GRID, GRID], 9)
