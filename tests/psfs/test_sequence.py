"""Sequences: folder layouts, settings, frames, background, decoding ahead."""

import concurrent.futures.thread
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import footage, scenes
from helpers.camera_texts import projections
from helpers.shared import shared_data
from PIL import Image

from cl import InputError
from psfs.background import gaussian
from psfs.background.gaussian import (
    STD_FLOOR,
    clipped_moments,
    estimate_background,
    median_moments,
)
from psfs.common.pictures import read_picture
from psfs.diagnostics.sequence_info import SequenceInfo
from psfs.footage.media import open_media
from psfs.footage.memory import store
from psfs.footage.threads import prefetch
from psfs.footage.video import VideoDecoder
from psfs.output.reconstruction_folder import reopen_sequence, sequence_facts
from psfs.sequence import Sequence


def levels(frame) -> list[int]:
    return frame.images[:, 20, 30, 0].astype(int).tolist()


def expected(index: int, views: int) -> list[int]:
    return [footage.grey(index, view) for view in range(views)]


def test_native_videos(tmp_path: Path) -> None:
    sequence = Sequence.open(footage.native(tmp_path / "walk"))
    assert (sequence.name, len(sequence), sequence.fps) == ("walk", 12, 25)
    assert sequence.background_kind == "gaussian"
    assert sequence.volume is None and sequence.notes == []
    frames = list(sequence)
    assert [frame.index for frame in frames] == list(range(12))
    assert frames[0].images.shape == (3, 48, 64, 3) and frames[0].images.dtype == np.uint8
    assert frames[0].masks is None
    for frame in frames:
        np.testing.assert_allclose(levels(frame), expected(frame.index, 3), atol=footage.LOSS)
    for index in (7, 3, 11, 0, -1):
        np.testing.assert_allclose(
            levels(sequence.read(index)), expected(index % 12, 3), atol=footage.LOSS
        )
    with pytest.raises(IndexError):
        sequence.read(12)
    assert [frame.index for frame in sequence.frames(slice(1, None, 4))] == [1, 5, 9]
    background = sequence.background
    assert background.mean.shape == background.std.shape == (3, 48, 64, 3)
    assert background.mean.dtype == background.std.dtype == np.float32
    empty = [next(iter(media))[5, 5, 0] for media in sequence.footage.background]
    np.testing.assert_allclose(empty, [100, 101, 102], atol=footage.LOSS)
    assert sequence.background is background


def test_ascending_reads_do_not_seek(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    footage.write_video(tmp_path / "a.mp4", [footage.grey(i, 0) for i in range(40)])
    decoder = open_media("a", [tmp_path / "a.mp4"]).open()
    monkeypatch.setattr(VideoDecoder, "_jump", None)
    for index in (0, 1, 5, 6, 30):
        assert decoder.read(index)[9, 9, 0] == pytest.approx(footage.grey(index, 0), abs=5)
    decoder.close()


def test_frames_that_are_kept_are_decoded_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, decoded = footage.native(tmp_path / "walk"), list[int]()
    expected = {frame.index: frame.images for frame in Sequence.open(folder)}
    read = VideoDecoder.read

    def counted(self: VideoDecoder, index: int, *into: np.ndarray | None) -> np.ndarray:
        decoded.append(index)
        return read(self, index, *into)

    monkeypatch.setattr(VideoDecoder, "read", counted)
    sequence = Sequence.open(folder)
    sequence.keep_frames()
    frames = [sequence.read(5), *sequence.frames(slice(3)), *sequence.frames(), sequence.read(5)]
    for frame in frames:
        np.testing.assert_array_equal(frame.images, expected[frame.index])
    assert sorted(decoded) == sorted(3 * [*range(12)])
    # Nothing is kept of a sequence that is too long for the memory.
    monkeypatch.setattr("psfs.sequence.frame_memory_limit", lambda: 12 * 3 * 3 * 48 * 64 - 1)
    longer = Sequence.open(folder)
    longer.keep_frames()
    decoded.clear()
    assert len([*longer, *longer]) == 24 and len(decoded) == 3 * 24


def test_native_images_masks_and_one_plate(tmp_path: Path) -> None:
    rig = footage.rig(2)
    footage.write_toml(tmp_path / "Calib_scene.toml", footage.tables(rig))
    for view, camera in enumerate(rig):
        for frame in range(3):  # 9 before 10, though "10" sorts before "9"
            name = f"{camera.name}/{frame + 8}.png"
            footage.write_image(tmp_path / "images" / name, footage.grey(frame, view))
            footage.write_image(tmp_path / "masks" / name, 255 if frame == 1 else 0)
        footage.write_image(tmp_path / "background" / f"{camera.name}.png", 50 + view)
        footage.write_image(tmp_path / "background" / f"{camera.name}_old.png", 7)
    with_masks = Sequence.open(tmp_path, fps=10)
    assert with_masks.background_kind == "masks" and with_masks.background is None
    frames = list(with_masks)
    assert [levels(frame) for frame in frames] == [expected(i, 2) for i in range(3)]
    assert [frame.masks.mean() for frame in frames] == [0, 255, 0]
    plain = Sequence.open(tmp_path, background="gaussian")
    assert plain.read(0).masks is None
    assert [next(iter(media))[0, 0, 0] for media in plain.footage.background] == [50, 51]


@pytest.mark.parametrize(
    "kind", ["cut-out", "black outside", "8 of 16 bits", "16 bits", "palette", "0 and 1"]
)
def test_masks_are_read_by_their_meaning(tmp_path: Path, kind: str) -> None:
    """The person is the left half: alpha says so whatever the colours, else the brightest one."""
    inside = np.zeros((48, 64), np.uint8)
    inside[:, :32] = 255
    colours = np.random.default_rng(0).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    picture = {
        "cut-out": np.dstack([colours, inside]),
        "black outside": np.dstack([colours * (inside[..., None] > 0), inside]),
        "8 of 16 bits": inside.astype(np.uint16),
        "16 bits": inside.astype(np.uint16) * 257,
        "0 and 1": inside // 255,
        "palette": np.dstack([inside * 0, inside * 0, inside // 255 * 128]),
    }[kind]
    rig = footage.rig(1)
    footage.write_take(tmp_path, rig, [[picture]])
    np.testing.assert_array_equal(Sequence.open(tmp_path).read(0).masks[0] > 127, inside > 0)


def test_pictures_are_turned_as_their_exif_says(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # a quarter to the right
    upper = Image.fromarray(
        np.repeat(np.arange(48) < 24, 64).reshape(48, 64).astype(np.uint8) * 255
    )
    upper.save(tmp_path / "a.jpg", exif=exif)
    picture = read_picture(tmp_path / "a.jpg")
    assert picture.shape == (64, 48, 3) and picture[:, 30:].min() > 240 > 10 > picture[:, :18].max()


@pytest.mark.parametrize("place", ["{}.MTS", "{}.m2ts", "{}/GX010012.MP4"])
def test_videos_of_camcorders_and_of_cards(tmp_path: Path, place: str) -> None:
    footage.native(tmp_path)
    for path in sorted((tmp_path / "videos").iterdir()):
        moved = tmp_path / "videos" / place.format(path.stem)
        moved.parent.mkdir(exist_ok=True)
        path.rename(moved)
    np.testing.assert_allclose(levels(Sequence.open(tmp_path).read(4)), expected(4, 3), atol=5)


def test_videos_that_are_not_seen_are_named(tmp_path: Path) -> None:
    footage.native(tmp_path)
    for path in (tmp_path / "videos").iterdir():
        path.rename(path.with_suffix(".r3d"))
    with pytest.raises(InputError, match=r"found .*videos/cam01\.r3d.*expected .*\.mp4"):
        Sequence.open(tmp_path)


def test_views_of_different_sizes_are_padded(tmp_path: Path) -> None:
    tables = footage.tables(footage.rig(2))
    tables["cam02"]["size"] = [40, 56]
    footage.write_toml(tmp_path / "calibration.toml", tables)
    footage.write_image(tmp_path / "images/cam01/0.png", 100)
    footage.write_image(tmp_path / "images/cam02/0.png", 200, (40, 56))
    sequence = Sequence.open(tmp_path)
    images = sequence.read(0).images
    assert images.shape == (2, 56, 64, 3)
    assert (images[0, :48] == 100).all() and (images[0, 48:] == 0).all()
    assert (images[1, :, :40] == 200).all() and (images[1, :, 40:] == 0).all()
    assert sequence.background_kind == "frames"
    assert (sequence.background.mean[0, 48:] == 0).all()
    assert (sequence.background.std >= STD_FLOOR).all()


def test_unequal_counts_use_the_shortest(tmp_path: Path) -> None:
    footage.native(tmp_path)
    footage.write_video(tmp_path / "videos/cam02.mp4", [50] * 9)
    sequence = Sequence.open(tmp_path)
    assert len(sequence) == len(list(sequence)) == 9
    (warning,) = SequenceInfo(sequence).warnings
    assert warning.startswith("unequal numbers of images: cam01 12, cam02 9, cam03 12; the first 9")


def test_settings_file_flags_and_layout(tmp_path: Path) -> None:
    footage.native(tmp_path)
    settings = {
        "unit": "cm",
        "up": "y",
        "fps": 50,
        "background": "frames",
        "volume": [[-1, -1, 0], [1, 1, 2]],
        "cameras": ["cam03", "cam01"],
    }
    footage.write_toml(tmp_path / "sequence.toml", settings)
    sequence = Sequence.open(tmp_path, unit="m", background="gaussian")
    assert sequence.rig.names == ["cam03", "cam01"]
    original = footage.rig(3).centres[[2, 0]]
    np.testing.assert_allclose(sequence.rig.centres, original[:, [2, 0, 1]], atol=1e-9)
    assert sequence.fps == 50 and sequence.background_kind == "gaussian"
    assert sequence.volume[1].tolist() == [1, 1, 2]
    np.testing.assert_allclose(
        levels(sequence.read(2)), np.array(expected(2, 3))[[2, 0]], atol=footage.LOSS
    )
    np.testing.assert_allclose(
        Sequence.open(tmp_path, up="z").rig.centres, original / 100, atol=1e-9
    )


def test_a_table_says_whose_videos_are(tmp_path: Path) -> None:
    """Videos from 0 beside cameras from 1 are ambiguous; the message shows the table."""
    footage.native(tmp_path)
    for number in (1, 2, 3):
        (tmp_path / f"videos/cam0{number}.mp4").rename(tmp_path / f"videos/cam{number - 1}.mp4")
    with pytest.raises(InputError, match=r"cam0 for cam01.*\[files\] cam01 = 'cam0'"):
        Sequence.open(tmp_path)
    names = {"cam01": "cam0", "cam02": "cam1", "cam03": "cam2"}
    sequence = Sequence.open(tmp_path, files=names)
    assert sequence.notes == () or not any("order" in note for note in sequence.notes)
    np.testing.assert_allclose(levels(sequence.read(4)), expected(4, 3), atol=footage.LOSS)
    with pytest.raises(InputError, match="`files` says cam7 for cam01"):
        Sequence.open(tmp_path, files={"cam01": "cam7"})
    with pytest.raises(InputError, match="twice"):
        Sequence.open(tmp_path, files={"cam01": "cam0", "cam02": "cam0"})


def test_flat_folder_with_masks_for_all_and_images_for_some(tmp_path: Path) -> None:
    rig = footage.rig(3)
    for view, camera in enumerate(rig):
        for frame in (1, 2):
            footage.write_image(tmp_path / f"silh_{camera.name}_{frame:05d}.pbm", 255 * (frame - 1))
            if view:
                footage.write_image(tmp_path / f"{camera.name}_{frame:05d}.png", 9)
    (tmp_path / "projection_matrices.txt").write_text(projections(rig))
    sequence = Sequence.open(tmp_path)
    assert len(sequence) == 2 and sequence.background_kind == "masks"
    assert [frame.masks.mean() for frame in sequence] == [0, 255]
    assert sequence.read(0).images is None
    assert any("none for cam01" in note for note in sequence.notes)


def test_threshold_masks_grow_by_dilation_less_erosion(tmp_path: Path) -> None:
    rig = footage.rig(1)
    image = np.zeros((48, 64, 3), np.uint8)
    image[20:25, 30:40] = 60
    footage.write_take(tmp_path, rig, [[image]], "images")
    sequence = Sequence.open(tmp_path, background="threshold", threshold=0.2, dilate=5, erode=3)
    rows, columns = np.nonzero(sequence.read(0).masks[0])
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (18, 26, 28, 41)
    assert not Sequence.open(tmp_path, background="threshold", threshold=0.3).read(0).masks.any()


def test_background_moments() -> None:
    random = np.random.default_rng(3)
    frames = random.normal(120, 4, (60, 12, 9, 3))
    frames[7, 3:6] += 90  # somebody's shadow passes
    frames = frames.clip(0, 255).round().astype(np.uint8)
    for mean, std in (clipped_moments(list(frames)), median_moments(frames)):
        np.testing.assert_allclose(mean, 120, atol=3.5)
        assert 3.5 < std.mean() < 4.6 and std[3:6].mean() < 4.8
    odd = random.integers(0, 256, (7, 5, 3, 3)).astype(np.uint8)
    np.testing.assert_array_equal(median_moments(odd)[0], np.median(odd, axis=0))
    many = random.integers(0, 256, (600, 3, 4, 3)).astype(np.uint8)  # the sums of several lots
    np.testing.assert_allclose(clipped_moments(list(many))[0], many.mean(0), rtol=1e-6)
    constant = np.full((50, 4, 4, 3), 9, np.uint8)
    mean, std = clipped_moments(list(constant))
    assert (mean == 9).all() and (std >= STD_FLOOR).all()


def test_plates_are_the_same_held_in_bands_or_decoded_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    random, rig = np.random.default_rng(5), scenes.ring(1, (64, 48))
    for number in range(5):
        picture = random.integers(0, 255, (48, 64, 3)).astype(np.uint8)
        assert cv2.imwrite(str(tmp_path / f"{number}.png"), picture)
    media = [open_media("c0", sorted(tmp_path.iterdir()))]
    found = []
    for n_bytes in (0, 2**26):
        monkeypatch.setattr(gaussian, "_HELD_BYTES", n_bytes)
        monkeypatch.setattr(gaussian, "_BAND_BYTES", 2**15)  # ten rows
        found.append(estimate_background(rig, media))
    assert found[0].mean.std() > 1 and found[0].std.std() > 1
    np.testing.assert_array_equal(found[0].mean, found[1].mean)
    np.testing.assert_array_equal(found[0].std, found[1].std)


def test_prefetch_stops_cleanly_and_passes_errors_on() -> None:
    closed = threading.Event()

    def numbers(fail_at: int | None = None) -> Iterator[int]:
        try:
            for i in range(10**6):
                if i == fail_at:
                    raise InputError(f"no {i}")
                yield i
        finally:
            closed.set()

    before = threading.active_count()
    ahead = prefetch(numbers(), 2)
    assert [next(ahead), next(ahead)] == [0, 1]
    ahead.close()
    assert closed.is_set() and threading.active_count() == before
    closed.clear()
    seen = []
    with pytest.raises(InputError, match="no 3"):
        for value in prefetch(numbers(3), 2):
            seen.append(value)
    assert seen == [0, 1, 2] and closed.is_set() and threading.active_count() == before


def test_prefetch_ends_while_another_thread_starts() -> None:
    """Garbage collection may end it inside a `submit`, whose lock must then not be waited for."""
    ahead = prefetch((i for i in range(100)), 2)
    assert next(ahead) == 0
    ended = threading.Thread(target=ahead.close, daemon=True)
    with concurrent.futures.thread._global_shutdown_lock:
        ended.start()
        ended.join(10)
        assert not ended.is_alive()


def test_prefetch_is_bounded() -> None:
    made: list[int] = []
    ahead = prefetch((made.append(i) or i for i in range(100)), 3)
    assert next(ahead) == 0
    time.sleep(0.15)
    assert len(made) <= 5  # one taken, three waiting, one in hand
    ahead.close()


@pytest.mark.parametrize(
    ("name", "frames", "views", "fps", "kind", "size"),
    [
        ("synth_walk_4cam", 172, 4, 60, "gaussian", (480, 640)),
        ("bodytrack_walk", 4, 4, 60, "masks", (480, 640)),
        ("middlebury_dino", 1, 15, 1, "threshold", (480, 640)),
        ("dancer8", 1, 8, 30, "masks", (582, 780)),
    ],
)
def test_real_folders(name: str, frames: int, views: int, fps: int, kind: str, size) -> None:
    sequence = Sequence.open(shared_data(name))
    assert (len(sequence), len(sequence.rig), sequence.fps) == (frames, views, fps)
    assert sequence.background_kind == kind and SequenceInfo(sequence).warnings == []
    frame = sequence.read(frames - 1)
    if frame.images is not None:
        assert frame.images.shape == (views, *size, 3)
    if kind in ("masks", "threshold"):
        assert frame.masks.shape == (views, *size)
        assert 0.01 < (frame.masks > 127).mean() < 0.6


def test_footage_on_another_drive_is_opened_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence = Sequence.open(footage.native(tmp_path / "s", frames=2))

    def fail(*_: object) -> str:
        raise ValueError("path is on mount 'D:', start on mount 'C:'")

    with monkeypatch.context() as patch:
        patch.setattr("os.path.relpath", fail)
        facts = sequence_facts(sequence, tmp_path / "out", {}, {})
    assert "relative" not in facts
    again = reopen_sequence(facts, tmp_path / "out" / "summary.json", 1)
    assert again.rig.names == sequence.rig.names


def test_a_sequence_opened_again_shares_results_of_unchanged_footage(tmp_path: Path) -> None:
    folder, other = footage.native(tmp_path / "walk"), footage.native(tmp_path / "other")
    computed: list[str] = []

    def result(sequence: Sequence, text: str) -> str:
        return sequence.recall("stage", lambda: computed.append(text) or text)

    assert result(Sequence.open(folder), "first") == "first"
    used = Sequence.open(folder)
    assert all(camera.max_radius2 > 0 for camera in used.rig)  # computed once, and kept
    assert result(used, "again") == "first"
    assert Sequence.open(folder).background is Sequence.open(folder).background
    assert result(Sequence.open(folder, cameras=["cam01", "cam02"]), "two cameras") == "two cameras"
    turned = Sequence.open(folder)
    moved = turned.with_rig(turned.rig.scaled(0.5))
    assert result(moved, "another rig") == "another rig"
    footage.write_video(folder / "videos" / "cam01.mp4", [50] * 12)
    assert result(Sequence.open(folder), "a new video") == "a new video"
    assert result(Sequence.open(other), "another take") == "another take"
    assert result(Sequence.open(folder), "forgotten") == "forgotten"


def test_a_large_result_is_not_kept(tmp_path: Path) -> None:
    folder = footage.native(tmp_path / "walk")
    for number in range(2):
        found = Sequence.open(folder).recall("stage", lambda n=number: n, lambda _: False)
        assert found == number


def test_a_command_gets_the_results_of_the_process_that_starts_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = footage.native(tmp_path / "walk")
    Sequence.open(folder).recall("stage", lambda: "found")
    monkeypatch.setenv(*store(tmp_path / "results").popitem())
    monkeypatch.setattr("psfs.footage.memory._KNOWN", {})
    assert Sequence.open(folder).recall("stage", lambda: "computed") == "found"
