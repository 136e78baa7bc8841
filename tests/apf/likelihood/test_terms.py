"""Every registered term, those of other installed packages among them."""

from typing import Any

import numpy as np
import pytest
from helpers import bodies
from helpers.kinds import other_kind
from helpers.likelihoods import only
from helpers.worlds import World

from apf.filters.config import FilterConfig
from apf.filters.term_weights import parse_weights
from apf.likelihood.terms import TERMS, TermSpec
from apf.likelihood.voxel import VoxelLikelihood
from apf.reference.likelihood.voxel import NumpyVoxelLikelihood
from cl import Device, NumpyDevice


def term_alone(spec: TermSpec) -> FilterConfig:
    """Settings by which this term alone counts, as in its row."""
    others = {f"{name}_weight": 0.0 for name in TERMS}
    own = {f"{spec.name}_{name}": value for name, value in spec.parity.settings.items()}
    return only("none").with_changes(**(others | own))


def assert_parity(device: Device, spec: TermSpec, name: str, n: int) -> None:
    """Score `n` poses of a body in three frames, of which each is learnt from."""
    body = bodies.named(name)
    world, config = World(device, body, voxel=0.1), term_alone(spec).likelihood
    term = VoxelLikelihood(world.scene(), config, n)
    twin = NumpyVoxelLikelihood(world.scene(NumpyDevice()), config)
    images = _images(world)
    pictures, changed = device.to_device(images), False
    on_device = device.empty((n, body.n_dof), np.float32)
    score, learn = term.launcher(on_device), term.learning_launcher(on_device)
    for frame in range(3):
        poses = bodies.random_poses(body, n, seed=frame).astype(np.float32)
        poses[0] = np.clip(world.pose(frame) + 0.05 * frame, body.lower, body.upper)
        voxels: Any = world.voxels(frame)
        voxels.pictures = lambda: pictures
        term.observe(voxels)
        host = world.twin(frame)
        object.__setattr__(host, "pictures", images)
        twin.observe(host)
        on_device.set(poses)
        for launch in score:
            launch()
        found, expected = term.errors.get(), twin(poses.astype(float))
        tolerance = len(world.rig) * spec.parity.atol
        np.testing.assert_allclose(found, expected, rtol=spec.parity.rtol, atol=tolerance)
        changed |= bool(np.abs(expected).max() > 4 * tolerance)
        for launch in learn:
            launch()
        twin.learn(poses[0].astype(float))
    assert changed, "the term costs nothing in any frame: its row compares zeros"


def _images(world: World) -> np.ndarray:
    """Pictures (V, H, W, 3) of bands of colour: what is higher looks different."""
    random = np.random.default_rng(0)
    shape = len(world.rig), world.rig.height, world.rig.width, 3
    bands = random.integers(0, 256, (8, 3))[np.arange(shape[1]) * 8 // shape[1]]
    return np.clip(bands[:, None] + random.normal(0, 2, shape), 0, 255).astype(np.uint8)


ROWS = [
    pytest.param(term, id=term.name, marks=pytest.mark.parity(*term.parity.kernels))
    for term in TERMS.values()
]


@pytest.mark.parametrize(
    ("kind", "name", "n"),
    [("own", "song31", 1), ("own", "song31", 300), ("own", "stick", 37), ("other", "song31", 37)],
)
@pytest.mark.parametrize("spec", ROWS)
def test_kernels_and_twin(device: Device, spec: TermSpec, kind: str, name: str, n: int) -> None:
    assert_parity(device if kind == "own" else other_kind(device), spec, name, n)


@pytest.mark.parametrize("spec", TERMS.values(), ids=TERMS)
def test_a_term_has_settings_and_is_chosen_by_its_name(spec: TermSpec) -> None:
    default = spec.settings()
    weight = parse_weights(f"edge,{spec.name}")[f"{spec.name}_weight"]
    assert weight == (default.weight or spec.chosen_weight) > 0
    config = FilterConfig.create(**{f"{spec.name}_weight": weight}).likelihood
    assert spec.name in config.terms and config.term_settings(spec.name).weight == weight
    own = spec.launcher.startswith("apf.")
    assert own or default.weight == 0, "an installed package must not change tracks"
