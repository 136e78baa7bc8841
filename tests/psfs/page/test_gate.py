"""Requests without the token get nothing; files that are dropped arrive whole or not at all."""

import http.client
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("viser", reason="viser is not installed")
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from psfs.page import server as module
from psfs.page.drop import PATH, receive_files
from psfs.page.server import HOST, BrowserPage, Gate, start_server, stop_server


@pytest.fixture(scope="module")
def served() -> Iterator[tuple[int, Gate]]:
    gate = Gate()
    server = start_server(0, gate)
    yield server.get_port(), gate
    stop_server(server)


def status(port: int, path: str, **headers: str) -> int:
    connection = http.client.HTTPConnection(HOST, port, timeout=60)
    connection.request("GET", path, headers=headers)
    return connection.getresponse().status


@pytest.mark.parametrize(
    ("path", "headers", "expected"),
    [
        ("/{token}/", {}, 200),
        ("/", {}, 403),
        ("/index.html", {}, 403),
        ("/{token:.30}/", {}, 403),
        ("/x/{token}/", {}, 403),
        ("/?{token}", {}, 403),
        ("/", {"Upgrade": "websocket"}, 403),
        ("/{token}/", {"Host": "evil.example:{port}"}, 403),  # another site's name
        ("/{token}/", {"Host": "localhost:{port}"}, 200),
        ("/{token}/../../_viser.py", {}, 404),  # nothing beside the page
        ("/{token}/%2e%2e/%2e%2e/_viser.py", {}, 404),
        ("/{token}///etc/passwd", {}, 404),
    ],
)
def test_page_needs_the_token(
    served: tuple[int, Gate], path: str, headers: dict[str, str], expected: int
) -> None:
    known = {"port": served[0], "token": served[1].token}
    stated = {name: value.format(**known) for name, value in headers.items()}
    assert status(served[0], path.format(**known), **stated) == expected


def test_websocket_needs_the_token(served: tuple[int, Gate]) -> None:
    import viser

    port, gate = served
    spoken = [Subprotocol(f"viser-v{viser.__version__}")]
    for path in ("/", "/wrong"):
        with pytest.raises(InvalidStatus) as refused:
            connect(f"ws://{HOST}:{port}{path}", subprotocols=spoken)
        assert refused.value.response.status_code == 403
    with connect(f"ws://{HOST}:{port}/{gate.token}", subprotocols=spoken) as socket:
        assert socket.recv(timeout=60)


def test_address_holds_the_token() -> None:
    page = BrowserPage("a page")
    token, port = page.gate.token, page.server.get_port()
    try:
        assert len(token) >= 32 and token != Gate().token
        assert page.address == f"http://{HOST}:{port}/{token}/"
    finally:
        page.stop()


def test_a_server_that_cannot_be_checked_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    ports: list[int] = []

    def fail(port: int, path: str) -> int:
        ports.append(port)
        raise ConnectionResetError

    monkeypatch.setattr(module, "_status", fail)
    with pytest.raises(ConnectionResetError):
        start_server(0, Gate())
    with pytest.raises(ConnectionRefusedError):
        status(ports[0], "/")


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
