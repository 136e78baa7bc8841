"""Arrays, joints, poses, meshes, pictures and videos that are damaged, lie or belong elsewhere."""

import os
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from helpers import footage
from helpers.faults import BOX, changed_npz, npy, refused
from helpers.footage import cut

NAN, INF = float("nan"), float("inf")


def with_entry(path: Path, name: str, content: bytes) -> None:
    """Put an npy of one's own into an npz."""
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(f"{name}.npy", content)


#: Of every npz.
ARCHIVES: dict[str, Callable[[Path], Any]] = {
    "empty": lambda p: p.write_bytes(b""),
    "npy": lambda p: p.write_bytes(npy((1,), data=b"\0" * 8)),
    "an empty archive": lambda p: p.write_bytes(b"PK\x05\x06" + b"\0" * 18),
    "objects": lambda p: changed_npz(p, extra=np.array([{}], object)),
    "a huge header": lambda p: with_entry(p, "extra", npy((10**12,))),
    "a negative length": lambda p: with_entry(p, "extra", npy((-3,))),
    "code for a header": lambda p: with_entry(
        p, "extra", b"\x93NUMPY\x01\x00" + struct.pack("<H", 30) + b"__import__('os').abort()      "
    ),
    "a folder": lambda p: (p.unlink(), p.mkdir()),
    "a loop": lambda p: (p.unlink(), p.symlink_to(p)),
    "nothing": lambda p: p.unlink(),
}
FILES = {
    "out/clouds/frame_000001.npz": ["psfs", "view", "out", "--frame", "1", "--png", "x.png"],
    "track/track.npz": ["apf", "smooth", "track", "-o", "new"],
    "truth.npz": ["apf", "evaluate", "track", "--truth", "truth.npz", "-o", "new"],
}


@pytest.mark.parametrize("fault", ARCHIVES)
@pytest.mark.parametrize("name", FILES)
def test_archives(stock: Path, name: str, fault: str) -> None:
    ARCHIVES[fault](stock / name)
    refused(FILES[name], stock, Path(name).name)


N = 6
CLOUD: dict[str, dict[str, Any]] = {
    "no origin": {"origin": None},
    "an infinite origin": {"origin": np.array([0, INF, 0])},
    "no voxel size": {"voxel_size": np.array(0.0)},
    "a negative one": {"voxel_size": np.array(-1.0)},
    "a huge grid": {"shape": np.array([10**6, 10**6, 10**6])},
    "a negative grid": {"shape": np.array([-5, 5, 5])},
    "indices outside": {"indices": np.arange(3) + 10**9, "probability": np.ones(3), "colour": None},
    "indices twice": {"indices": np.zeros(3, int), "probability": np.ones(3), "colour": None},
    "falling indices": {"indices": np.arange(3)[::-1], "probability": np.ones(3), "colour": None},
    "fewer probabilities": {"probability": np.ones(2)},
    "probability 2": {"indices": np.arange(1), "probability": np.full(1, 2.0), "colour": None},
    "other colours": {"colour": np.zeros((2, 3), np.uint8)},
    "colours with alpha": {"indices": np.arange(1), "probability": np.ones(1),
                           "colour": np.zeros((1, 4), np.uint8)},
    "infinite volume": {"volume": np.array(INF)},
}  # fmt: skip
TRACK: dict[str, dict[str, Any]] = {
    "NaN poses": {"poses": np.full((N, 31), NAN)},
    "huge poses": {"poses": np.full((N, 31), 1e300)},
    "fewer poses": {"poses": np.zeros((N - 1, 31))},
    "other axes": {"poses": np.zeros((N, 30))},
    "NaN joints": {"joints": np.full((N, 15, 3), NAN)},
    "no names": {"joint_names": np.array([], str)},
    "edges outside": {"edges": np.array([[0, 99]])},
    "negative frames": {"frames": np.arange(N) - 3},
    "falling frames": {"frames": np.arange(N)[::-1]},
    "a frame twice": {"frames": np.zeros(N, int)},
    "fps 0": {"fps": np.array(0.0)},
    "fps 1e-300": {"fps": np.array(1e-300)},
    "no JSON": {"provenance": np.array("{")},
    "deep JSON": {"provenance": np.array('{"a":' * 9000)},
    "strange smoothing": {"provenance": np.array('{"smoothing": 3}')},
    "two names": {"body_name": np.array(["a", "b"])},
    "flags as text": {"diagnostic_lost": np.array(["no"] * N)},
    "fewer flags": {"diagnostic_lost": np.zeros(N - 1)},
    "negative deviations": {"diagnostic_deviation": np.full((N, 31), -1.0)},
    "other covariances": {"diagnostic_covariance": np.zeros((N, 15, 3))},
    "a broken body": {"body": np.array("name = ")},
}
TRUTH: dict[str, dict[str, Any]] = {
    "no joints": {"joints": None},
    "infinite joints": {"joints": np.full((N, 15, 3), INF)},
    "no truth at all": {"joints": np.full((N, 15, 3), NAN)},
    "other names": {"joint_names": np.array([f"x{i}" for i in range(15)])},
    "a frame twice": {"frames": np.zeros(N, int)},
    "other frames": {"frames": np.arange(N) + 1000},
    "fps NaN": {"fps": np.array(NAN)},
}


ARRAYS = {"out/clouds/frame_000001.npz": CLOUD, "track/track.npz": TRACK, "truth.npz": TRUTH}


@pytest.mark.parametrize(
    ("name", "fault"), [(name, fault) for name, faults in ARRAYS.items() for fault in faults]
)
def test_arrays(stock: Path, name: str, fault: str) -> None:
    (stock / "track/body.toml").unlink()
    changed_npz(stock / name, **ARRAYS[name][fault])
    refused(FILES[name], stock, Path(name).name)


TRC: dict[str, Callable[[str], str]] = {
    "empty": lambda t: "",
    "no TRC": lambda t: "hello\n" * 10,
    "no frames": lambda t: "\n".join(t.splitlines()[:5]),
    "half the frames": lambda t: "\n".join(t.splitlines()[:9]),
    "unit feet": lambda t: t.replace("\tmm\t", "\tfeet\t"),
    "rate 0": lambda t: t.replace("60\t60\t", "0\t0\t"),
    "a word": lambda t: t.replace("\n1\t", "\none\t"),
    "frame NaN": lambda t: t.replace("\n1\t", "\nnan\t"),
    "a frame twice": lambda t: t.replace("\n2\t", "\n1\t"),
    "an infinite marker": lambda t: t.replace("\n1\t0.000000\t", "\n1\t0.000000\tinf\t", 1),
    "more values": lambda t: t.replace("\n2\t", "\n2\t1\t1\t1\t1\t1\t1\t"),
    "NUL": lambda t: t.replace("\n2\t", "\n\0\t"),
    "no UTF-8": lambda t: t + "\udcff",
}


@pytest.mark.parametrize("fault", TRC)
def test_trc(stock: Path, fault: str) -> None:
    path = stock / "truth.trc"
    text = TRC[fault](path.read_text())
    path.write_text(text, errors="surrogateescape")
    words = ["apf", "evaluate", "track", "--truth", "truth.trc", "-o", "new"]
    refused(words, stock, "truth.trc")


POSES = {
    "none": "", "words": "one two", "too few": "0.1 " * 30, "60 for 31": "0.1 " * 60,
    "NaN": "nan " * 31, "infinite": "0 " * 30 + "inf", "1e9": "1e9 " + "0 " * 30,
    "1e300": "1e300 " + "0 " * 30, "401 digits": "9" * 401 + " 0" * 30, "commas": "0.1, " * 31,
    "binary": "\0\1\2", "hex": "0x10 " * 31,
}  # fmt: skip


@pytest.mark.parametrize("fault", POSES)
def test_poses(stock: Path, fault: str) -> None:
    (stock / "pose.txt").write_text(POSES[fault])
    words = ["apf", "track", "seq", "-o", "new", "--init", "pose.txt", "--volume",
             "-1,1,-1,1,0,2", "--all-cameras"]  # fmt: skip
    refused(words, stock, "pose.txt")


def png_claiming(width: int, height: int) -> bytes:
    """A PNG whose header claims a size."""
    head = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    end = b"IEND"
    parts = (head, b"IDAT" + zlib.compress(b"\0" * 100), end)
    chunks = [struct.pack(">I", len(p) - 4) + p + struct.pack(">I", zlib.crc32(p)) for p in parts]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def encoded(suffix: str) -> bytes:
    picture = np.random.default_rng(1).integers(0, 255, (120, 160, 3), np.uint8)
    return cv2.imencode(suffix, picture)[1].tobytes()


PICTURES: dict[str, bytes] = {
    "nothing": b"",
    "NULs": b"\0" * 1000,
    "half a PNG": encoded(".png")[:5000],
    "a JPEG without end": encoded(".jpg")[:-2],
    "100,000 x 100,000": png_claiming(100_000, 100_000),
    "a PPM that lies": b"P6 100000 100000 255\n" + b"\0" * 100,
    "a PBM of words": b"P1 many few\n",
    "another size": cv2.imencode(".png", np.zeros((48, 64), np.uint8))[1].tobytes(),
    "an SVG": b"<svg xmlns='http://www.w3.org/2000/svg'/>",
}


@pytest.mark.parametrize("fault", PICTURES)
def test_pictures(stock: Path, fault: str) -> None:
    (stock / "seq/masks/c3/0000.png").write_bytes(PICTURES[fault])
    refused(["psfs", "reconstruct", "seq", "-o", "new", "--device", "numpy", *BOX], stock, "c3")


def cut_after_the_index(path: Path) -> None:
    """Write a truncated video whose leading index (as for streaming) promises more frames."""
    data = path.read_bytes()
    start, header = data.index(b"mdat") - 4, data.index(b"moov") - 4
    moov = bytearray(data[header:])
    table = moov.index(b"stco") + 8
    for i in range(int.from_bytes(moov[table : table + 4], "big")):
        at = table + 4 + 4 * i
        offset = int.from_bytes(moov[at : at + 4], "big") + len(moov)
        moov[at : at + 4] = offset.to_bytes(4, "big")
    pictures = data[start:header]
    path.write_bytes(data[:start] + bytes(moov) + pictures[: len(pictures) // 2])


VIDEOS: dict[str, Callable[[Path], Any]] = {
    "nothing": lambda p: p.write_bytes(b""),
    "half": lambda p: cut(p, 0.5),
    "without its index": lambda p: cut(p, 0.8),
    "half behind its index": cut_after_the_index,
    "a picture": lambda p: p.write_bytes(encoded(".png")),
    "another size": lambda p: footage.write_video(p, [50] * 20, size=(48, 64)),
    **({"a pipe": lambda p: (p.unlink(), os.mkfifo(p))} if hasattr(os, "mkfifo") else {}),
    "a folder": lambda p: (p.unlink(), p.mkdir()),
    "a link to nothing": lambda p: (p.unlink(), p.symlink_to("/no/such/file.mp4")),
}


@pytest.mark.parametrize("fault", VIDEOS)
@pytest.mark.parametrize("kind", ["videos", "background"])
def test_videos(stock: Path, fault: str, kind: str) -> None:
    VIDEOS[fault](stock / f"walk/{kind}/cam02.mp4")
    refused(["psfs", "info", str(stock / "walk"), "--no-pictures"], stock, kind)


MESHES: dict[str, tuple[str, bytes]] = {
    "nothing": ("m.obj", b""),
    "no faces": ("m.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
    "a face of nothing": ("m.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99\n"),
    "NaN": ("m.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    "a PLY that lies": ("m.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 999999999\n"
                        b"property float x\nproperty float y\nproperty float z\nend_header\n"),
    "half a GLB": ("m.glb", b"glTF\x02\0\0\0\xff\xff\xff\x7f"),
    "an STL that lies": ("m.stl", b"\0" * 80 + struct.pack("<I", 2**31 - 1) + b"\0" * 50),
    "no format": ("m.xyzzy", b"hello"),
}  # fmt: skip


@pytest.mark.parametrize("fault", MESHES)
def test_meshes(stock: Path, fault: str) -> None:
    name, content = MESHES[fault]
    (stock / name).write_bytes(content)
    words = ["apf", "render", "walk", "track", "-o", "new", "--shape", str(stock / name)]
    refused([*words, "--device", "numpy"], stock, name)
