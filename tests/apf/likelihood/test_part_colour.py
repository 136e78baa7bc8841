"""The colours of the parts of a body, and their kernels against the twin."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.kinds import other_kind
from helpers.likelihoods import Setup, only, scattered_poses, smooth_maps
from helpers.parity import traced
from helpers.worlds import World

from apf.body.cones import distances
from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel
from apf.filters.annealed import AnnealedParticleFilter
from apf.filters.config import FilterConfig
from apf.likelihood.config import LikelihoodConfig
from apf.likelihood.voxel import VoxelLikelihood
from apf.reference.likelihood.part_colour import chromaticities, colour_errors, learnt
from apf.reference.likelihood.voxel import (
    NumpyVoxelLikelihood,
    sampled_surface,
    subset,
    surface_errors,
)
from apf.scene import Scene
from cl import Device, InputError, NumpyDevice
from psfs.reconstructor import Reconstructor
from psfs.reference.reconstructor import NumpyReconstructor
from psfs.voxels.grid import VoxelGrid

SONG = bodies.named("song31")
GRID = scenes.small_grid(0.05)
CONFIG = LikelihoodConfig()
SCALE, DARK = CONFIG.part_colour.scale, CONFIG.part_colour.dark
QUARTER = FilterConfig.of(part_colour_rate=0.25).likelihood
BLUE, SKIN = (60, 70, 130), (200, 150, 120)


def crossing() -> np.ndarray:
    """The left forearm lies across the belly."""
    pose = SONG.rest_pose.copy()
    for axis, value in (("upper_arm.ry", 0.4), ("upper_arm.rz", -1.2), ("forearm.ry", 1.5)):
        pose[SONG.dof_names.index(f"l_{axis}")] = value
    return pose


def shell(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Voxels (M,) of GRID at the surface of a pose, and the cone that each belongs to."""
    away = distances(GRID.centres(), posed_cones(SONG, pose[None])[0])
    outer = np.flatnonzero(np.abs(away.min(1)) < 0.6 * GRID.voxel_size)
    return outer, np.abs(away[outer]).argmin(1)


def painted(cones: np.ndarray, arms: tuple[int, int, int]) -> np.ndarray:
    """Colours (M, 4), seen by two cameras, of voxels at cones (M,): blue, `arms` at the arms."""
    bare = np.array(["arm" in cone.name for cone in SONG.cones])
    rgb = np.where(bare[cones][:, None], arms, BLUE)
    return np.concatenate([rgb, np.full((len(cones), 1), 2)], 1).astype(np.uint8)


def test_chromaticity_is_of_the_garment_and_not_of_the_light() -> None:
    def one(*colour: float) -> np.ndarray:
        return chromaticities(np.array([[*colour, 3]]), DARK)[0]

    lit, shaded, skin = one(*BLUE), one(*(c / 2 for c in BLUE)), one(*SKIN)
    assert np.linalg.norm(lit - shaded) < 0.03 < 0.2 < np.linalg.norm(lit - skin)
    np.testing.assert_allclose([one(0, 0, 0), one(90, 90, 90)], [[0, 0, 1]] * 2, atol=1e-12)
    np.testing.assert_allclose(one(255, 0, 0)[:2], 255 / 285 / np.sqrt([2, 6]))
    assert np.linalg.norm(one(4, 0, 2)[:2]) < 0.12  # the noise of a dark pixel
    assert not chromaticities(np.array([[255, 0, 0, 0]]), DARK).any()  # nobody sees it


@pytest.mark.parametrize("arms", [SKIN, BLUE])
def test_an_arm_that_is_taken_for_the_torso_costs(arms: tuple[int, int, int]) -> None:
    """Learnt with hanging arms; then one crosses the torso. If it has the torso's colour, nothing
    tells; else a pose that leaves it hanging has bare skin on its torso."""
    voxels, of = shell(SONG.rest_pose)
    parts = np.zeros((len(SONG.cones), 3))
    cones = posed_cones(SONG, np.stack([SONG.rest_pose, crossing()]))
    samples = chromaticities(painted(of, arms), DARK)
    parts = learnt(parts, GRID.centres(voxels), samples, cones[0], CONFIG)
    assert parts[:, 2].mean() > 0.8

    voxels, of = shell(crossing())
    points, samples = GRID.centres(voxels), chromaticities(painted(of, arms), DARK)
    hanging, right = colour_errors(points, samples, parts, cones, SCALE)
    assert right < 1e-6
    if arms == SKIN:
        assert hanging > 0.03
        geometry = surface_errors(points, cones, 0.05)
        assert hanging > geometry[0] - geometry[1]  # says more than the surface does
    else:
        assert hanging < 1e-6


def test_colours_are_learnt_slowly_and_only_where_they_show() -> None:
    voxels, of = shell(SONG.rest_pose)
    points, cones = GRID.centres(voxels), posed_cones(SONG, SONG.rest_pose[None])[0]
    nothing = np.zeros((len(SONG.cones), 3))
    blue, skin = (chromaticities(painted(of, arms), DARK) for arms in (BLUE, SKIN))
    first = learnt(nothing, points, blue, cones, QUARTER)
    second = learnt(first, points, skin, cones, QUARTER)
    arm = [cone.name for cone in SONG.cones].index("l_upper_arm")
    full = learnt(nothing, points, skin, cones, QUARTER)[arm]
    np.testing.assert_allclose(second[arm, :2], 0.75 * first[arm, :2] + 0.25 * full[:2])
    unseen = np.where((of == arm)[:, None], 0.0, skin)
    np.testing.assert_array_equal(learnt(first, points, unseen, cones, QUARTER)[arm], first[arm])
    assert not learnt(nothing, points, unseen, cones, QUARTER)[arm].any()
    np.testing.assert_array_equal(learnt(first, points[:0], skin[:0], cones, QUARTER), first)


def coloured(device: Device, grid: VoxelGrid, indices: np.ndarray, colours: np.ndarray) -> Any:
    """As much of `Voxels` as a likelihood with colours needs."""
    on_device = device.to_device(colours if len(colours) else np.zeros((1, 4), np.uint8))
    return SimpleNamespace(
        evidence=None,
        grid=grid,
        surface=device.to_device(indices if len(indices) else np.zeros(1, np.int32)),
        count=device.to_device(np.array([len(indices)], np.int32)),
        colours=lambda: on_device,
    )


CASES = [(name, n, "own") for name in ("song31", "stick") for n in (0, 1, 900)]


@pytest.mark.parity(
    "tracking/part_colour.compare_colours",
    "tracking/part_colour.add_colour_errors",
    "tracking/part_colour.find_nearest_parts",
    "tracking/part_colour.learn_colours",
)
@pytest.mark.parametrize(("name", "n_voxels", "kind"), [*CASES, ("stick", 900, "other")])
def test_kernels_agree_with_the_twin(device: Device, name: str, n_voxels: int, kind: str) -> None:
    """Samples as near to one part as to another may count for either."""
    device = device if kind == "own" else other_kind(device)
    body, rig, grid = bodies.named(name), scenes.ring(2), scenes.small_grid(0.1)
    random = np.random.default_rng(n_voxels)
    indices = np.sort(random.choice(grid.size, n_voxels, replace=False)).astype(np.int32)
    poses = scattered_poses(body, 23)
    poses[:2] = bodies.random_poses(body, 2)
    settings: Any = {"n_points": 300, "point_turns": 2, "surface_scale": 0.3}
    config = only("none").changed(part_colour_weight=1.5, **settings)
    setup = Setup(device, body, rig, poses, smooth_maps(rig), config, grid)
    points = sampled_surface(grid.centres(indices), 300)
    cones, parts = posed_cones(body, setup.poses), np.zeros((len(body.cones), 3))
    for frame in range(3):
        colours = random.integers(0, 256, (n_voxels, 4)).astype(np.uint8)
        colours[:, 3] = random.integers(0, 3, n_voxels)
        setup.likelihood.observe(coloured(device, grid, indices, colours))
        samples = sampled_surface(chromaticities(colours, DARK), 300)
        for turn in (0, 1):
            found = setup.errors(turn) / len(rig)
            here, seen = subset(points, turn, 2), subset(samples, turn, 2)
            expected = 1.5 * colour_errors(here, seen, parts, cones, SCALE)
            assert np.abs(found - expected).max() <= 1.5 * 4 / 50
            assert np.mean(np.abs(found - expected) < 1e-4) > 0.8
            assert found.any() == (frame > 0) or n_voxels < 900  # nothing is known at first
        moved = np.roll(setup.poses, -frame, axis=0)
        for launch in setup.likelihood.learning_launcher(device.to_device(moved)):
            launch()
        parts = learnt(parts, points, samples, cones[frame], config.likelihood)
        colours_known = setup.likelihood.part_colours
        assert colours_known is not None
        np.testing.assert_allclose(colours_known.parts.get()[:, :3], parts, atol=0.02)
    setup.likelihood.forget()
    assert not colours_known.parts.get().any()


@pytest.mark.parity("tracking/part_colour.sample_colours")
@pytest.mark.parametrize("n_voxels", [0, 1, 299, 900])
def test_samples_agree_with_the_twin(device: Device, n_voxels: int) -> None:
    random = np.random.default_rng(n_voxels)
    indices = np.sort(random.choice(GRID.size, n_voxels, replace=False)).astype(np.int32)
    colours = random.integers(0, 256, (n_voxels, 4)).astype(np.uint8)
    colours[:, 3] = random.integers(0, 3, n_voxels)  # some are seen by no camera
    config = FilterConfig.of(part_colour_weight=1.0, n_points=300).likelihood
    likelihood = VoxelLikelihood(Scene(device, scenes.ring(1), GRID, SONG), config, 2)
    with traced("tracking/part_colour.sample_colours") as launches:
        likelihood.observe(coloured(device, GRID, indices, colours))
    found = launches[0].after["samples"]
    expected = np.zeros((300, 3))
    if n_voxels:
        expected = sampled_surface(chromaticities(colours, DARK), 300)
    np.testing.assert_allclose(found[:, :3], expected, atol=1e-6)
    assert not found[:, 3].any()


def test_trackers_learn_at_their_estimates(device: Device) -> None:
    world = World(device)
    config = FilterConfig.of(n_particles=37, n_layers=2, part_colour_weight=1.0, n_points=400)
    tracker = AnnealedParticleFilter(world.scene(), config)
    parts = np.zeros((len(SONG.cones), 3))
    tracker.start(world.pose(0))
    for frame in range(2):
        voxels: Any = world.voxels(frame)
        surface = world.twin(frame).surface
        colours = np.random.default_rng(frame).integers(1, 255, (len(surface), 4)).astype(np.uint8)
        on_device = device.to_device(colours)
        voxels.colours = lambda array=on_device: array
        pose = tracker.step(voxels).pose
        points = sampled_surface(world.grid.centres(surface), 400)
        samples = sampled_surface(chromaticities(colours, DARK), 400)
        cones = posed_cones(SONG, pose[None])[0]
        parts = learnt(parts, points, samples, cones, config.likelihood)
        found = tracker.likelihood.part_colours.parts.get()
        np.testing.assert_allclose(found[:, :3], parts, atol=0.02)
    tracker.start(world.pose(0))
    assert not tracker.likelihood.part_colours.parts.get().any()


def test_both_take_the_same_colours_from_pictures(device: Device) -> None:
    rig, grid = scenes.ring(3), scenes.small_grid(0.08)
    masks = scenes.masks_of(rig)
    images = np.zeros((*masks.shape, 3), np.uint8)
    images[..., 0] = np.linspace(0, 250, masks.shape[1])[:, None]  # blue below, red above
    images[..., 2] = 250 - images[..., 0]
    picture: Any = scenes.frame(images=images, masks=masks)
    config = FilterConfig.of(n_points=200, part_colour_weight=1.0).likelihood
    here = VoxelLikelihood(Scene(device, rig, grid, SONG), config, 37)
    with traced("tracking/part_colour.sample_colours") as launches:
        here.observe(Reconstructor(device, rig, grid, None)(picture))
    voxels = NumpyReconstructor(NumpyDevice(), rig, grid, None)(picture)
    twin = NumpyVoxelLikelihood(Scene(NumpyDevice(), rig, grid, SONG), config)
    twin.observe(voxels)
    found, points = launches[0].after["samples"], here.points.get()
    expected = sampled_surface(chromaticities(voxels.colours(), DARK), 200)
    assert np.ptp(found[found[:, 2] > 0, 0]) > 0.3
    same = np.linalg.norm(points[:, :3] - twin.points, axis=1) < 1e-4
    assert same.mean() > 0.8  # a voxel more or less shifts those behind it
    close = np.linalg.norm(found[:, :3] - expected, axis=1) < 0.02
    assert close[same].mean() > 0.95


def test_without_pictures_the_term_is_refused(device: Device) -> None:
    rig, grid = scenes.ring(2), scenes.small_grid(0.1)
    config = FilterConfig.of(part_colour_weight=1.0).likelihood
    picture: Any = scenes.frame(masks=scenes.masks_of(rig))
    likelihoods: list[tuple[Any, Any]] = [
        (
            VoxelLikelihood(Scene(device, rig, grid, SONG), config, 37),
            Reconstructor(device, rig, grid, None),
        ),
        (
            NumpyVoxelLikelihood(Scene(NumpyDevice(), rig, grid, SONG), config),
            NumpyReconstructor(NumpyDevice(), rig, grid, None),
        ),
    ]
    for likelihood, reconstruct in likelihoods:
        with pytest.raises(InputError, match=r"term part_colour: .*no pictures"):
            likelihood.observe(reconstruct(picture))


def test_it_asks_for_no_colours_by_default(device: Device) -> None:
    with pytest.raises(InputError, match=r"part_colour_rate is 1\.5"):
        FilterConfig.of(part_colour_rate=1.5)

    def forbidden() -> None:
        raise AssertionError("colours were asked for")

    voxels = coloured(device, GRID, np.zeros(0, np.int32), np.zeros((0, 4), np.uint8))
    voxels.colours = forbidden
    off = VoxelLikelihood(Scene(device, scenes.ring(1), GRID, SONG), CONFIG, 37)
    off.observe(voxels)
    body: BodyModel = SONG
    assert off.learning_launcher(device.zeros((1, body.n_dof), np.float32)) == []
