"""The prior on the change from frame to frame, and its kernels against the twin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.likelihoods import Setup, only, smooth_maps
from helpers.worlds import World

from apf.body.kinematics import posed_cones
from apf.filters.annealed import AnnealedParticleFilter
from apf.filters.config import FilterConfig
from apf.likelihood.config import MotionPriorConfig
from apf.likelihood.motion_prior import MotionPrior
from apf.likelihood.term import Shared
from apf.reference.filters.annealed import NumpyAnnealedParticleFilter
from apf.reference.likelihood.motion_prior import expectation, motion_errors
from apf.scene import Scene
from cl import Device, NumpyDevice

SONG = bodies.named("song31")
CONFIG, VELOCITY = MotionPriorConfig(weight=0.3, scale=2.0), 0.5


def test_the_cost_is_the_mean_squared_change_in_sigmas() -> None:
    expected = SONG.rest_pose
    poses = np.stack([expected, expected + 2 * SONG.sigma, expected - 6 * SONG.sigma])
    np.testing.assert_allclose(motion_errors(SONG, poses, expected, CONFIG), [0, 1, 9])
    nothing = np.full(SONG.n_dof, np.nan)
    assert not motion_errors(SONG, poses, nothing, CONFIG).any()
    # Half as many frames per second may change by twice as much.
    slow = FilterConfig.create(motion_prior_scale=2.0).scale_to_rate(30.0).likelihood.motion_prior
    np.testing.assert_allclose(motion_errors(SONG, poses, expected, slow), [0, 1 / 4, 9 / 4])
    still = replace(SONG, sigma=np.zeros(SONG.n_dof))
    assert not motion_errors(still, poses, expected, CONFIG).any()


@pytest.mark.parity(
    "tracking/motion_prior.add_motion_errors", "tracking/motion_prior.expect_motion"
)
@pytest.mark.parametrize("name", ["song31", "stick"])
@pytest.mark.parametrize("n", [1, 37, 300])
def test_kernels_agree_with_the_twin(device: Device, name: str, n: int) -> None:
    body = bodies.named(name)
    poses = bodies.random_poses(body, n, wild=True).astype(np.float32)
    scene = Scene(device, scenes.ring(2), None, body)
    cameras = device.to_device(scene.rig.packed())
    term = MotionPrior(Shared(scene, 1, VELOCITY, cameras, cameras), CONFIG)
    errors, on_device = device.zeros((n,), np.float32), device.to_device(poses)
    motion = np.full((body.n_dof, 2), np.nan)
    score, learn = term.launcher(on_device, 0.25, errors), term.learning_launcher(on_device)
    for frame in range(4):
        errors.fill(3.0)
        for launch in score:
            launch()
        expected = 3 + 0.25 * motion_errors(body, poses, motion[:, 1], CONFIG)
        np.testing.assert_allclose(errors.get(), expected, rtol=1e-4)
        assert (frame == 0) == (motion != motion).all()
        for launch in learn:
            launch()
        motion = expectation(motion, poses[0].astype(float), VELOCITY)
        np.testing.assert_allclose(term.motion.get(), motion, atol=1e-5)
        poses[0] = bodies.random_poses(body, 1, seed=frame + 1)[0]
        on_device.set(poses)
    term.forget()
    assert np.isnan(term.motion.get()).all()


def test_a_jump_to_a_better_place_is_forbidden_once_there_was_a_frame(device: Device) -> None:
    """The surface prefers the jump; the prior, which knows the last pose, does not."""
    grid, rig = scenes.small_grid(0.1), scenes.ring(2)
    poses = np.stack([SONG.rest_pose, SONG.rest_pose])
    poses[0, SONG.dof_names.index("l_upper_arm.ry")] += 12 * SONG.sigma.max()

    def setup(weight: float) -> Setup:
        config = only("surface").with_changes(n_points=100, motion_prior_weight=weight)
        made = Setup(device, SONG, rig, poses, smooth_maps(rig), config, grid)
        points = np.concatenate([made_points(poses[0]), np.ones((100, 1))], 1)
        made.likelihood.points.set(points.astype(np.float32))
        return made

    def made_points(pose: np.ndarray) -> np.ndarray:
        cones = posed_cones(SONG, pose[None])[0]
        arms = cones[[c.name.startswith("l_") for c in SONG.cones]]
        of = arms[np.arange(100) % len(arms)]
        return of[:, 0:3] + np.linspace(0, 1, 100)[:, None] * (of[:, 4:7] - of[:, 0:3])

    for weight, obeyed in ((0.0, False), (2.0, True)):
        here = setup(weight)
        jump, stay = here.errors()
        assert jump < stay  # in the first frame nothing is expected
        last = device.to_device(poses[1:].astype(np.float32))
        for launch in here.likelihood.learning_launcher(last):
            launch()
        jump, stay = here.errors()
        assert (stay < jump) == obeyed
        here.likelihood.forget()
        jump, stay = here.errors()
        assert jump < stay


def test_trackers_let_the_term_learn_their_estimates(device: Device) -> None:
    world = World(device)
    config = FilterConfig.create(
        n_particles=64,
        n_layers=2,
        last_survival=0.2,
        refinement_steps=0,
        motion_prior_weight=0.5,
        seed=1,
    )
    tracker = AnnealedParticleFilter(world.scene(), config)
    twin = NumpyAnnealedParticleFilter(world.scene(NumpyDevice()), config)
    for one in (tracker, twin):
        one.start(world.pose(0))
    for frame in range(3):
        found, expected = tracker.step(world.voxels(frame)), twin.step(world.twin(frame))
        assert np.all(np.abs(found.pose - expected.pose) <= 0.7 * SONG.sigma)
        np.testing.assert_allclose(found.least_error, expected.least_error, rtol=0.05)
        motion = tracker.likelihood.terms["motion_prior"].motion.get()
        np.testing.assert_allclose(motion[:, 0], found.pose, atol=1e-6)
        np.testing.assert_allclose(
            twin.likelihood.terms["motion_prior"].motion[:, 0], expected.pose
        )
    tracker.start(world.pose(0))
    assert np.isnan(tracker.likelihood.terms["motion_prior"].motion.get()).all()
