"""Frames are read exactly, in order and by jumps, from what cameras and recorders write."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from helpers import footage

from cl import InputError
from psfs.footage.media import open_media
from psfs.sequence import Sequence

WIDTH, HEIGHT, FRAMES = 320, 96, 60
TFF = {"flags": "+ilme+ildct", "x264-params": "tff=1:bframes=2:keyint=25"}
OPEN = {"x264-params": "open-gop=1:bframes=3:keyint=25"}
#: Codec, pixel format, options of the encoder and of the container.
KINDS: dict[str, tuple[str, str, dict[str, str], dict[str, str]]] = {
    "phone.mp4": ("libx264", "yuv420p", {"bf": "3", "g": "25"}, {}),
    "phone.mov": ("libx265", "yuv420p10le", {"x265-params": "keyint=25:log-level=none"}, {}),
    "fragmented.mp4": ("libx264", "yuv420p", OPEN, {"movflags": "frag_keyframe+empty_moov"}),
    "recorder.mkv": ("libx264", "yuv420p", {"g": "1000"}, {}),
    "camcorder.MTS": ("libx264", "yuv420p", OPEN, {}),
    "interlaced.mts": ("libx264", "yuv420p", TFF, {}),
    "interlaced.mov": ("libx264", "yuv420p", TFF | {"x264-params": "bff=1:keyint=25"}, {}),
    "interlaced.mpg": ("mpeg2video", "yuv420p", {"flags": "+ilme+ildct", "g": "12"}, {}),
    "browser.webm": (
        "libvpx",
        "yuv420p",
        {"auto-alt-ref": "1", "lag-in-frames": "16", "threads": "1"},
        {},
    ),
    "vp9.webm": ("libvpx-vp9", "yuv420p", {"lag-in-frames": "16", "cpu-used": "8"}, {}),
    "av1.mp4": ("libsvtav1", "yuv420p", {"preset": "12"}, {}),
    "camera.avi": ("mjpeg", "yuvj420p", {}, {}),
    "unstamped.avi": ("libx264", "yuv420p", {"bf": "3", "g": "25"}, {}),
    "old.wmv": ("wmv2", "yuv420p", {}, {}),
    "studio.mov": ("prores_ks", "yuv422p10le", {}, {}),
    "refresh.mp4": ("libx264", "yuv420p", {"x264-params": "intra-refresh=1:keyint=25"}, {}),
}


def paint(number: int) -> np.ndarray:
    """Draw a frame's number as seven blocks, the first is the lowest bit."""
    bits = [200 * (number >> bit & 1) + 30 for bit in range(7)]
    row = np.repeat(np.array([*bits, 30], np.uint8), WIDTH // 8)
    return np.broadcast_to(row[None, :, None], (HEIGHT, WIDTH, 3))


def number_in(picture: np.ndarray) -> int:
    blocks = picture.mean(axis=(0, 2)).reshape(8, -1)[:, 10:-10].mean(axis=1)
    return sum(int(level > 130) << bit for bit, level in enumerate(blocks))


def film(path: Path, times: list[float] | None = None, kind: str = "phone.mp4") -> Path:
    """Write numbered frames at `times`, s, by default 25 per second."""
    codec, pixels, options, container = KINDS[kind]
    if codec not in av.codecs_available:
        pytest.skip(f"no encoder {codec}")
    with av.open(str(path), "w", container_options=container) as output:
        stream: Any = output.add_stream(codec, rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixels
        if times is not None:
            stream.codec_context.time_base = Fraction(1, 90000)
        for number, time in enumerate(times or np.arange(FRAMES) / 25):
            frame = av.VideoFrame.from_ndarray(paint(number).copy(), format="bgr24")
            frame.time_base = Fraction(1, 90000) if times else Fraction(1, 25)
            frame.pts = round(time / frame.time_base)
            output.mux(stream.encode(frame))
        output.mux(stream.encode())
    return path


def check(path: Path, expected: list[int]) -> np.ndarray:
    """Assert which frames a video shows, in order and by jumps; return their times."""
    media = open_media("a", [path])
    assert [number_in(picture) for picture in media] == expected
    decoder = media.open()
    for index in (-1, 0, 31, 13, 14, 30, 3, -2):
        index %= len(expected)
        assert number_in(decoder.read(index)) == expected[index]
    assert media.times is not None
    return media.times


@pytest.mark.parametrize("kind", KINDS)
def test_containers_and_codecs(tmp_path: Path, kind: str) -> None:
    path = film(tmp_path / kind, kind=kind)
    times = check(path, list(range(FRAMES)))
    np.testing.assert_allclose(times, np.arange(FRAMES) / 25, atol=0.00051)
    assert open_media("a", [path]).fps == 25


@pytest.mark.parametrize("kind", ["phone.mp4", "recorder.mkv", "vp9.webm"])
def test_a_variable_rate(tmp_path: Path, kind: str) -> None:
    times = np.cumsum(np.random.default_rng(0).choice([0.03, 0.04, 0.2], FRAMES)).tolist()
    found = check(film(tmp_path / kind, times, kind), list(range(FRAMES)))
    np.testing.assert_allclose(found, np.array(times) - times[0], atol=0.00051)


@pytest.mark.parametrize("ending", ["mp4", "mov"])
def test_a_trimmed_recording(tmp_path: Path, ending: str) -> None:
    """Its edit list hides what comes before the start that somebody chose."""
    trimmed = tmp_path / f"trimmed.{ending}"
    whole = film(tmp_path / f"whole.{ending}", kind="phone.mp4")
    with av.open(str(whole)) as source, av.open(str(trimmed), "w") as output:
        stream = source.streams.video[0]
        copy = output.add_stream_from_template(stream)
        assert stream.time_base is not None
        for packet in source.demux(stream):
            if packet.pts is not None and packet.dts is not None:
                packet.pts -= round(Fraction(30, 25) / stream.time_base)
                packet.dts -= round(Fraction(30, 25) / stream.time_base)
                packet.stream = copy
                output.mux(packet)
    assert trimmed.stat().st_size > 0.9 * whole.stat().st_size
    check(trimmed, list(range(30, FRAMES)))


def test_a_recording_that_was_split_between_keys(tmp_path: Path) -> None:
    whole = film(tmp_path / "whole.mts", kind="camcorder.MTS").read_bytes()
    (tmp_path / "part.mts").write_bytes(whole[len(whole) // 8 // 188 * 188 :])
    first = number_in(next(iter(open_media("a", [tmp_path / "part.mts"]))))
    assert first > 0
    path = tmp_path / "part.mts"
    assert [number_in(picture) for picture in open_media("a", [path])] == [*range(first, FRAMES)]


def test_fields_are_interpolated(tmp_path: Path) -> None:
    """A bar that moves between the two fields has straight edges."""
    path = tmp_path / "a.mov"
    codec, pixels, options, _ = KINDS["interlaced.mov"]
    with av.open(str(path), "w") as output:
        stream: Any = output.add_stream(codec, rate=25, options=options | {"crf": "5"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixels
        for number in range(20):
            picture = np.full((HEIGHT, WIDTH, 3), 40, np.uint8)
            for field in range(2):  # the lower comes first
                start = 12 * number + (6 if field == 0 else 0)
                picture[field::2, start : start + 40] = 200
            output.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="bgr24")))
        output.mux(stream.encode())
    in_order = list(open_media("a", [path]))
    decoder = open_media("a", [path]).open()
    for index in (19, 7, 12):
        picture = decoder.read(index)
        np.testing.assert_array_equal(picture, in_order[index])
        edges = (picture[8:-8, :, 0] > 120).argmax(axis=1)
        assert np.ptp(edges) <= 2, index


def test_cameras_of_variable_rate_go_together_by_their_times(tmp_path: Path) -> None:
    """Each of three phones lost as many frames, at other times; nothing is more than half a frame
    from the others."""
    tables = footage.tables(footage.rig(3))
    for table in tables.values():
        table["size"] = [WIDTH, HEIGHT]
    (tmp_path / "videos").mkdir()
    lost = {"cam01": range(20, 26), "cam02": range(40, 46), "cam03": range(50, 56)}
    for name, gap in lost.items():
        times = [k / 25 + (0.24 if k >= gap.start else 0) for k in range(FRAMES - len(gap))]
        film(tmp_path / "videos" / f"{name}.mp4", times)
    footage.write_toml(tmp_path / "calibration.toml", tables)
    sequence = Sequence.open(tmp_path)
    common = [k for k in range(FRAMES) if not any(k in gap for gap in lost.values())]
    shown = [[number_in(image) for image in frame.images] for frame in sequence]
    for view, gap in enumerate(lost.values()):
        numbers = [row[view] for row in shown]
        assert [n + (len(gap) if n >= gap.start else 0) for n in numbers] == common
    assert [number_in(image) for image in sequence.read(30).images] == shown[30]
    assert any("cam02 lacks 6 frames, 6 of them after its frame 39" in n for n in sequence.notes)


def test_a_frame_that_is_not_there(tmp_path: Path) -> None:
    """A damaged packet is named where it is read; frames before and after it are read."""
    path = film(tmp_path / "a.avi", kind="camera.avi")
    with av.open(str(path)) as container:
        packet = [packet for packet in container.demux(video=0) if packet.size][30]
        position, size = packet.pos, packet.size
    data = bytearray(path.read_bytes())
    data[position : position + size] = bytes(size)
    path.write_bytes(data)
    decoder = open_media("a", [path]).open()
    with pytest.raises(InputError, match=r"a\.avi: frame 30 of \d+ cannot be decoded"):
        decoder.read(30)
    assert number_in(decoder.read(29)) == 29
