"""A handle that turns a limb: all that hangs on it turns about the joint before."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import tracks
from scipy.spatial.transform import Rotation

pytest.importorskip("viser", reason="viser is not installed")

import viser

from apf.report.drawing import Figure
from apf.studio.correct_panel import CorrectPanel, JointHandle
from apf.synthetic.config import SceneConfig
from apf.synthetic.scene import make_rig
from apf.tracking.retracking import correct_pose
from cl import InputError
from psfs.page.nodes import to_quaternion
from psfs.page.server import Gate, start_server, stop_server


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    server = start_server(0, Gate())
    yield server
    stop_server(server)


def test_limb_turns_about_the_joint_before(server: viser.ViserServer) -> None:
    track = tracks.walker(5)
    places = {name: track.joints[2, k] for k, name in enumerate(track.joint_names)}
    handle = JointHandle(server.scene, track, 2, "l_elbow", turns=True, moved=lambda: None)
    start = handle.wanted
    assert {"l_elbow", "l_wrist"} <= set(start) and "l_shoulder" not in start
    for name, point in start.items():
        assert np.allclose(point.position, places[name], atol=1e-6)
    quarter, small = Rotation.from_rotvec([[np.pi / 2, 0, 0], [0.2, 0, 0]]).as_matrix()
    handle._node.wxyz = to_quaternion(quarter)
    pivot = places["l_shoulder"]
    for name, point in handle.wanted.items():
        assert np.allclose(point.position, pivot + quarter @ (places[name] - pivot), atol=1e-6)
    handle._node.wxyz = to_quaternion(small)
    pose = correct_pose(track.its_body, track.poses[2], handle.wanted)
    assert np.abs(pose - track.poses[2]).max() > 0.05  # the arm follows
    handle.remove()
    with pytest.raises(InputError, match="expected a joint of a limb"):
        JointHandle(server.scene, track, 1, "pelvis", turns=True, moved=lambda: None)


def test_clicks_in_pictures_of_two_frames_are_not_combined(server: viser.ViserServer) -> None:
    track, rig = tracks.walker(5), make_rig(SceneConfig(cameras=3))
    opened = SimpleNamespace(
        track=track, tracks={"walk": track}, people=1,
        figures={"walk": Figure(track, seen=np.arange(4))},
        sequence=SimpleNamespace(rig=rig), folder=Path("walk"),
    )  # fmt: skip
    drawn: list[np.ndarray] = []
    line = SimpleNamespace(seek=lambda position: None, position=2, refresh=drawn.clear)
    shown = {"walk": SimpleNamespace(show_pose=drawn.append)}
    watch = SimpleNamespace(opened=opened, frame=2, time_line=line, bodies=shown)
    said: list[object] = []
    panel = CorrectPanel(server, lambda flags, count: None, said.append)
    panel.offer(watch)  # type: ignore[arg-type]
    panel.joint.value, panel.way.value = "left wrist", "clicking it in two pictures"
    place = track.joints[3, track.joint_names.index("l_wrist")] + 0.05

    def click(view: int, frame: int) -> None:
        watch.frame = frame
        panel.point(view, place - rig.centres[view])

    panel.toggle_handle()
    click(0, 2)
    click(1, 2)
    assert drawn and panel.cancel.visible
    panel.put_back()
    assert not drawn and not panel.cancel.visible
    panel.toggle_handle()
    click(0, 2)
    click(1, 3)
    assert not drawn and panel.corrections is not None
    click(2, 4)
    assert said == ["frame 4 was not tracked; expected one that was"]
    click(0, 3)
    assert drawn
    watch.frame = 1
    drawn.clear()
    panel.move_handle(place)
    assert not drawn  # the body of another frame stays as it was
    panel.toggle_handle()
    (point,) = panel.corrections.point
    assert (point.frame, point.joint) == (3, "l_wrist")
    np.testing.assert_allclose(point.position, place, atol=1e-6)
