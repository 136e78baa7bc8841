"""Batches and clusters: servers of another kind, lists of takes, errors of workers, interrupts."""

import os
import pickle
import signal
import socket
import struct
import threading
from collections.abc import Callable, Iterator

import pytest
from helpers.commands import run_python

from apf.cluster.connection import _check_answer
from cl import DeviceError, InputError, MissingFileError
from psfs.common.system import defer_interrupts

needs_signals = pytest.mark.skipif(os.name != "posix", reason="sends signals")


@pytest.fixture
def server() -> Iterator[Callable[[bytes], str]]:
    sockets: list[socket.socket] = []

    def start(greeting: bytes) -> str:
        listener = socket.create_server(("127.0.0.1", 0))
        sockets.append(listener)

        def serve() -> None:
            connection, _ = listener.accept()
            sockets.append(connection)
            connection.sendall(greeting)

        threading.Thread(target=serve, daemon=True).start()
        return f"tcp://127.0.0.1:{listener.getsockname()[1]}"

    yield start
    for opened in sockets:
        opened.close()


@pytest.mark.parametrize("greeting", [b"", b"SSH-2.0-OpenSSH_9.2p1\r\n", b"\0" * 64])
def test_servers_of_another_kind(server: Callable[[bytes], str], greeting: bytes) -> None:
    with pytest.raises((ValueError, TimeoutError)):
        _check_answer(server(greeting), 0.3)


def test_a_scheduler_answers(server: Callable[[bytes], str]) -> None:
    _check_answer(server(struct.pack("<Q", 200) + b"greeting"), 60.0)


@pytest.mark.parametrize("address", ["hello", "http://127.0.0.1:1", "tcp://127.0.0.1", "tcp://:x"])
def test_addresses_that_are_none(address: str) -> None:
    with pytest.raises(ValueError):
        _check_answer(address, 0.3)


@pytest.mark.parametrize("kind", [InputError, MissingFileError, DeviceError])
def test_errors_of_a_worker_arrive_as_they_were(kind: type[Exception]) -> None:
    support = pytest.importorskip("tblib.pickling_support")
    try:
        raise kind("a.toml: no such file")
    except kind as error:
        support.install(error)
        found = pickle.loads(pickle.dumps(error))
    assert type(found) is kind and str(found) == "a.toml: no such file"


@needs_signals
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_interrupts_wait_until_workers_have_started(name: str) -> None:
    inside, before = [], signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), defer_interrupts():
        os.kill(os.getpid(), getattr(signal, name))
        inside.append(True)
    assert inside and signal.getsignal(signal.SIGINT) is before


@needs_signals
def test_processes_of_threads_started_inside_receive_no_interrupts() -> None:
    show = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()))"
    said = []

    def start() -> None:
        said.append(run_python("-c", show).out.strip())

    with defer_interrupts():
        thread = threading.Thread(target=start)
        thread.start()
    thread.join()
    start()
    assert said == ["True", "False"]
