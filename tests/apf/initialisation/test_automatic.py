"""The automatic start: shapes fitted to clouds, hypotheses and the trackers that judge them."""

import logging

import numpy as np
import pytest
from helpers import bodies
from helpers.scenes import ring
from helpers.worlds import World

from apf.body.kinematics import posed_cones, posed_joints
from apf.body.model import BodyModel
from apf.body.stature import lowest_point, stature
from apf.body.toml import load_body
from apf.filters.config import FilterConfig
from apf.initialisation import automatic
from apf.initialisation.automatic import (
    Hypothesis,
    Trackers,
    find_start,
    forward,
    refit_start,
    select_distinct,
    standing_pose,
    walking_factor,
)
from apf.initialisation.body_fit import Cloud, Fitted, SurfaceEvidence, fit_body
from apf.initialisation.kept_voxels import StoredVoxels, select_person_points
from apf.initialisation.shape_model import ShapeModel, place_points, surface_samples
from apf.initialisation.start import Start, StartError
from apf.scene import Scene
from cl import Device
from psfs.common.cones import cone_distances
from psfs.voxels.grid import VoxelCloud, VoxelGrid

SONG = load_body("song31")


def surface(body: BodyModel, pose: np.ndarray, spacing: float = 0.02) -> np.ndarray:
    """Points (N, 3) on the outside of the posed body."""
    cones = posed_cones(body, pose[None])[0]
    cone, coordinates = surface_samples(body, spacing)
    points = place_points(cones[cone], coordinates)
    depth = cone_distances(points, cones)
    depth[np.arange(len(cone)), cone] = np.inf
    return points[depth.min(1) > 0]


def cloud_of(grid: VoxelGrid, points: np.ndarray) -> VoxelCloud:
    """The voxels of a grid that hold points (N, 3)."""
    ijk = np.floor((points - grid.origin) / grid.voxel_size).astype(int)
    return stored(grid, np.unique(np.ravel_multi_index(tuple(ijk.T), grid.shape)))


def stored(grid: VoxelGrid, indices: np.ndarray) -> VoxelCloud:
    return VoxelCloud(grid, indices.astype(np.int32), np.ones(len(indices), np.float32), None, 0.0)


def walking(body: BodyModel, n: int, seed: int = 3) -> np.ndarray:
    """(n, D) poses around rest, limbs a little apart."""
    poses = bodies.random_poses(body, n, seed)
    for name in ("l_upper_arm.rx", "r_upper_arm.rx"):
        poses[:, body.dof_names.index(name)] = 0.35
    return poses


def fit_shape(
    clouds: list[Cloud], shape: np.ndarray, poses: np.ndarray, height: float | None = None
) -> tuple[BodyModel, np.ndarray]:
    """The body and the poses that fit the clouds."""
    model, free = ShapeModel(SONG), np.ones(len(shape), bool)
    found = fit_body(model, SurfaceEvidence(clouds), Fitted(shape, poses), free=free, height=height)
    return model.body(found.shape), found.poses


def test_growths_are_the_derivatives_by_the_scales() -> None:
    model = ShapeModel(SONG)
    shape, poses = np.random.default_rng(1).normal(0, 0.1, len(model.deviation)), walking(SONG, 2)
    grown = [[model.body(shape + d) for d in (step, -step)] for step in 1e-5 * np.eye(len(shape))]
    expected = [posed_cones(a, poses) - posed_cones(b, poses) for a, b in grown]
    body = model.body(shape)
    found = model.growths(body, poses, posed_cones(body, poses))
    np.testing.assert_allclose(found, np.stack(expected, 1)[..., :8] / 2e-5, atol=1e-8)


def test_fit_finds_size_lengths_and_girth() -> None:
    model = ShapeModel(SONG)
    true = np.random.default_rng(1).normal(0, 0.7 * model.deviation)
    body = model.body(true)
    poses = walking(SONG, 4)
    clouds = [Cloud(surface(body, pose)) for pose in poses]
    rough = poses + np.random.default_rng(2).normal(0, 0.04, poses.shape)
    fitted, found = fit_shape(clouds, np.zeros(len(true)), rough)
    start, error = (
        np.linalg.norm(posed_joints(*each) - posed_joints(body, poses), axis=-1).mean()
        for each in ((SONG, rough), (fitted, found))
    )
    assert error < 0.015 < start / 2
    assert stature(fitted) == pytest.approx(stature(body), abs=0.02)
    girth = [np.mean([c.radii for c in b.cones]) for b in (fitted, body)]
    assert girth[0] == pytest.approx(girth[1], rel=0.06)


def test_a_known_height_is_kept() -> None:
    pose = walking(SONG, 1)
    cloud = Cloud(surface(SONG, pose[0]))
    zero = np.zeros(len(ShapeModel(SONG).deviation))
    for height in (1.7, 1.8):
        fitted, _ = fit_shape([cloud], zero, pose, height)
        assert stature(fitted) == pytest.approx(height, abs=0.015)


def test_feet_that_silhouettes_lost_stand_on_the_floor() -> None:
    height, model = 1.85, ShapeModel(SONG)
    start = np.zeros(len(model.deviation))
    start[0] = np.log(height / stature(SONG))
    body = model.body(start)
    upright = np.tile(np.clip(np.zeros(SONG.n_dof), SONG.lower, SONG.upper), (3, 1))
    left, right = np.array([[0.3, 0.5, 0.2], [0.3, 0.2, 0.6]])
    poses = bodies.bent(SONG, upright, l_upper_arm__rx=left, r_upper_arm__rx=right)
    up = SONG.dof_names.index("pelvis.tz")
    for pose in poses:  # upright, the soles on the floor
        pose[up] -= lowest_point(posed_cones(body, pose[None])[0])
    seen = [surface(body, pose) for pose in poses]
    poses[:, up] += 0.1
    clouds = [Cloud(points[points[:, 2] > 0.1]) for points in seen]
    start[0] = np.log(np.ptp(clouds[0].heights) / stature(SONG))
    fitted, _ = fit_shape(clouds, start, poses)
    assert stature(fitted) == pytest.approx(height, abs=0.01)


def test_hypotheses_that_go_on_look_in_different_directions() -> None:
    def looking(degrees: float, badly: float) -> Hypothesis:
        pose = bodies.bent(SONG, pelvis__rz=np.radians(degrees))
        return Hypothesis(np.zeros(1), pose[None], 0.1, badly, 0)

    every = [looking(a, b) for a, b in ((0, 3), (20, 1), (190, 4), (150, 2), (250, 5))]
    assert [h.cost for h in select_distinct(SONG, every, 0.8)] == [1, 2, 5]
    np.testing.assert_allclose(forward(SONG, looking(90, 0).poses), [[0, 1]], atol=1e-12)


def test_a_start_is_in_its_best_frame(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    shape, poses = np.zeros(len(ShapeModel(SONG).deviation)), np.tile(SONG.rest_pose, (8, 1))
    fits = [Hypothesis(shape, poses, 0.1, cost, best) for cost, best in ((1.0, 3), (2.0, 5))]
    anchors = list[int]()

    def follow(self: object, hypotheses: list[Hypothesis], anchor: int) -> list[Hypothesis]:
        anchors.append(anchor)
        return hypotheses

    cloud = Cloud(surface(SONG, SONG.rest_pose))
    monkeypatch.setattr(automatic, "_select_observations", lambda *of: ([], [cloud] * 8))
    monkeypatch.setattr(automatic._Search, "try_headings", lambda *of: (7, fits))
    monkeypatch.setattr(automatic._Search, "follow", follow)
    grid = VoxelGrid.covering(np.zeros(3), np.ones(3), 0.1)
    start = find_start(Scene(device, ring(3), grid, SONG), [], 1.0)
    assert anchors == [7] and start.best == 3


def test_a_body_is_fitted_to_frames_all_over_the_take() -> None:
    model, grid = ShapeModel(SONG), VoxelGrid.covering(-np.ones(3), np.array([1, 1, 2.2]), 0.02)
    true = np.random.default_rng(1).normal(0, 0.7 * model.deviation)
    poses = walking(SONG, 4)
    clouds = [cloud_of(grid, surface(model.body(true), pose)) for pose in poses]
    clouds.insert(1, cloud_of(grid, np.zeros((1, 3))))  # nobody is seen
    start = Start(SONG, np.zeros(len(true)), poses[:1], (7,), 0, 1.5, 1.7)
    tracked = np.insert(poses, 1, poses[0], axis=0)
    errors = np.array([3.0, 0.0, 2.0, 1.0, 4.0])
    refitted = refit_start(SONG, start, tracked, range(10, 15), clouds, errors)
    assert stature(refitted.body) == pytest.approx(stature(model.body(true)), abs=0.03)
    assert refitted.frames == [10, 12, 13, 14] and refitted.frame == 13 and refitted.rival == 1.5
    points = [select_person_points(grid, cloud.indices) for cloud in (clouds[0], *clouds[2:])]
    heights = [np.ptp(Cloud(each).heights) for each in points]
    assert refitted.seen == pytest.approx(np.median(heights))
    nobody = refit_start(SONG, start, tracked[:1], [7], clouds[1:2], errors[:1])
    np.testing.assert_array_equal(nobody.shape, start.shape)


def test_people_look_where_they_go() -> None:
    pose = SONG.rest_pose[None]  # looks along x
    factors = [walking_factor(SONG, pose, np.array(way)) for way in ((0.5, 0), (0, 0.5), (-0.5, 0))]
    assert pytest.approx(factors[0]) == 1 and factors[0] < factors[1] < factors[2]
    assert walking_factor(SONG, pose, np.array([-0.1, 0.0])) == 1
    turning = np.array([[0.5, 0.0], [-0.5, 0.0], [-0.2, 0.0]])
    assert walking_factor(SONG, np.tile(pose, (3, 1)), turning) == pytest.approx(factors[1])


def test_standing_on_the_floor() -> None:
    pose = SONG.rest_pose.copy()
    pose[:3] += [2.0, -1.0, 0.6]
    points = surface(SONG, pose)
    stood = standing_pose(SONG, Cloud(points), np.pi / 3)
    np.testing.assert_allclose(stood[:3], pose[:3], atol=0.06)
    np.testing.assert_allclose(forward(SONG, stood[None])[0], [0.5, np.sqrt(0.75)], atol=1e-9)
    points = surface(SONG, SONG.rest_pose)
    lowest = points[:, 2].min()
    for above, stands in ((0.0, True), (0.25, True), (0.5, False), (-0.5, False)):
        cloud = Cloud(points + np.array([0, 0, above - lowest]))
        assert cloud.on_floor == stands
        assert (cloud.heights[0] == 0.0) == stands


def test_what_speaks_against_a_start() -> None:
    def start(girth: float, rival: float) -> Start:
        shape = np.zeros(len(ShapeModel(SONG).deviation))
        shape[1] = np.log(girth * 1.3 / stature(SONG))
        return Start(SONG, shape, SONG.rest_pose[None], (0,), 0, rival, 1.3)

    assert start(1.0, np.inf).doubts == start(0.5, 1.5).doubts == start(1.4, 2.0).doubts == []
    (doubt,) = start(2.0, 1.5).doubts
    assert "fits badly" in doubt and "1.30 m high and 2.0 times as thick" in doubt
    (doubt,) = start(1.0, 1.02).doubts
    assert "the heading is ambiguous" in doubt


def test_debris_is_no_person() -> None:
    filled = np.zeros((20, 20, 20), bool)
    filled[2:8, 2:8, 2:16] = True
    filled[12:17, 12:17, 2:9] = True  # the other half of a cloud that is cut in two
    filled[18, 1:3, 1:3] = True
    filled[3:6, 3:6, 17:19] = True  # the head of a person without a neck
    filled[12:14, 3:6, 17:19] = True  # as large, but elsewhere
    grid = VoxelGrid(np.zeros(3), 0.05, filled.shape)
    points = select_person_points(grid, np.flatnonzero(filled).astype(np.int32))
    assert len(points) == 6 * 6 * 14 + 5 * 5 * 7 + 3 * 3 * 2
    assert len(select_person_points(grid, np.zeros(0, np.int32))) == 0


def test_nobody_there() -> None:
    device = Device.best()
    grid = VoxelGrid(np.zeros(3), 0.1, (8, 8, 8))
    cloud = stored(grid, np.arange(3))
    with pytest.raises(StartError, match=r"3 surface voxels of .* expected at least 200"):
        find_start(Scene(device, ring(), grid, SONG), [StoredVoxels(device, cloud)], 0.5)


FEW = FilterConfig.create(n_particles=37, n_layers=1)


def test_a_tracker_serves_the_next_body(device: Device, caplog: pytest.LogCaptureFixture) -> None:
    """And no kernel is built for it."""
    world = World(device)
    body, trackers = world.body, Trackers(world.scene())
    first = trackers(body, FEW)
    for other in (body, body.scaled(dict.fromkeys(body.scale_groups, 1.2), 1.2)):
        assert trackers(other, FEW) is first and first.body is other
        caplog.clear()
        with caplog.at_level(logging.INFO, "cl.device"):
            first.start(world.pose(0))
            first.step(world.voxels(0))
    assert not [record for record in caplog.records if "built" in record.message]
    assert trackers(other, FEW.with_changes(n_particles=38)) is not first


def test_kept_voxels_are_observed_once() -> None:
    device = Device.best(profile=True)
    world = World(device)
    clouds = [stored(world.grid, world.twin(frame).surface) for frame in range(2)]
    kept = [StoredVoxels(device, cloud) for cloud in clouds]
    tracker, poses = Trackers(world.scene())(world.scene().body, FEW), []
    assert device.profiler is not None
    for shown, n_splats in ((0, 1), (0, 0), (1, 1), (0, 1)):
        device.profiler.clear()
        tracker.start(world.pose(0))
        poses.append(tracker.step(kept[shown]).pose)
        assert len(device.profiler.collect().get("splat", ())) == n_splats
    np.testing.assert_array_equal(poses[1::2], [poses[0]] * 2)
    assert not np.array_equal(poses[0], poses[2])
