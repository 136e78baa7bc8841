"""Send live poses to other programs while they come: as VMC or OSC over UDP, by a WebSocket, or as
streams of the Lab Streaming Layer.

VMC is what VSeeFace, Warudo and plugins of Unreal and Blender read (protocol.vmc.info): OSC with
Unity's names of bones, each bone's rotation relative to its parent, and the hips' position;
metres, Y up, Z forward, X to the right. The other three send the joints, metres, Z up.
"""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from apf.body.model import BodyModel
from apf.filters.base import Estimate
from apf.formats.skeleton import build_skeleton
from cl import InputError
from cl.errors import pip_command

#: Where each kind is sent to, or served, without a stated host and port.
PORTS = {"vmc": 39539, "osc": 9000, "websocket": 8765, "lsl": 0}
#: Unity's names of our skeleton's nodes, where they differ.
_UNITY = {"Arm": "UpperArm", "ForeArm": "LowerArm", "UpLeg": "UpperLeg", "Leg": "LowerLeg"}


@dataclass(frozen=True)
class Target:
    """A kind of `PORTS`, and the address."""

    kind: str
    host: str
    port: int


@dataclass(frozen=True, eq=False)
class SentPose:
    """The estimates of all people in a frame. time: of the frame's appearance, s of the run."""

    frame: int
    time: float
    estimates: Sequence[Estimate]


def parse_target(text: str) -> Target:
    """Return what `KIND`, `KIND:PORT` or `KIND:HOST:PORT` says. Raises InputError."""
    kind, *rest = text.split(":")
    host = rest[0] if len(rest) == 2 and rest[0] else "127.0.0.1"
    port = rest[-1] if rest else str(PORTS.get(kind, 0))
    known = kind in PORTS and len(rest) <= 2 and port.isdecimal() and (kind != "lsl" or not rest)
    if not known or int(port) > 65535:
        raise InputError(
            f"--send {text}: expected {', '.join(PORTS)}, of all but lsl also with :PORT or "
            ":HOST:PORT"
        )
    return Target(kind, host, int(port))


class OscSender:
    """Messages /apf/personN/lost i, then /apf/personN/JOINT x y z, a bundle a frame."""

    def __init__(self, target: Target, bodies: Sequence[BodyModel]) -> None:
        from pythonosc.udp_client import UDPClient

        socket.getaddrinfo(target.host, target.port)  # raises OSError for an unknown host
        self._clients = [UDPClient(target.host, target.port + k) for k in range(len(bodies))]

    def send(self, pose: SentPose) -> None:
        for number, estimate in enumerate(pose.estimates, 1):
            at = f"/apf/person{number}"
            messages: list[tuple[Any, ...]] = [(f"{at}/lost", int(estimate.lost))]
            pairs = zip(estimate.body.joint_names, estimate.joints, strict=True)
            messages += [(f"{at}/{name}", *map(float, place)) for name, place in pairs]
            self._clients[0].send(_bundle(messages))

    def close(self) -> None:
        for client in self._clients:
            client._sock.close()


class VmcSender(OscSender):
    """The Virtual Motion Capture protocol; each further person has the next port."""

    def __init__(self, target: Target, bodies: Sequence[BodyModel]) -> None:
        super().__init__(target, bodies)
        self._skeletons = [build_skeleton(body) for body in bodies]

    def send(self, pose: SentPose) -> None:
        from scipy.spatial.transform import Rotation  # takes a while to load

        for estimate, skeleton, client in zip(
            pose.estimates, self._skeletons, self._clients, strict=True
        ):
            rotations, positions = skeleton.motion(estimate.body, estimate.pose[None])
            # to Unity's left-handed axes, by a mirror across X = 0
            turns = Rotation.from_matrix(rotations[0]).as_quat() * [1, -1, -1, 1]
            places = positions[0] * [-1, 1, 1]
            root = ("/VMC/Ext/Root/Pos", "root", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
            client.send(_bundle([("/VMC/Ext/OK", 1), ("/VMC/Ext/T", float(pose.time)), root]))
            bones = [
                ("/VMC/Ext/Bone/Pos", name_for_unity(node.name), *map(float, (*place, *turn)))
                for node, place, turn in zip(skeleton.nodes, places, turns, strict=True)
                if node.bone is not None
            ]
            client.send(_bundle(bones))


def name_for_unity(name: str) -> str:
    """Return Unity's name (HumanBodyBones) of a node of the skeleton."""
    side = next((side for side in ("Left", "Right") if name.startswith(side)), "")
    plain = name.removeprefix(side)
    return side + _UNITY.get(plain, plain)


def _bundle(messages: Sequence[tuple[Any, ...]]) -> Any:
    from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
    from pythonosc.osc_message_builder import OscMessageBuilder

    bundle = OscBundleBuilder(IMMEDIATELY)
    for address, *values in messages:
        message = OscMessageBuilder(address)
        for value in values:
            message.add_arg(value)
        bundle.add_content(message.build())
    return bundle.build()


class WebSocketSender:
    """A server that sends each page the newest frame as JSON: frame, time, and people with name,
    lost, and joints by name."""

    def __init__(self, target: Target, bodies: Sequence[BodyModel]) -> None:
        from websockets.sync.server import serve

        self._news = threading.Condition()
        self._newest, self._count, self._closed = "", 0, False
        self._server = serve(self._serve, target.host, target.port)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def send(self, pose: SentPose) -> None:
        people = []
        for number, estimate in enumerate(pose.estimates, 1):
            places = zip(estimate.body.joint_names, estimate.joints.round(5).tolist(), strict=True)
            lost = bool(estimate.lost)
            people.append({"name": f"person{number}", "lost": lost, "joints": dict(places)})
        text = json.dumps({"frame": pose.frame, "time": round(pose.time, 6), "people": people})
        with self._news:
            self._newest = text
            self._count += 1
            self._news.notify_all()

    def _serve(self, page: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        count = 0  # a page that opens is sent the newest frame at once
        with suppress(ConnectionClosed):
            while not self._closed:
                count, text = self._wait_for_news(count)
                if text:
                    page.send(text)

    def _wait_for_news(self, count: int) -> tuple[int, str]:
        with self._news:
            news = self._news.wait_for(lambda: self._count > count or self._closed, 1.0)
            return self._count, self._newest if news else ""

    def close(self) -> None:
        with self._news:
            self._closed = True
            self._news.notify_all()
        with suppress(OSError):
            self._server.shutdown()


class LslSender:
    """A stream for each person: x, y and z of each joint, m, at the time of its picture."""

    def __init__(self, target: Target, bodies: Sequence[BodyModel]) -> None:
        import pylsl

        self._clock, self._offset = pylsl.local_clock, np.inf
        self._outlets = []
        for number, body in enumerate(bodies, 1):
            labels = [f"{name}_{axis}" for name in body.joint_names for axis in "xyz"]
            kind = pylsl.cf_float32
            info = pylsl.StreamInfo(f"apf person{number}", "MoCap", len(labels), 0, kind)
            channels = info.desc().append_child("channels")
            for label in labels:
                channel = channels.append_child("channel")
                channel.append_child_value("label", label)
                channel.append_child_value("unit", "meters")
            self._outlets.append(pylsl.StreamOutlet(info))

    def send(self, pose: SentPose) -> None:
        # the least difference of the clocks is that of the pose that came soonest
        self._offset = min(self._offset, self._clock() - pose.time)
        for outlet, estimate in zip(self._outlets, pose.estimates, strict=True):
            outlet.push_sample(estimate.joints.ravel().tolist(), pose.time + self._offset)

    def close(self) -> None:
        self._outlets.clear()


#: Sends poses of people, whose bodies it was made with, to one target; `send` raises OSError.
Sender = OscSender | WebSocketSender | LslSender


@contextmanager
def open_senders(texts: Sequence[str], bodies: Sequence[BodyModel]) -> Iterator[list[Sender]]:
    """Yield what sends to the targets that `texts` name. Raises InputError if a package is missing,
    or an address cannot be used."""
    kinds: dict[str, type[Sender]] = {
        "vmc": VmcSender, "osc": OscSender, "websocket": WebSocketSender, "lsl": LslSender,
    }  # fmt: skip
    with ExitStack() as stack:
        senders: list[Sender] = []
        for target in map(parse_target, texts):
            try:
                sender = kinds[target.kind](target, bodies)
            except ImportError as error:
                raise InputError(
                    f"--send {target.kind} needs {error.name}, which is not installed; expected: "
                    f"{pip_command('send')}"
                ) from None
            except OSError as error:
                where = f"{target.host}:{target.port}"
                raise InputError(
                    f"--send {target.kind}: {where} cannot be used: {error.strerror or error}"
                ) from None
            stack.callback(sender.close)
            senders.append(sender)
        yield senders
