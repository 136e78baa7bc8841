"""Corrections by hand: their file, where cameras would see them, what they change of a track."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import bodies, tracks
from helpers.scenes import ring

from apf.body.kinematics import posed_joints
from apf.body.toml import load_body
from apf.filters.base import Estimate
from apf.tracking.retracking import (
    ERROR,
    Correction,
    Corrections,
    correct_pose,
    find_courses,
    hold_corrections,
    mark_bad,
    observe_corrections,
    read_corrections,
    splice_estimates,
    write_corrections,
)
from cl import InputError

SONG = load_body("song31")
WRIST = SONG.joint_names.index("l_wrist")
POINT = Correction(12, "l_wrist", (0.1, 0.2, 0.3), 0.03)


def test_file_gives_back_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "corrections.toml"
    stated = Corrections(Path("walk"), (POINT, Correction(3, "l_elbow", (1, 2, 3))), ((4, 6),), 0.7)
    write_corrections(path, stated)
    assert read_corrections(path) == replace(stated, track=tmp_path / "walk")
    lines = stated.describe()
    assert lines == [
        "corrected by hand in frame 3: left elbow",
        "corrected by hand in frame 12: left wrist",
        "marked as bad by hand: frames 4-6",
    ]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("reach = 1.0", "track"),
        ('track = "a"\nbad = [[1]]', "bad"),
        ('track = "a"\n[[point]]\nframe = -1\njoint = "x"\nposition = [0.0, 0.0, 0.0]', "frame"),
        ('track = "a"\n[[point]]\nframe = 1\njoint = "x"\nposition = [0.0, 0.0]', "position"),
        ('track = "a"\npoints = 3', "points"),
    ],
)
def test_faulty_files_are_refused_by_name(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / "corrections.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"corrections\.toml.*{problem}"):
        read_corrections(path)


def test_cameras_would_see_the_corrected_joint_there() -> None:
    rig = ring()
    found = observe_corrections(SONG, rig, {"l_wrist": POINT})
    assert len(found) == len(rig) and found.bone.tolist() == [SONG.joints[WRIST].bone]
    for view, camera in enumerate(rig):
        depth = (camera.R @ POINT.position + camera.t)[2]
        moved = camera.R.T @ np.array([POINT.error, 0, 0]) + POINT.position
        (seen, beside), _ = camera.project(np.stack([POINT.position, moved]))
        seen, beside = camera.undistort(np.stack([seen, beside]))
        assert np.allclose(found.pixel[view], seen, atol=1e-3) and depth > 0
        assert found.inverse_scale[view] * np.linalg.norm(beside - seen) == pytest.approx(
            1, rel=0.02
        )


def test_limb_alone_follows_its_joint() -> None:
    """It is held within the error of its correction."""
    pose = SONG.rest_pose
    before = posed_joints(SONG, pose[None])[0]
    goal = before[WRIST] + (0.15, 0.1, 0.1)
    exact, loose, near = (
        {"l_wrist": Correction(0, "l_wrist", tuple(goal), error)} for error in (ERROR, 0.3, 0.03)
    )
    after = posed_joints(SONG, correct_pose(SONG, pose, exact)[None])[0]
    assert np.linalg.norm(after[WRIST] - goal) < 0.01
    others = [i for i, name in enumerate(SONG.joint_names) if not name.startswith("l_")]
    assert np.allclose(after[others], before[others], atol=1e-9)
    assert np.array_equal(hold_corrections(SONG, pose, loose), pose)
    held = posed_joints(SONG, hold_corrections(SONG, pose, near)[None])[0][WRIST]
    assert np.linalg.norm(held - goal) == pytest.approx(0.03, abs=0.005)


def test_courses_end_midway_between_corrected_frames() -> None:
    track = tracks.walker(60, fps=60.0)
    points = (replace(POINT, frame=10), replace(POINT, frame=20), replace(POINT, frame=50))
    courses = list(find_courses(track, Corrections(Path(), points, reach=0.1)))
    assert courses == [(10, 4), (10, 15), (20, 15), (20, 26), (50, 44), (50, 56)]


def test_new_stretch_fades_into_the_track() -> None:
    track = tracks.walker(30)
    raised = bodies.bent(SONG, track.poses, pelvis__tz=0.3)
    known = np.full(SONG.n_dof, 0.1), *(3 * [np.zeros(4)]), np.eye(SONG.n_dof)
    found = {frame: Estimate(SONG, raised[frame], *known) for frame in range(8, 20)}
    new = splice_estimates(track, found, [12])
    lifted = (new.poses - track.poses)[:, SONG.dof_names.index("pelvis.tz")]
    assert np.allclose(lifted[[7, 8, 9, 10, 11, 12, 17, 18, 19, 20]] / 0.3,
                       [0, 0.25, 0.5, 0.75, 1, 1, 0.75, 0.5, 0.25, 0])  # fmt: skip
    outside = np.r_[0:8, 20:30]
    assert np.array_equal(new.poses[outside], track.poses[outside])
    assert np.allclose(new.joints, posed_joints(SONG, new.poses))
    assert np.array_equal(new.diagnostics["ess"][outside], track.diagnostics["ess"][outside])


def test_bad_frames_are_lost_and_not_all_may_be() -> None:
    track = mark_bad(tracks.walker(10), Corrections(Path(), (), ((2, 3), (3, 5))))
    assert np.flatnonzero(track.lost).tolist() == [2, 3, 4, 5]
    assert np.isnan(track.points.joints[4]).all() and np.isfinite(track.points.joints[6]).all()
    with pytest.raises(InputError, match="all frames"):
        mark_bad(tracks.walker(10), Corrections(Path(), (), ((0, 9),)))
