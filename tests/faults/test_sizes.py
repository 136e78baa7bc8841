"""Sizes that files claim, and what parsers make of them: bounded before anything is made."""

import pickle
import struct
import zipfile
from pathlib import Path
from typing import Any

import pytest
from helpers.faults import npy, refused
from helpers.memory import limited_memory

from apf.keypoints.opening import read_raw
from cl import InputError
from psfs.common.reading import parsing

EVALUATE = ["apf", "evaluate", "track", "--truth", "truth.npz", "-o", "new"]


def nested(depth: int) -> Any:
    values: Any = [0.0] * 10
    for _ in range(depth):
        values = [values] * 10
    return values


PICKLES = {
    "nested shared lists": lambda: pickle.dumps([[{"pose_keypoints_2d": nested(8)}]] * 3),
    "shared frames": lambda: pickle.dumps([[{"pose_keypoints_2d": [1.0] * 75}] * 2000] * 3000),
    "a far store": lambda: b"\x80\x02]r\xff\xff\xff\x3f.",
    "a long array": lambda: b"\x80\x05\x96" + struct.pack("<Q", 2**33) + b"x.",
    "a long integer": lambda: pickle.dumps([[{"pose_keypoints_2d": [10**4000, 1, 1]}]]),
    "a loop": lambda: b"\x80\x02]q\x00h\x00a.",
}


@pytest.mark.parametrize("kind", PICKLES)
def test_pickles(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "c1_keypoints.pkl"
    path.write_bytes(PICKLES[kind]())
    with limited_memory(2**30), pytest.raises(InputError, match=r"c1_keypoints\.pkl: "):
        read_raw(path)


def bomb(path: Path) -> None:
    """Three GB of zeros."""
    n_bytes = 3 * 2**30
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("joints.npy", npy((n_bytes,), "|u1"))
    data = bytearray(path.read_bytes())
    for mark, at in ((b"PK\x01\x02", 24), (b"PK\x03\x04", 22)):
        place = data.find(mark) + at
        data[place : place + 4] = struct.pack("<I", n_bytes)
    path.write_bytes(bytes(data))


def test_a_bomb_is_not_unpacked(stock: Path) -> None:
    bomb(stock / "truth.npz")
    with limited_memory(2**30):
        refused(EVALUATE, stock, "truth.npz: too large for the memory")


def test_a_crowd(tmp_path: Path) -> None:
    person = '{"pose_keypoints_2d": [1.0, 2.0, 0.5]}'
    text = f'{{"people": [{", ".join([person] * 100_000)}]}}'
    (tmp_path / "c1_000000.json").write_text(text)
    with pytest.raises(InputError, match=r"c1_000000\.json: 100,000 persons"):
        read_raw(tmp_path)


HEADERS = {
    "many brackets": "(((((((((((" * 100,
    "a far shape": f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({'9' * 4000},), }}",
}


@pytest.mark.parametrize("kind", HEADERS)
def test_headers(stock: Path, kind: str) -> None:
    text = HEADERS[kind].encode().ljust(118) + b"\n"
    with zipfile.ZipFile(stock / "truth.npz", "w") as archive:
        archive.writestr("joints.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text)
    refused(EVALUATE, stock, "truth.npz")


@pytest.mark.parametrize("error", [MemoryError(), RecursionError(), KeyError("x"), OSError("y")])
def test_errors_while_parsing(tmp_path: Path, error: Exception) -> None:
    with (
        pytest.raises(InputError, match=r"a\.toml: .*expected a table"),
        parsing(tmp_path / "a.toml", "a table"),
    ):
        raise error
