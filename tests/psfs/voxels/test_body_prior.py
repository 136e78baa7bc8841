"""A tracked body as a prior of the voxels: kernels and twin, what it does, what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import scenes
from helpers.bodies import cone

from cl import Device, InputError, NumpyDevice
from psfs.backend import make_reconstructor
from psfs.cameras.rig_geometry import CELL, cell_rays
from psfs.common.cones import cone_distances, ray_cone_distances
from psfs.opening import share_on_silhouettes
from psfs.reference.reconstructor import body_evidence, body_location
from psfs.reference.surface import occupancy, smooth
from psfs.sequence import Frame
from psfs.voxels.body_prior import BESIDE, INSIDE, BodyLocation, TrackedBody, pack_body
from psfs.voxels.bricks import Bricks
from psfs.voxels.config import OccupancyConfig, ReconstructionConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid

RIG, GRID, WHOLE = scenes.ring(5), scenes.small_grid(), ReconstructionConfig()
EVIDENCE = WHOLE.silhouette.evidence
STEP, STEPS = EVIDENCE.step, EVIDENCE.ratio_steps


#: Trunk and head of the test body, a foot that is not there, and one of which nothing is known.
CONES = np.stack(
    [
        cone([0.02, -0.05, 0.4], [0.02, -0.05, 1.0], (0.22, 0.2), (0.3, 1, 0.2), (1, 0.7)),
        cone([0.1, 0.0, 1.25], [0.1, 0.0, 1.35], (0.27, 0.27), (0.3, 1, 0.2), (1, 0.7)),
        cone([0.3, 0.1, 0.15], [0.55, 0.4, 0.1], (0.08, 0.05), (0.3, 1, 0.2), (1, 0.7)),
        np.full(16, np.nan),
    ]
)
BODY = TrackedBody(Path("track.npz"), np.array([3, 4, 7]), np.stack(3 * [CONES]))


def test_counts_fall_from_inside_to_outside() -> None:
    ray = np.array([0.1, 0.0, 1.62 - 0.27]) + np.outer([0.0, 0.25, 0.27, 0.29, 0.6], [0, 0, 1])
    known = CONES[1:2]
    np.testing.assert_allclose(body_evidence(ray, known, 0.05), [100, 100, 30, -40, -40])
    # A limb is lost: it may be anywhere.
    np.testing.assert_allclose(body_evidence(ray, CONES[[1, 3]], 0.05), [100, 100, 50, 0, 0])
    assert not body_evidence(ray, CONES[3:], STEP).any()


@pytest.mark.parity(
    "reconstruction/occupancy.sparse_occupancy", "reconstruction/occupancy.find_bricks"
)
@pytest.mark.parametrize(
    ("known", "grid"),
    [(3, GRID), (4, GRID), (0, GRID), pytest.param(3, scenes.small_grid(0.15), id="small")],
)
def test_agrees_with_the_twin(device: Device, known: int, grid: VoxelGrid) -> None:
    """All cones known, one lost, none known; no brick is left out."""
    evidence, config = scenes.patches_of_evidence(RIG, 5, 8), OccupancyConfig()
    cones = CONES[:known] if known else CONES[3:].repeat(4, 0)
    packed = device.zeros((5, 16), np.float32)
    packed.set(np.vstack([pack_body(WHOLE, cones), np.zeros((5, 16))])[:5].astype("f4"))
    maps = device.to_device(evidence)
    found = scenes.carve(Bricks(device, RIG, grid, maps, STEP, scenes.ALL_BRICKS, body=packed))
    expected = occupancy(
        *(RIG, grid, evidence, STEP, config),
        body=lambda points: body_evidence(points, cones, STEP),
    )
    smoothed = smooth(expected, True)
    assert (np.abs(found - smoothed) > 1e-5).mean() < 1e-2
    plain = occupancy(RIG, grid, evidence, STEP, config)
    assert (np.abs(plain - expected) > 1e-5).any() == (known > 0)
    few = scenes.carve(Bricks(device, RIG, grid, maps, STEP, config, body=packed))
    np.testing.assert_array_equal(few[found > config.threshold], found[found > config.threshold])
    assert (few <= found).all()


def test_the_distance_of_a_ray_is_the_least_along_it() -> None:
    random, origin = np.random.default_rng(1), np.array([2.0, -1.5, 1.2])
    rays = np.array([0.1, 0.0, 0.9]) - origin + random.normal(0, 0.4, (200, 3))
    along = origin + np.linspace(0.2, 2.5, 3000)[:, None, None] * rays
    least = cone_distances(along.reshape(-1, 3), CONES[:3]).reshape(3000, 200, 3).min(0)
    found = ray_cone_distances(origin, rays, CONES[:3])
    np.testing.assert_allclose(found, least, atol=2e-3)
    assert (found < 0).any(0).all() and (found > 0).any(0).all()


@pytest.mark.parity("reconstruction/body_location.body_location")
@pytest.mark.parametrize("known", [3, 4, 0])
def test_the_location_agrees_with_the_twin(device: Device, known: int) -> None:
    """All cones known, one lost, none known: then the prior stays as it is."""
    cones = CONES[:known] if known else CONES[3:].repeat(4, 0)
    location = device.to_device(np.full(cell_rays(RIG).shape[:3], 5, np.int8))
    packed = device.to_device(pack_body(WHOLE, cones))
    BodyLocation(device, RIG, location, packed)()
    found, expected = location.get(), body_location(RIG, cones, WHOLE)
    if not known:
        assert expected is None and (found == 5).all()
        return
    assert expected is not None
    assert np.abs(found.astype(int) - expected).max() <= 1
    assert (found != expected).mean() < 0.01
    # Pixels within the body are expected to show it; beside it not, if no limb is lost.
    assert expected.max() == round(STEPS * INSIDE)
    assert expected.min() == (round(STEPS * BESIDE) if known == 3 else 0)


def carve(device: Device | NumpyDevice, body: TrackedBody | None, frame: Frame) -> VoxelCloud:
    return make_reconstructor(device, RIG, GRID, None, body=body)(frame).cloud()


def test_a_part_that_one_camera_denies_stays(device: Device) -> None:
    masks = scenes.masks_of(RIG)
    whole = carve(device, None, scenes.frame(4, masks=masks))
    masks[1, : masks.shape[1] // 2] = 0
    blind = scenes.frame(4, masks=masks)
    without, with_body = carve(device, None, blind), carve(device, BODY, blind)
    twin = carve(NumpyDevice(), BODY, blind)
    assert len(np.setxor1d(with_body.indices, twin.indices)) <= 0.02 * len(twin)
    lost, kept = whole.volume - without.volume, whole.volume - with_body.volume
    assert lost > 0.2 * whole.volume and kept < 0.7 * lost
    # In a frame that the track lacks nothing changes.
    np.testing.assert_array_equal(
        carve(device, BODY, replace(blind, index=5)).indices, without.indices
    )


def test_pictures_are_judged_by_where_the_body_is(device: Device) -> None:
    """As the twin judges them; what one camera shows could be either everywhere."""
    picture, background = scenes.pictures_of(RIG)
    assert picture.images is not None
    signs = np.random.default_rng(2).choice([-2.2, 2.2], background.mean[1].shape)
    picture.images[1] = np.clip(background.mean[1] + signs * background.std[1], 0, 255)
    config = ReconstructionConfig()
    frame, evidence = replace(picture, index=4), []
    for where, body in ((device, BODY), (NumpyDevice(), BODY), (device, None)):
        reconstruct = make_reconstructor(where, RIG, GRID, background, config, body=body)
        reconstruct(frame)
        evidence.append(reconstruct.evidence().astype(int))
    found, expected, without = evidence
    assert (np.abs(found - expected) > 2).mean() < 0.02
    location = body_location(RIG, CONES, config)
    assert location is not None
    drawn = location[1].repeat(CELL, 0).repeat(CELL, 1)[: RIG.height, : RIG.width]
    within = drawn > 0.7 * drawn.max()
    assert found[1][within].mean() > without[1][within].mean() + 10
    assert (found[1][drawn == 0] > 0).mean() < 0.2


def test_share_of_the_axes_on_silhouettes() -> None:
    evidence = np.where(scenes.masks_of(RIG) > 0, 60, -60).astype(np.int8)
    assert share_on_silhouettes(RIG, evidence, CONES[:2]) == 1
    assert 0.6 < share_on_silhouettes(RIG, evidence, CONES) < 0.9
    beside = CONES[:2] + np.eye(16)[0] * 1.0 + np.eye(16)[4] * 1.0
    assert share_on_silhouettes(RIG, evidence, beside) < 0.2
    assert np.isnan(share_on_silhouettes(RIG, evidence, CONES[3:]))


def test_several_people_are_one_prior(tmp_path: Path) -> None:
    (tmp_path / "people.json").touch()
    with pytest.raises(InputError, match="no person1"):
        TrackedBody.open(tmp_path)
    for number, frames in ((1, [3, 4]), (2, [4, 6])):
        folder = tmp_path / f"person{number}"
        folder.mkdir()
        np.savez(folder / "track.npz", frames=frames, cones=number * np.stack(2 * [CONES]))
        with pytest.raises(InputError, match="one of several people"):
            TrackedBody.open(folder / "track.npz")
    both = TrackedBody.open(tmp_path)
    assert both.frames.tolist() == [3, 4, 6]
    np.testing.assert_array_equal(both[4], np.concatenate([CONES, 2 * CONES]))
    assert np.isnan(both[6][: len(CONES)]).all()
    assert np.isnan(both[3][len(CONES) :]).all()
