"""Poses that are sent, by receivers written from the protocols' public descriptions."""

import json
import socket
import struct
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from apf.body.kinematics import posed_joints
from apf.body.toml import load_body
from apf.filters.base import Estimate
from apf.formats.skeleton import TO_Y_UP, build_skeleton
from apf.live.send import PORTS, SentPose, name_for_unity, open_senders, parse_target
from cl import InputError

BODY = load_body("song32")


@pytest.fixture
def pose() -> SentPose:
    """Two people in postures with all limbs bent."""
    rng = np.random.default_rng(0)
    poses = [BODY.rest_pose + rng.uniform(-0.4, 0.4, BODY.n_dof) for _ in range(2)]
    none = np.zeros(1)
    estimates = [Estimate(BODY, p, none, none, none, none, lost=k > 0) for k, p in enumerate(poses)]
    return SentPose(7, 1.25, estimates)


def joints_of(pose: SentPose, person: int) -> np.ndarray:
    return posed_joints(BODY, pose.estimates[person].pose[None])[0]


def decode_osc(packet: bytes) -> Iterator[tuple[Any, ...]]:
    """Yield address and values of the messages of an OSC 1.0 packet."""
    if packet.startswith(b"#bundle\0"):
        at = 16  # behind the time tag
        while at < len(packet):
            (size,) = struct.unpack_from(">i", packet, at)
            yield from decode_osc(packet[at + 4 : at + 4 + size])
            at += 4 + size
        return

    def text(at: int) -> tuple[str, int]:
        end = packet.index(b"\0", at)
        return packet[at:end].decode(), end + 4 - end % 4

    address, at = text(0)
    tags, at = text(at)
    values: list[Any] = []
    for tag in tags[1:]:
        if tag == "s":
            value, at = text(at)
        else:
            ((value,), at) = struct.unpack_from(f">{tag}", packet, at), at + 4
        values.append(value)
    yield (address, *values)


@pytest.fixture
def receivers() -> Iterator[list[socket.socket]]:
    """Two neighbouring UDP ports."""
    for port in range(39700, 39800, 2):
        sockets = [socket.socket(type=socket.SOCK_DGRAM) for _ in range(2)]
        try:
            for k, one in enumerate(sockets):
                one.bind(("127.0.0.1", port + k))
                one.settimeout(60)
        except OSError:
            continue
        yield sockets
        for one in sockets:
            one.close()
        return


def test_a_vmc_receiver_sees_the_pose(pose: SentPose, receivers: list[socket.socket]) -> None:
    """Bones placed one in the other, in Unity's axes, lie where the tracker has the joints."""
    pytest.importorskip("pythonosc")
    with open_senders([f"vmc:{receivers[0].getsockname()[1]}"], [BODY, BODY]) as (sender,):
        sender.send(pose)
    for person, receiver in enumerate(receivers):
        packets = [receiver.recv(65536) for _ in range(2)]
        assert max(map(len, packets)) < 1500
        messages = [message for packet in packets for message in decode_osc(packet)]
        assert ("/VMC/Ext/OK", 1) in messages and ("/VMC/Ext/T", 1.25) in messages
        bones = {m[1]: np.array(m[2:]) for m in messages if m[0] == "/VMC/Ext/Bone/Pos"}
        assert {"Hips", "Spine", "Head", "LeftUpperArm", "RightLowerLeg"} <= set(bones)
        joints = joints_of(pose, person) @ TO_Y_UP.T * [-1, 1, 1]
        known = dict(zip(BODY.joint_names, joints, strict=True))
        for joint, bone in (("l_elbow", "LeftLowerArm"), ("r_knee", "RightLowerLeg")):
            np.testing.assert_allclose(place_bone(bone, bones), known[joint], atol=1e-5)


def place_bone(name: str, bones: dict[str, np.ndarray]) -> np.ndarray:
    """Return where a bone begins, by the bones above it."""
    nodes = build_skeleton(BODY).nodes
    parents = {name_for_unity(n.name): name_for_unity(nodes[n.parent].name) for n in nodes[1:]}
    point = np.zeros(3)
    while name in bones:
        point = bones[name][:3] + Rotation.from_quat(bones[name][3:]).apply(point)
        name = parents.get(name, "")
    return point


def test_osc(pose: SentPose, receivers: list[socket.socket]) -> None:
    pytest.importorskip("pythonosc")
    port = receivers[0].getsockname()[1]
    with open_senders([f"osc:127.0.0.1:{port}"], [BODY, BODY]) as (sender,):
        sender.send(pose)
    messages: dict[str, Any] = {}
    for _ in range(2):
        messages |= {address: v for address, *v in decode_osc(receivers[0].recv(65536))}
    assert messages["/apf/person1/lost"] == [0] and messages["/apf/person2/lost"] == [1]
    found = [messages[f"/apf/person2/{name}"] for name in BODY.joint_names]
    np.testing.assert_allclose(found, joints_of(pose, 1), atol=1e-5)


def test_websocket(pose: SentPose) -> None:
    client = pytest.importorskip("websockets.sync.client")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with open_senders([f"websocket:{port}"], [BODY, BODY]) as (sender,):
        sender.send(replace(pose, frame=6))
        with client.connect(f"ws://127.0.0.1:{port}", open_timeout=60) as page:
            sent_before = json.loads(page.recv(timeout=60))
            sender.send(pose)
            found = json.loads(page.recv(timeout=60))
    assert sent_before["frame"] == 6
    assert found["frame"] == 7 and [one["lost"] for one in found["people"]] == [False, True]
    sent = [found["people"][0]["joints"][name] for name in BODY.joint_names]
    np.testing.assert_allclose(sent, joints_of(pose, 0), atol=1e-5)


def test_lsl(pose: SentPose) -> None:
    pylsl = pytest.importorskip("pylsl")
    with open_senders(["lsl"], [BODY, BODY]) as (sender,):
        found = pylsl.resolve_byprop("name", "apf person2", timeout=10) or pytest.skip("no network")
        inlet = pylsl.StreamInlet(found[0])
        inlet.open_stream(timeout=60)
        sample = None
        for _ in range(60):  # what is sent before the outlet knows the inlet is lost
            sender.send(pose)
            sample = sample or inlet.pull_sample(timeout=1)[0]
        described = inlet.info(timeout=60)
    assert described.desc().child("channels").child("channel").child_value("unit") == "meters"
    np.testing.assert_allclose(np.reshape(sample, (-1, 3)), joints_of(pose, 1), atol=1e-5)


def test_targets() -> None:
    assert {parse_target(kind).port for kind in PORTS} == set(PORTS.values())
    assert parse_target("vmc:10.0.0.2:7").host == "10.0.0.2" and parse_target("osc:7").port == 7
    for text in ("vcm", "vmc:x", "osc:1:2:3", "lsl:9", "osc:70000", ""):
        with pytest.raises(InputError, match=f"--send {text}: expected vmc, osc, websocket, lsl"):
            parse_target(text)
