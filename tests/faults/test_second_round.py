"""Faults of the second round: files of the user's, folders outside OUT, sizes that are claimed,
pipes, servers of another kind, and what parsers raise."""

from __future__ import annotations

import os
import pickle
import socket
import struct
import threading
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.faults import changed_npz, refused, run, state
from helpers.memory import limited_memory

from apf.cli.batch.take import TakeJob
from apf.cluster.connection import _check_answer
from apf.keypoints.opening import read_raw
from cl import InputError
from psfs.common.reading import open_input, parsing

VIEW = ["psfs", "view", "out", "--frame", "1"]
EVALUATE = ["apf", "evaluate", "track", "--truth", "truth.npz", "-o", "new"]
INFO = ["psfs", "info", "seq", "--no-pictures"]


@pytest.fixture
def stock(stock: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(stock)
    monkeypatch.setenv("XDG_CACHE_HOME", str(stock.parent / "cache"))
    return stock


# ---- files of the user's


@pytest.mark.parametrize("name", ["mine.png", "seq/masks/c3/0001.png"])
def test_a_picture_over_a_file(stock: Path, name: str) -> None:
    if name == "mine.png":
        (stock / name).write_bytes(b"mine")
    refused([*VIEW, "--png", name], stock, name)


def test_a_picture_among_the_masks(stock: Path) -> None:
    words = ["psfs", "info", "seq", "--masks", "seq/masks/c3/new.png"]
    refused(words, stock, "lies among the files that are read")


def test_silhouettes_as_the_true_masks(stock: Path) -> None:
    words = ["psfs", "silhouettes", "seq", "-o", "seq/truth_masks", "--frames", "0:1"]
    refused(words, stock, "seq/truth_masks", "which is read")


def test_a_picture_that_was_written_before(stock: Path) -> None:
    for _ in range(2):
        assert run([*VIEW, "--png", "x.png"]).code == 0
    (stock / "x.png").write_bytes(b"changed since")
    refused([*VIEW, "--png", "x.png"], stock, "x.png: exists", "--overwrite")
    assert run([*VIEW, "--png", "x.png", "--overwrite"]).code == 0
    assert (stock / "x.png").read_bytes() != b"changed since"


def test_a_link_over_a_file(stock: Path) -> None:
    (stock / "x.png").symlink_to("out/preview.png")
    refused([*VIEW, "--png", "x.png", "--overwrite"], stock, "no regular file")


def test_a_mesh_over_a_file(stock: Path) -> None:
    pytest.importorskip("skimage")
    (stock / "mine.ply").write_bytes(b"mine")
    refused(["psfs", "mesh", "out", "--frame", "1", "-o", "mine.ply"], stock, "mine.ply: exists")


# ---- folders outside OUT


def test_a_link_out_of_an_output(stock: Path) -> None:
    (stock / "elsewhere").mkdir()
    (stock / "new").mkdir()
    (stock / "new/videos").symlink_to(stock / "elsewhere")
    outcome = run(["psfs", "convert", "walk", "-o", "new"])
    assert outcome.code == 2 and "a symbolic link leads out of new" in outcome.err
    assert not state(stock / "elsewhere")


@pytest.mark.parametrize("word", ["--output=/elsewhere", "--log-file=/elsewhere", "--quiet"])
def test_flags_of_a_whole_batch_in_a_take(tmp_path: Path, word: str) -> None:
    job = TakeJob("a", tmp_path, tmp_path / "out", tmp_path / "log", (word,), where="list: take 1")
    with pytest.raises(InputError, match=r"list: take 1: --.* applies only to the whole batch"):
        job.arguments()


@pytest.mark.parametrize("name", ["index.html", "takes.csv", "manifest.txt", "a\udcff"])
def test_names_that_a_batch_needs_itself(stock: Path, name: str) -> None:
    shown = name.replace("\udcff", "")
    toml = f"[[take]]\nfolder = 'walk'\nname = '{shown}'\n"
    words = ["apf", "batch", "takes.toml", "-o", "new", "--workers", "1"]
    if name != shown:
        (stock / "walk").rename(stock / name)
        words[2] = name
    (stock / "takes.toml").write_text(toml)
    refused(words, stock, shown)


# ---- pipes: nobody waits for their other end

PIPES = {
    "truth.npz": EVALUATE,
    "truth.trc": [*EVALUATE[:4], "truth.trc", *EVALUATE[5:]],
    "truth.c3d": [*EVALUATE[:4], "truth.c3d", *EVALUATE[5:]],
    "track/track.npz": ["apf", "smooth", "track", "-o", "new"],
    "b.toml": ["apf", "smooth", "track", "-o", "new", "--body", "b.toml"],
    "c.toml": [*INFO, "--config", "c.toml"],
    "x.log": [*INFO, "--log-file", "x.log"],
    "out/summary.json": [*VIEW, "--png", "x.png"],
    "out/clouds/frame_000001.npz": [*VIEW, "--png", "x.png"],
    "out/manifest.txt": VIEW,
    "walk/calibration.toml": ["psfs", "info", "walk", "--no-pictures"],
    "walk/videos/cam01.mp4": ["psfs", "info", "walk", "--no-pictures"],
    "takes.toml": ["apf", "batch", "takes.toml", "-o", "new"],
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
@pytest.mark.parametrize("name", PIPES)
def test_pipes(stock: Path, name: str) -> None:
    (stock / name).unlink(missing_ok=True)
    os.mkfifo(stock / name)
    refused(PIPES[name], stock, Path(name).name)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
@pytest.mark.parametrize("name", ["k.npz", "k.npy", "k.pkl", "k.csv", "k/c1_000000.json"])
def test_pipes_of_keypoints(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    os.mkfifo(path)
    with pytest.raises(InputError, match="is no regular file"):
        read_raw(path.parent if path.suffix == ".json" else path)


# ---- sizes that are claimed


def nested(depth: int) -> Any:
    values: Any = [0.0] * 10
    for _ in range(depth):
        values = [values] * 10
    return values


PICKLES = {
    "nested shared lists": lambda: pickle.dumps([[{"pose_keypoints_2d": nested(8)}]] * 3),
    "shared frames": lambda: pickle.dumps([[{"pose_keypoints_2d": [1.0] * 75}] * 2000] * 3000),
    "long frames": lambda: pickle.dumps([[{"pose_keypoints_2d": [1.0] * 75}] * 150] * 30_000),
    "a far store": lambda: b"\x80\x02]r\xff\xff\xff\x3f.",
    "a global": lambda: b"\x80\x02cos\nsystem\nX\x04\x00\x00\x00trueR.",
    "an extension": lambda: b"\x80\x02\x82\x01.",
    "a long integer": lambda: pickle.dumps([[{"pose_keypoints_2d": [10**4000, 1, 1]}]]),
    "cut": lambda: pickle.dumps([[{"pose_keypoints_2d": [1.0] * 75}]])[:-9],
    "a long text": lambda: b"\x80\x04\x8d\xff\xff\xff\xff\xff\xff\xff\x00abc.",
    "a loop": lambda: b"\x80\x02]q\x00h\x00a.",
    "not UTF-8": lambda: b"\x80\x02X\x01\x00\x00\x00\xff.",
    "nothing": lambda: b"",
}


@pytest.mark.parametrize("kind", PICKLES)
def test_pickles(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "c1_keypoints.pkl"
    path.write_bytes(PICKLES[kind]())
    with limited_memory(2**30), pytest.raises(InputError, match=r"c1_keypoints\.pkl|camera \."):
        read_raw(path)


def bomb(path: Path) -> None:
    """Three GB of zeros."""
    n_bytes = 3 * 2**30
    head = repr({"descr": "|u1", "fortran_order": False, "shape": (n_bytes,)}).encode()
    head += b" " * (64 - (len(head) + 11) % 64) + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("joints.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head)
    data = bytearray(path.read_bytes())
    for mark, at in ((b"PK\x01\x02", 24), (b"PK\x03\x04", 22)):
        place = data.find(mark) + at
        data[place : place + 4] = struct.pack("<I", n_bytes)
    path.write_bytes(bytes(data))


def test_a_bomb_is_not_unpacked(stock: Path) -> None:
    bomb(stock / "truth.npz")
    with limited_memory(2**30):
        refused(EVALUATE, stock, "truth.npz: its arrays unpack to 3,072 MiB")


def test_a_crowd(tmp_path: Path) -> None:
    person = '{"pose_keypoints_2d": [1.0, 2.0, 0.5]}'
    text = f'{{"people": [{", ".join([person] * 100_000)}]}}'
    (tmp_path / "c1_000000.json").write_text(text)
    with pytest.raises(InputError, match=r"c1_000000\.json: 100,000 persons"):
        read_raw(tmp_path)


# ---- servers of another kind


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
    _check_answer(server(struct.pack("<Q", 200) + b"greeting"), 5.0)


@pytest.mark.parametrize("address", ["hello", "http://127.0.0.1:1", "tcp://127.0.0.1", "tcp://:x"])
def test_addresses_that_are_none(address: str) -> None:
    with pytest.raises(ValueError):
        _check_answer(address, 0.3)


# ---- what parsers raise

HEADERS = {
    "no end": "{'descr': '<f8', 'fortran_order': False, 'shape': (1,",
    "an open text": "  \n  {'a",
    "of Python 2": "{'descr': '<f8', 'fortran_order': False, 'shape': (1L,), }",
    "many brackets": "(((((((((((" * 100,
    "a far shape": f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({'9' * 4000},), }}",
}


@pytest.mark.parametrize("kind", HEADERS)
def test_headers(stock: Path, kind: str) -> None:
    text = HEADERS[kind].encode().ljust(118) + b"\n"
    with zipfile.ZipFile(stock / "truth.npz", "w") as archive:
        archive.writestr("joints.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text)
    refused(EVALUATE, stock, "truth.npz")


@pytest.mark.parametrize("pattern", ["x/**a/[*", "**a", "["])
def test_patterns(pattern: str) -> None:
    with pytest.raises(InputError, match=r"keypoints|pattern"):
        read_raw(Path(pattern))


@pytest.mark.parametrize("name", ["track/track.npz", "truth.npz"])
def test_a_frame_twice(stock: Path, name: str) -> None:
    changed_npz(stock / name, frames=np.zeros(6, int))
    refused(EVALUATE, stock, Path(name).parent.name or name, "frames are not ascending")


def test_the_root_folder() -> None:
    outcome = run(["apf", "synth", "-o", "/", "--frames", "2", "--cameras", "2"])
    assert outcome.code == 2 and "has no name of its own" in outcome.err


def test_odd_sides() -> None:
    outcome = run(["apf", "synth", "-o", "new", "--size", "65x49"])
    assert outcome.code == 2 and "expected even sides" in outcome.err


@pytest.mark.parametrize("error", [MemoryError(), RecursionError(), KeyError("x"), OSError("y")])
def test_errors_while_parsing(tmp_path: Path, error: Exception) -> None:
    with (
        pytest.raises(InputError, match=r"a\.toml: .*expected a table"),
        parsing(tmp_path / "a.toml", "a table"),
    ):
        raise error


@pytest.mark.parametrize("path", ["/dev/zero", "/dev/null"])
@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="there are no device nodes")
def test_devices(path: str) -> None:
    with pytest.raises(InputError, match="is no regular file"):
        open_input(Path(path))
