"""A page on a server of its own: viser on this machine alone, which answers only requests with a
secret in their address.

viser (https://viser.studio) has no access control. Its page and its websocket are served by one
call of `websockets.asyncio.server.serve`; `start_server` puts a check before both, and ends the
server again if a request without the token is not refused.
"""

from __future__ import annotations

import hmac
import http.client
import io
import logging
import secrets
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any

from cl import InputError
from cl.errors import pip_command
from psfs.page import drop
from psfs.page.timeline import add_key

if TYPE_CHECKING:
    import numpy as np
    import viser

#: The only address that the server listens on.
HOST = "127.0.0.1"
#: Names by which a browser on this machine may address it; others are another site's, which
#: pretends to be this one.
_HOSTS = (HOST, "localhost")
_ONE_AT_A_TIME = threading.Lock()
Receive = Callable[[Any], Awaitable[None]]


class Gate:
    """The check of each request: its path begins with the token, and its host is this machine.
    title: of the page, as the browser's tab has it. receive: takes the connection of files that are
    dropped onto the page, see `psfs.page.drop`; without it they are not taken."""

    def __init__(self, title: str = "psfs-apf", receive: Receive | None = None) -> None:
        self.token, self.title, self.receive = secrets.token_urlsafe(24), title, receive

    def strip_token(self, path: str, host: str) -> str | None:
        """Return the `path` of a request without the token; None if the request is to be refused.
        host: its header of that name."""
        first, _, rest = path.lstrip("/").partition("/")
        given = first.partition("?")[0]
        right = hmac.compare_digest(given.encode(), self.token.encode())
        if not right or host.rpartition(":")[0] not in _HOSTS:
            return None
        return "/" + rest


def import_viser() -> Any:
    """Return the package viser. Raises InputError if it is not installed."""
    try:
        import viser
    except ImportError:
        raise InputError(
            f"the page needs viser, which is not installed; expected: {pip_command('studio')}"
        ) from None
    return viser


def start_server(port: int, gate: Gate) -> viser.ViserServer:
    """Return a running server on HOST behind `gate`. port: 0 for any that is free; if it is taken,
    the next free one. Raises InputError."""
    viser = import_viser()
    # websockets logs each visitor that speaks no HTTP, with a traceback.
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    # viser prints the address without the token.
    with _ONE_AT_A_TIME, _serve_with_checks(gate), redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host=HOST, port=port, verbose=False)
    try:
        if _status(server.get_port(), "/") != http.client.FORBIDDEN:
            raise InputError(
                f"viser {viser.__version__} serves without the check of the token; expected a "
                f"version that `{pip_command('studio')}` chooses"
            )
    except BaseException:
        stop_server(server)
        raise
    return server


def stop_server(server: viser.ViserServer) -> None:
    """Stop a server without viser's messages."""
    with _ONE_AT_A_TIME, redirect_stdout(io.StringIO()):
        server.stop()


def look(server: viser.ViserServer, look_at: np.ndarray, position: np.ndarray) -> None:
    """Have all browsers look at a point (3,) m from another."""
    for client in server.get_clients().values():
        with client.atomic():
            client.camera.position, client.camera.look_at = position, look_at


def read_choice(dropdown: Any) -> str:
    """Return the value of a drop-down. Raises InputError if it is none of its options: what a
    browser sends may be anything."""
    if dropdown.value not in dropdown.options:
        raise InputError(f"{dropdown.value!r}: expected one of {', '.join(dropdown.options)}")
    return str(dropdown.value)


def read_metres(field: Any, what: str) -> list[float]:
    """Return the numbers of a text field, with commas between. Raises InputError, about `what`."""
    try:
        return [float(word) for word in field.value.split(",") if word.strip()]
    except ValueError:
        raise InputError(
            f"the {what} is {field.value!r}; expected metres, as 0.5 or 0.2,0.3"
        ) from None


@contextmanager
def _serve_with_checks(gate: Gate) -> Iterator[None]:
    """Have all servers that websockets starts inside check their requests by `gate`."""
    from websockets.asyncio import server as serving

    serve: Callable[..., object] = serving.serve

    def serve_checked(
        handler: Receive, *args: object, process_request: Callable[..., Any], **options: object
    ) -> object:
        async def handle(connection: Any) -> None:
            if connection.request.path != drop.PATH:
                await handler(connection)
            elif gate.receive is not None:
                await gate.receive(connection)

        def check(connection: Any, request: Any) -> Any:
            path = gate.strip_token(request.path, request.headers.get("Host", ""))
            if path is None:
                return connection.respond(http.client.FORBIDDEN, "the address lacks its token\n")
            request.path = path
            if path != "/" or "Upgrade" in request.headers:
                return process_request(connection, request)
            del request.headers["Accept-Encoding"]  # its page is to be read
            answer = process_request(connection, request)
            answer.body = answer.body.replace(b"<title>Viser", b"<title>" + gate.title.encode())
            if gate.receive is not None:
                answer.body = answer.body.replace(b"</head>", drop.SCRIPT.encode() + b"</head>")
            del answer.headers["Content-Length"]
            answer.headers["Content-Length"] = str(len(answer.body))
            return answer

        return serve(handle, *args, process_request=check, **options)

    serving.serve = serve_checked  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        serving.serve = serve  # type: ignore[assignment,misc]


def _status(port: int, path: str) -> int:
    """Return the status of the answer to a request of `path`."""
    connection = http.client.HTTPConnection(HOST, port, timeout=60)
    try:
        connection.request("GET", path)
        return connection.getresponse().status
    finally:
        connection.close()


class BrowserPage:
    """An empty page. label: above its panels. port: see `start_server`. receive: see `Gate`."""

    def __init__(self, label: str, port: int = 0, receive: Receive | None = None) -> None:
        self.gate = Gate(label, receive)
        self.server = start_server(port, self.gate)
        gui = self.server.gui
        self._choose_theme(False)
        gui.set_panel_label(label)

    @property
    def address(self) -> str:
        """The page's address, with its token."""
        return f"http://{HOST}:{self.server.get_port()}/{self.gate.token}/"

    def stop(self) -> None:
        """End the server."""
        stop_server(self.server)

    def add_pictures(self, label: str) -> Any:
        """Add a panel for pictures at the left; return its tab."""
        gui = self.server.gui
        beside = gui.add_panel()
        tab = beside.add_tab(label)
        beside.dock_left()
        beside.set_width(380)
        gui.main_panel.dock_right()
        return tab

    def add_dark(self) -> None:
        """Add the choice between dark and light."""
        gui = self.server.gui
        self.dark: Any = gui.add_checkbox("dark", False, hint="key: I")
        self.dark.on_update(lambda event: self._choose_theme(self.dark.value))
        add_key(gui, "Dark or light", "I", lambda: setattr(self.dark, "value", not self.dark.value))

    def _choose_theme(self, dark: bool) -> None:
        self.server.gui.configure_theme(
            dark_mode=dark, show_logo=False, show_share_button=False, control_width="large"
        )
