"""Files that are dropped onto the page."""

import json
import threading
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("viser", reason="viser is not installed")
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from psfs.page.drop import PATH, receive_files
from psfs.page.server import HOST, Gate, start_server, stop_server


def announce(socket: ClientConnection, name: str, size: int = 0) -> str:
    socket.send(json.dumps({"name": name, "size": size}))
    return str(socket.recv(timeout=60))


def test_dropped_files_arrive_whole_or_not_at_all(tmp_path: Path) -> None:
    folder, done = tmp_path / "dropped", threading.Event()
    ended = threading.Semaphore(0)

    async def receive(connection: Any) -> None:
        await receive_files(connection, lambda: folder, lambda path: done.set())
        ended.release()

    gate = Gate(receive=receive)
    server = start_server(0, gate)
    root = f"ws://{HOST}:{server.get_port()}"
    try:
        with pytest.raises(InvalidStatus):
            connect(f"{root}{PATH}")
        with connect(f"{root}/{gate.token}{PATH}") as socket:
            assert announce(socket, "virus.exe").startswith("virus.exe: expected videos")
        with connect(f"{root}/{gate.token}{PATH}") as socket:
            assert not announce(socket, "..\\../cam01.mp4", 6)
            for piece in (b"abcd", b"ef"):
                socket.send(piece)
                assert not socket.recv(timeout=60)
            assert not announce(socket, "")
        assert done.wait(60)
        with connect(f"{root}/{gate.token}{PATH}") as socket:
            assert not announce(socket, "cam02.mp4", 6)
            socket.send(b"abc")  # the page is closed here
        for _ in range(3):
            assert ended.acquire(timeout=60)
    finally:
        stop_server(server)
    assert [path.name for path in tmp_path.rglob("*.*")] == ["cam01.mp4"]
    assert (folder / "cam01.mp4").read_bytes() == b"abcdef"
