"""A person's own body from outlines: what the take shows is found, the rest stays where it was."""

import numpy as np
import pytest
from helpers import bodies
from helpers.outlines import RIG, outlines_in, outlines_of

from apf.body.kinematics import posed_cones, posed_joints
from apf.body.limbs import add_ankles
from apf.body.model import BodyModel
from apf.body.stature import lowest_point
from apf.initialisation.personal import Outlines, PersonalFit, PersonalShape
from apf.tracking.uncertainty import is_inside_ellipsoid

SONG = add_ankles(bodies.named("song32"))


@pytest.fixture(scope="module")
def taken() -> tuple[PersonalFit, np.ndarray, np.ndarray, list[Outlines]]:
    """Outlines of a person with longer thighs and shorter forearms than the template."""
    fit = PersonalFit(SONG)
    true = np.zeros(len(fit.shape.spread))
    true[fit.shape.index["length", "thigh", 0, 0]] = 0.06
    true[fit.shape.index["length", "forearm", 0, 0]] = -0.06
    poses = SONG.rest_pose + np.random.default_rng(1).normal(0, 0.4, (8, SONG.n_dof))
    poses[:, :3] = SONG.rest_pose[:3]
    poses = np.clip(poses, SONG.lower, SONG.upper)
    cones = posed_cones(fit.shape.body(true), poses)
    poses[:, 2] -= [lowest_point(of) for of in cones]  # they stand on the floor
    cones = posed_cones(fit.shape.body(true), poses)
    return fit, true, poses, [outlines_of(of) for of in cones]


def test_measures_and_poses_are_found(
    taken: tuple[PersonalFit, np.ndarray, np.ndarray, list[Outlines]],
) -> None:
    fit, true, poses, outlines = taken
    tracked = poses + np.random.default_rng(0).normal(0, 0.03, poses.shape)
    measures, covariance = fit.measure(outlines, tracked)
    spread = np.sqrt(np.diag(covariance))
    fitted = fit.pose(measures, outlines, tracked)
    joints = posed_joints(fit.shape.body(true), poses)

    def error(measures: np.ndarray, poses: np.ndarray) -> float:
        found = posed_joints(fit.shape.body(measures), poses)
        return float(np.linalg.norm(found - joints, axis=-1).mean())

    assert error(measures, fitted) < 0.5 * error(0 * measures, tracked)
    assert np.all(spread <= fit.shape.spread + 1e-9)
    lengths = [fit.shape.index["length", name, 0, 0] for name in ("thigh", "forearm")]
    assert measures[lengths[0]] > 0 > measures[lengths[1]]
    assert np.all(spread[lengths] < fit.shape.spread[lengths])
    stated = fit.joint_covariance(measures, covariance, outlines, fitted)
    off = posed_joints(fit.shape.body(measures), fitted) - joints
    assert np.mean(is_inside_ellipsoid(off, stated)) > 0.9
    assert np.sqrt(np.median(np.einsum("fjaa->fja", stated))) < 0.05


def test_without_outlines_nothing_changes() -> None:
    fit, poses = PersonalFit(SONG), SONG.rest_pose[None]
    nothing = [outlines_in(*np.zeros((2, 4, RIG.height, RIG.width), bool))]
    measures, covariance = fit.measure(nothing, poses)
    assert not measures.any() and np.array_equal(np.diag(covariance), fit.shape.spread**2)
    assert np.array_equal(fit.pose(measures, nothing, poses), poses)
    shown = np.zeros((4, RIG.height, RIG.width), bool)
    shown[:, :, :40] = True
    known = np.ones_like(shown)
    assert len(outlines_in(shown, known)) > 100
    known[:, :, 40:] = False
    assert len(outlines_in(shown, known)) == 0


@pytest.mark.parametrize("body", [SONG, bodies.named("wheelchair")], ids=lambda body: body.name)
def test_growths_are_derivatives_of_the_cones(body: BodyModel) -> None:
    shape, random = PersonalShape(body), np.random.default_rng(2)
    measures = random.normal(0, shape.spread)
    poses, step = bodies.random_poses(body, 2), 1e-5
    found, moved = shape.growths(measures, poses), shape.move_joints(measures, poses)
    for number in range(0, shape.n_built, 7):
        move = step * np.eye(len(measures))[number]
        bodies_moved = [shape.body(measures + sign * move) for sign in (1, -1)]
        joints, cones = (
            np.subtract(*(posed(body, poses) for body in bodies_moved)) / (2 * step)
            for posed in (posed_joints, posed_cones)
        )
        np.testing.assert_allclose(moved[number], joints, atol=1e-4)
        np.testing.assert_allclose(found[:, number], cones[..., :8], atol=1e-4)


@pytest.mark.parametrize("name", ["song32", "child", "dog", "wheelchair"])
def test_usual_measures_hardly_turn_the_cones(name: str) -> None:
    shape, random = PersonalShape(bodies.named(name)), np.random.default_rng(3)
    axes = []
    for spread in (0, 1):
        body = shape.body(random.normal(0, spread * shape.spread))
        axes.append([(c.end - c.start) / np.linalg.norm(c.end - c.start) for c in body.cones])
    assert np.all(np.sum(np.prod(axes, axis=0), axis=1) > np.cos(0.5))


def test_soles_stay_on_the_floor() -> None:
    fit = PersonalFit(SONG)
    sunken = SONG.rest_pose[None].copy()
    sunken[0, SONG.dof_names.index("l_foot.ry")] = 0.3  # toes down
    cones = posed_cones(SONG, sunken)
    sunken[0, SONG.dof_names.index("pelvis.tz")] -= lowest_point(cones[0]) + 0.05
    sight = outlines_of(posed_cones(SONG, sunken)[0])
    fitted = fit.pose(np.zeros(len(fit.shape.spread)), [sight], sunken)
    assert lowest_point(posed_cones(SONG, fitted)[0]) > -0.01
