"""Focal lengths from the metadata of pictures and videos."""

import struct
from pathlib import Path

import av
import numpy as np
import pytest
from helpers import footage
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from cl import InputError
from psfs.calibration.intrinsics import make_cameras_by_metadata
from psfs.cameras.camera import CameraRig
from psfs.footage.layouts.uncalibrated import make_nominal_camera
from psfs.footage.lens import read_lens, share_of_equivalent

KEY = "com.apple.quicktime.camera.focal_length.35mm_equivalent"


def film(path: Path, **metadata: str) -> Path:
    return footage.write_film(path, [0, 0], **metadata)


def atom(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I4s", 8 + len(content), kind) + content


def put_into_track(path: Path, kind: int, value: bytes) -> Path:
    """Write metadata into the last atom, moov, and its track, as iPhones do."""
    lens = "com.apple.quicktime.camera.lens_model"
    keys = b"".join(atom(b"mdta", key.encode()) for key in (lens, KEY))
    values = (1, b"back camera 5.1mm f/1.6"), (kind, value)
    entries = b"".join(
        atom(struct.pack(">I", number), atom(b"data", struct.pack(">II", of, 0) + own))
        for number, (of, own) in enumerate(values, 1)
    )
    handler = atom(b"hdlr", struct.pack(">II4s", 0, 0, b"mdta") + bytes(13))
    table = atom(b"keys", struct.pack(">II", 0, 2) + keys)
    meta = atom(b"meta", handler + table + atom(b"ilst", entries))
    content = path.read_bytes()
    moov, track = content.index(b"moov") - 4, content.index(b"trak") - 4
    assert moov + struct.unpack_from(">I", content, moov)[0] == len(content)
    grown = bytearray(content)
    for at in (moov, track):
        struct.pack_into(">I", grown, at, struct.unpack_from(">I", grown, at)[0] + len(meta))
    end = track + struct.unpack_from(">I", content, track)[0]
    grown[end:end] = meta
    path.write_bytes(grown)
    return path


def take_photo(path: Path, size: tuple[int, int], tags: dict[int, object]) -> Path:
    exif = Image.Exif()
    exif.get_ifd(0x8769).update(tags)
    Image.new("RGB", size).save(path, exif=exif)
    return path


@pytest.mark.parametrize("name", ["a.mov", "a.mp4"])
def test_lens_of_a_video(tmp_path: Path, name: str) -> None:
    assert read_lens(film(tmp_path / name, **{KEY: "26"})).share == pytest.approx(26 / 36)
    for kind, value, mm in (
        (1, b"27.00mm", 27),
        (21, struct.pack(">i", 13), 13),
        (23, struct.pack(">f", 24.5), 24.5),
    ):
        lens = read_lens(put_into_track(film(tmp_path / name), kind, value))
        assert lens is not None and lens.source == f"QuickTime: {mm:g} mm of 35"
        with av.open(str(tmp_path / name)) as container:  # the file is still whole
            assert len(list(container.decode(video=0))) == 2
    assert read_lens(film(tmp_path / name, model="of another maker")) is None


def test_lens_of_a_photo(tmp_path: Path) -> None:
    photo = take_photo(tmp_path / "a.jpg", (403, 302), {0xA405: 26})
    assert read_lens(photo).degrees == pytest.approx(67.3, abs=0.1)
    density = {0x920A: IFDRational(50), 0xA20E: IFDRational(3000000, 886), 0xA210: 2, 0xA002: 4752}
    camera = take_photo(tmp_path / "b.jpg", (475, 317), density)
    assert read_lens(camera).share == pytest.approx(50 * 3000000 / 886 / 25.4 / 4752)
    for tags in ({}, {0xA405: 0}, {0xA405: 2000}, {0x920A: IFDRational(1, 0)}):
        assert read_lens(take_photo(tmp_path / "c.jpg", (40, 30), tags)) is None


def test_a_film_of_36_mm_is_its_own_equivalent() -> None:
    assert share_of_equivalent(36, 3000, 2000) == pytest.approx(1)
    assert share_of_equivalent(36, 1000, 1501) == pytest.approx(1)
    # The same lens in a photo and in a video of its whole width: 26 and 27 mm.
    photo, video = share_of_equivalent(26, 4032, 3024), share_of_equivalent(27, 1920, 1080)
    assert photo == pytest.approx(video, rel=0.005)


def test_damaged_files_state_no_lens(tmp_path: Path) -> None:
    whole = put_into_track(film(tmp_path / "a.mov"), 1, b"27").read_bytes()
    broken = tmp_path / "b.mov"
    nested = b"x" * 8
    for _ in range(3000):
        nested = atom(b"meta", nested)
    random = np.random.default_rng(0)
    for content in (b"", whole[:40], atom(b"moov", nested), struct.pack(">I4sQ", 1, b"moov", 9)):
        broken.write_bytes(content)
        assert read_lens(broken) is None
    for _ in range(200):  # one byte each is wrong
        spoilt = bytearray(whole)
        spoilt[random.integers(len(whole))] = random.integers(256)
        broken.write_bytes(spoilt)
        read_lens(broken)


def test_cameras_by_metadata(tmp_path: Path) -> None:
    rig = CameraRig(tuple(make_nominal_camera(name, (108, 192)) for name in ("a", "b")))
    paths = {"a": film(tmp_path / "a.mov", **{KEY: "27"}), "b": film(tmp_path / "b.mov")}
    with pytest.raises(InputError, match=r"b\.mov: no focal length in the metadata"):
        make_cameras_by_metadata(rig, paths)
    paths["b"] = take_photo(tmp_path / "b.jpg", (300, 400), {0xA405: 26})
    (a, b), stated = make_cameras_by_metadata(rig, paths)
    assert a.K[0, 0] == pytest.approx(0.75 * 192)  # of the longer side, here the height
    assert b.K[0, 0] == pytest.approx(stated["b"].share * 192)
    np.testing.assert_allclose(a.K[:2, 2], [53.5, 95.5])
