"""Rendered bodies and image objectives: known answers, and the kernels against their twins."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers import bodies, likelihoods, rendered, scenes
from helpers.bodies import cone
from helpers.kinds import other_kind

from apf.body.toml import load_body
from apf.image_objective.config import OBJECTIVE_KINDS, ObjectiveConfig
from apf.image_objective.objective import ImageObjective
from apf.image_objective.renderer import cone_edges
from apf.reference.image_objective.objective import NumpyImageObjective, objective_values
from apf.reference.image_objective.render import flat_body
from apf.scene import Scene
from cl import Device, NumpyDevice

#: As `likelihoods.FRONT`, with the principal point a quarter of a pixel further.
FRONT = replace(likelihoods.FRONT, K=np.array([[200.0, 0, 50.25], [0, 200, 60.25], [0, 0, 1]]))


def drawn(cones: list[np.ndarray], free: tuple[bool, bool] = (False, False), **more: bool) -> Any:
    """Parts and edges that FRONT sees, with edges."""
    n = len(cones)
    return flat_body(FRONT, np.stack(cones), np.ones(n, bool), np.array([free] * n), **more)


UPRIGHT = cone([0, 0, -0.3], [0, 0, 0.3])


def test_a_cone_is_a_rectangle_with_two_edges() -> None:
    parts, edges = drawn([UPRIGHT], round_ends=False)
    rows, columns = np.nonzero(parts)
    assert (columns.min(), columns.max(), rows.min(), rows.max()) == (41, 60, 31, 90)
    assert parts.sum() == 20 * 60
    assert (np.unique(np.nonzero(edges)[1]) == [41, 60]).all()
    assert edges.sum() == 2 * 60
    hidden = flat_body(FRONT, UPRIGHT[None], np.zeros(1, bool), np.ones((1, 2), bool))
    assert not hidden[1].any()
    parts, edges = drawn([UPRIGHT], (False, True), round_ends=True)
    assert parts.sum() == pytest.approx(20 * 60 + np.pi * 10**2, rel=0.02)
    rows, _ = np.nonzero(parts)
    assert (rows.min(), rows.max()) == (21, 100)
    assert edges[21, 50]  # the upper end
    assert not edges[100, 50]
    assert not edges[22:95, 50].any()  # no line where the end begins


def test_near_parts_hide_far_ones_and_their_edges() -> None:
    across = cone([0.2, -0.3, 0], [0.2, 0.3, 0])
    for order in ([0, 1], [1, 0]):
        parts, edges = drawn([(UPRIGHT, across)[k] for k in order])
        assert parts[60, 50] == 1 + order.index(1)
        assert parts[40, 50] == 1 + order.index(0)
        assert edges[40, 41]
        assert not edges[60, 41]


@pytest.mark.parametrize("round_ends", [False, True])
def test_a_cone_seen_along_its_axis_is_a_disc(round_ends: bool) -> None:
    parts, edges = drawn([cone([0, 0, 0], [0.1, 0, 0])], round_ends=round_ends)
    radius = 0.1 * 200 / 1.9  # of the nearer end
    assert parts.sum() == pytest.approx(np.pi * radius**2, rel=0.05)
    assert 0.8 < edges.sum() / (2 * np.pi * radius) < 1.4
    assert not edges[60, 50]


def test_ends_are_free_where_no_other_cone_is() -> None:
    body = load_body("song31")
    _, free = cone_edges(body)
    ends = dict(zip(body.cone_names, free.tolist(), strict=True))
    assert ends["head"] == [False, True]
    assert ends["l_forearm"] == ends["r_forearm"] == [False, True]
    assert ends["l_thigh"] == ends["torso"] == [False, False]


@pytest.mark.parity("image/parts.place_parts", "image/render.count_pixels")
@pytest.mark.parametrize("round_ends", [True, False])
@pytest.mark.parametrize(
    ("name", "size", "n"),
    [("song31", (64, 51), 8), ("song31", (333, 240), 3), ("stick", (161, 123), 4)],
)
def test_pictures_equal_the_twins(
    device: Device, name: str, size: tuple[int, int], n: int, round_ends: bool
) -> None:
    body, rig = bodies.named(name), scenes.ring(3, size)
    poses = bodies.scattered_poses(body, n)
    rendered.check_pictures(device, body, rig, poses, round_ends=round_ends)


def test_a_gpus_work_groups_draw_the_same(device: Device) -> None:
    """On any device: one row per work-item, many items per picture."""
    device = device if device.is_gpu else other_kind(device)
    body, rig = bodies.named("song31"), scenes.ring(2, (333, 240))
    rendered.check_pictures(device, body, rig, bodies.scattered_poses(body, 6))
    rendered.check_counts(device, body, rig, bodies.scattered_poses(body, 6))


@pytest.mark.parity(
    "image/objective.pack_maps", "image/objective.silhouette_areas", "image/objective.score_counts"
)
@pytest.mark.parametrize("kind", OBJECTIVE_KINDS)
def test_errors_equal_the_twins(device: Device, kind: str) -> None:
    body, rig = load_body("song31"), scenes.ring(3, (161, 123))
    config = ObjectiveConfig(kind=kind, silhouette_weight=0.7, edge_weight=0.3, balance=0.4)
    observed = rendered.random_maps(rig)
    poses = bodies.scattered_poses(body, 9)
    objective = ImageObjective(Scene(device, rig, None, body), 9, config)
    twin = NumpyImageObjective(Scene(NumpyDevice(), rig, None, body), 9, config)
    twin.observe(observed)
    expected = twin(poses)
    for _ in range(2):  # what is left of a frame does not reach the next
        objective.observe(rendered.random_maps(rig, seed=1).on(device))
        objective.observe(observed.on(device))
        np.testing.assert_allclose(
            rendered.score_poses(device, objective, poses), expected, atol=2e-3
        )
    assert np.ptp(expected) > 0.01


def test_the_five_functions_by_hand() -> None:
    """Two cameras: f1 = 0.5 and 1, f2 = 0.25 and 1."""
    counts = np.array([[[8, 2 * 255, 10, 5]], [[4, 4 * 255, 6, 6]]], float)
    first, second = 11 / 16, 6 / 12
    for kind, value in (
        ("ws", 0.6 * first + 0.4 * second),
        ("sp", first**0.6 * second**0.4),
        ("aows", (0.6 * 0.5 + 0.4 * 0.25 + 1) / 2),
        ("aosp", (0.5**0.6 * 0.25**0.4 + 1) / 2),
        ("posp", 0.5**0.6 * 0.25**0.4),
    ):
        config = ObjectiveConfig(kind=kind, silhouette_weight=0.6, edge_weight=0.4)
        assert objective_values(counts, np.array([10.0, 6]), config)[0] == pytest.approx(value)
    counts, areas = np.zeros((2, 1, 4)), np.zeros(2)
    for kind in OBJECTIVE_KINDS:
        config = ObjectiveConfig(kind=kind)
        assert objective_values(counts, areas, config) == 0
        assert objective_values(counts, areas + 5, config) == 0
