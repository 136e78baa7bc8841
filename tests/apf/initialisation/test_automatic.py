"""The automatic start: shapes fitted to clouds, hypotheses judged, headings told apart."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import bodies
from helpers.scenes import ring

import apf.initialisation.automatic as find
from apf.body.kinematics import posed_cones, posed_joints
from apf.body.model import BodyModel
from apf.body.stature import lowest_point, stature
from apf.body.toml import load_body
from apf.initialisation.automatic import find_start
from apf.initialisation.config import (
    AcceptanceConfig,
    ShapeFitConfig,
    StandingConfig,
    StartConfig,
)
from apf.initialisation.hypotheses import (
    Hypothesis,
    registration_error,
)
from apf.initialisation.kept_voxels import StoredVoxels, select_person_points
from apf.initialisation.shape_fit import Cloud, fit_shape
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


def walking(body: BodyModel, n: int, seed: int = 3) -> np.ndarray:
    """(n, D) poses around rest, limbs a little apart."""
    poses = bodies.random_poses(body, n, seed)
    for name in ("l_upper_arm.rx", "r_upper_arm.rx"):
        poses[:, body.dof_names.index(name)] = 0.35
    return poses


def test_fit_finds_size_lengths_and_girth() -> None:
    model = ShapeModel(SONG)
    true = np.random.default_rng(1).normal(0, 0.7 * model.deviation)
    body = model.body(true)
    poses = walking(SONG, 4)
    clouds = [Cloud(surface(body, pose)) for pose in poses]
    rough = poses + np.random.default_rng(2).normal(0, 0.04, poses.shape)
    shape, found = fit_shape(SONG, clouds, np.zeros(len(true)), rough)
    fitted = model.body(shape)
    start = np.linalg.norm(posed_joints(SONG, rough) - posed_joints(body, poses), axis=-1)
    error = np.linalg.norm(posed_joints(fitted, found) - posed_joints(body, poses), axis=-1)
    assert error.mean() < 0.015 < start.mean() / 2
    assert stature(fitted) == pytest.approx(stature(body), abs=0.02)
    girth = [np.mean([c.radii for c in b.cones]) for b in (fitted, body)]
    assert girth[0] == pytest.approx(girth[1], rel=0.06)


def test_a_known_height_is_kept() -> None:
    pose = walking(SONG, 1)
    cloud = Cloud(surface(SONG, pose[0]))
    zero = np.zeros(len(ShapeModel(SONG).deviation))
    for height in (1.7, 1.8):
        shape, _ = fit_shape(SONG, [cloud], zero, pose, height)
        assert stature(ShapeModel(SONG).body(shape)) == pytest.approx(height, abs=0.015)


def test_feet_that_silhouettes_lost_stand_on_the_floor() -> None:
    height, model = 1.85, ShapeModel(SONG)
    start = np.zeros(len(model.deviation))
    start[0] = np.log(height / stature(SONG))
    body = model.body(start)
    arms = [SONG.dof_names.index(f"{side}_upper_arm.rx") for side in "lr"]
    poses = np.tile(np.clip(np.zeros(SONG.n_dof), SONG.lower, SONG.upper), (3, 1))
    poses[:, arms] += [[0.3, 0.3], [0.5, 0.2], [0.2, 0.6]]
    up = SONG.dof_names.index("pelvis.tz")
    for pose in poses:  # upright, the soles on the floor
        pose[up] -= lowest_point(posed_cones(body, pose[None])[0])
    seen = [surface(body, pose) for pose in poses]
    poses[:, up] += 0.1
    statures = {}
    for reach in (0.3, 0.0):
        config = ShapeFitConfig(standing=StandingConfig(reach=reach))
        clouds = [Cloud(points[points[:, 2] > 0.1], config) for points in seen]
        start[0] = np.log(np.ptp(clouds[0].heights) / stature(SONG))
        shape, _ = fit_shape(SONG, clouds, start, poses, config=config)
        statures[reach] = stature(model.body(shape))
    assert statures[0.3] == pytest.approx(height, abs=0.01)
    assert statures[0.0] < height - 0.02


def test_registration_error_knows_front_and_back_and_contortions() -> None:
    pose = walking(SONG, 1)[0]
    cloud = Cloud(surface(SONG, pose))
    turned = pose.copy()
    turned[SONG.dof_names.index("pelvis.rz")] += np.pi
    lost_arm = pose.copy()
    lost_arm[SONG.dof_names.index("l_upper_arm.rx")] = 2.6
    good = registration_error(SONG, pose, cloud)
    assert good < 0.1
    assert registration_error(SONG, turned, cloud) > good + 0.05
    assert registration_error(SONG, lost_arm, cloud) > good + 0.03


def test_what_speaks_against_a_start() -> None:
    def start(girth: float, rival: float) -> Start:
        body, pose = SONG.scaled({}, girth), SONG.rest_pose
        return Start(body, pose, pose[None], 0.3, rival, 1.3, girth)

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
    cloud = VoxelCloud(grid, np.arange(3, dtype=np.int32), np.ones(3, np.float32), None, 0.0)
    with pytest.raises(StartError, match=r"3 surface voxels of .* expected at least 200"):
        find_start(Scene(device, ring(), grid, SONG), [StoredVoxels(device, cloud)], 0.5)


def test_a_start_that_fits_badly_is_looked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Until one fits, or so many times; the best score counts."""
    grid = VoxelGrid(np.zeros(3), 0.1, (16, 16, 16))
    cloud = VoxelCloud(grid, np.arange(400, dtype=np.int32), np.ones(400, np.float32), None, 0.0)
    shown, shape = [StoredVoxels(Device.best(), cloud)], np.zeros(len(ShapeModel(SONG).deviation))

    def found(*errors: float, attempts: int = 3) -> tuple[float, int]:
        left = list(errors)

        def attempt(_: object) -> object:
            error = left.pop(0)
            hypothesis = Hypothesis(shape, SONG.rest_pose, 1.0, error, 1.0)
            return find.Attempt(find.Fit([hypothesis], cost=-error), np.inf)

        monkeypatch.setattr(find, "run_attempt", attempt)
        scene = Scene(Device.best(), ring(), grid, SONG)
        config = StartConfig(acceptance=AcceptanceConfig(n_attempts=attempts))
        return find_start(scene, shown, 0.5, config=config).registration_error, len(left)

    assert found(0.2, 0.4) == (0.2, 1)
    assert found(0.35, 0.5, 0.4, 0.3) == (0.5, 1)
    assert found(0.4, 0.2, 0.3) == (0.4, 1)
    assert found(0.4, 0.2, attempts=1) == (0.4, 1)
    assert found(0.6, 0.35, 0.5) == (0.5, 0)  # 0.6 is no start, whatever its score
