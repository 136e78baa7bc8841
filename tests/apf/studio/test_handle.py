"""A handle that turns a limb: all that hangs on it turns about the joint before."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from helpers import tracks

pytest.importorskip("viser", reason="viser is not installed")

import viser

from apf.studio.handle import JointHandle
from apf.tracking.correction import correct_pose
from cl import InputError
from psfs.page.gate import Gate, start_server, stop_server


@pytest.fixture(scope="module")
def scene() -> Iterator[viser.SceneApi]:
    server = start_server(0, Gate())
    yield server.scene
    stop_server(server)


def test_limb_turns_about_the_joint_before(scene: viser.SceneApi) -> None:
    track = tracks.walker(5)
    places = {name: track.joints[2, k] for k, name in enumerate(track.joint_names)}
    handle = JointHandle(scene, track, 2, "l_elbow", turns=True, moved=lambda: None)
    start = handle.wanted
    assert {"l_elbow", "l_wrist"} <= set(start) and "l_shoulder" not in start
    for name, point in start.items():
        assert np.allclose(point.position, places[name], atol=1e-6)
    quarter = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    handle.turn(quarter)
    pivot = places["l_shoulder"]
    for name, point in handle.wanted.items():
        assert np.allclose(point.position, pivot + quarter @ (places[name] - pivot), atol=1e-6)
    small = np.array([[1.0, 0, 0], [0, np.cos(0.2), -np.sin(0.2)], [0, np.sin(0.2), np.cos(0.2)]])
    handle.turn(small)
    pose = correct_pose(track.its_body, track.poses[2], handle.wanted)
    assert np.abs(pose - track.poses[2]).max() > 0.05  # the arm follows
    handle.remove()


def test_handle_drags_one_joint(scene: viser.SceneApi) -> None:
    handle = JointHandle(scene, tracks.walker(5), 1, "l_wrist", turns=False, moved=lambda: None)
    handle.move(np.array([0.1, 0.2, 0.3]))
    wanted = handle.wanted
    assert list(wanted) == ["l_wrist"] and wanted["l_wrist"].frame == 1
    assert np.allclose(wanted["l_wrist"].position, (0.1, 0.2, 0.3))
    handle.remove()


def test_root_is_not_turned(scene: viser.SceneApi) -> None:
    track = tracks.walker(5)
    ends = {int(b) for _, b in track.edges}
    root = next(name for k, name in enumerate(track.joint_names) if k not in ends)
    with pytest.raises(InputError, match="expected a joint of a limb"):
        JointHandle(scene, track, 1, root, turns=True, moved=lambda: None)
