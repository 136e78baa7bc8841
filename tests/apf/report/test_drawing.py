"""Drawing tracked bodies over pictures."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import scenes, tracks

from apf.report.drawing import LOST, SIDES, Figure, draw_mosaic, find_window, write_overlay
from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.sequence import Frame


def camera(name: str, angle: float, size: tuple[int, int] = (320, 240)) -> Camera:
    """Three metres from the walker's circle, looking at its middle."""
    centre = [4 * np.cos(angle), 4 * np.sin(angle), 1.0]
    return scenes.pinhole(name, centre, [0, 0, 1], size, size[0])


class Footage:
    """What `write_overlay` uses of a Sequence."""

    folder = Path("walk")

    def __init__(self, sizes: list[tuple[int, int]]) -> None:
        angles = 2 * np.pi * np.arange(len(sizes)) / len(sizes)
        pairs = enumerate(zip(angles, sizes, strict=True))
        self.rig = CameraRig(tuple(camera(f"cam{k}", *each) for k, each in pairs))

    def __len__(self) -> int:
        return 6

    def read(self, index: int) -> Frame:
        shape = (len(self.rig), self.rig.height, self.rig.width, 3)
        return Frame(index, np.full(shape, 90, np.uint8), None)

    def select_frames(self, indices: list[int]) -> Iterator[Frame]:
        return map(self.read, indices)


def nearest(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """(h, w) where the picture has about this RGB colour."""
    return np.abs(image.astype(int) - colour[::-1]).max(axis=-1) < 40


def mosaic_of(sequence: Footage, views: list[int] | None = None) -> np.ndarray:
    return draw_mosaic(sequence.read(0), sequence.rig, [Figure(tracks.walker(6))], views)


def test_sides_have_their_colours_where_the_limbs_are() -> None:
    view = camera("front", np.pi / 2, (640, 480))
    track = tracks.walker(frames=6)
    drawn, joints = np.full((480, 640, 3), 90, np.uint8), track.joints[0]
    Figure(track).draw(drawn, view, 0)
    pixels, _ = view.project(joints)
    for side, prefix in (("left", "l_"), ("right", "r_")):
        limb = [i for i, name in enumerate(track.joint_names) if name.startswith(prefix)]
        rows, columns = np.nonzero(nearest(drawn, SIDES[side]))
        assert len(rows) > 200
        assert pixels[limb, 1].min() - 15 < rows.min() < rows.max() < pixels[limb, 1].max() + 50
        assert abs(np.median(columns) - np.median(pixels[limb, 0])) < 15
    assert nearest(drawn, SIDES["middle"]).sum() > 200
    changed = np.any(drawn != 90, axis=-1)
    assert 0.005 < changed.mean() < 0.3
    figure = Figure(tracks.lose(track, 1), number=1)  # lost people have a colour of their own
    assert not (figure.colour_cones(0) == LOST).any()
    assert (figure.colour_cones(1) == LOST).all() and (figure.colour_edges(1) == LOST).all()


def test_people_are_drawn_while_they_are_seen() -> None:
    sequence, both, names = Footage([(320, 240)] * 2), tracks.pair(), ("person1", "person2")
    figures = [
        Figure(track, name, k, seen)
        for k, (track, name, seen) in enumerate(zip(both, names, both.seen, strict=True))
    ]
    for frame, n in zip(range(6), both.counts, strict=True):
        one, all_ = (
            draw_mosaic(sequence.read(frame), sequence.rig, shown)
            for shown in (figures[:1], figures)
        )
        assert ((one != all_).any(-1).sum() > 500) == (n == 2)


def test_mosaic_is_bounded_and_even_and_stretches_nothing() -> None:
    sequence = Footage([(320, 240), (160, 240)])
    picture = mosaic_of(sequence)
    assert picture.shape == (240, 640, 3)
    assert not picture[:, 480:].any()  # beside the narrow picture
    one = mosaic_of(sequence, [1])
    np.testing.assert_array_equal(one[:, :160], picture[:, 320:480])
    masks = Frame(0, None, np.full((2, 240, 320), 255, np.uint8))  # drawn on without images
    drawn = draw_mosaic(masks, sequence.rig, [Figure(tracks.walker(6))], [0])
    assert 100 < np.median(drawn) < 200 and nearest(drawn, SIDES["right"]).sum() > 50
    for count in (1, 5, 12):
        picture = mosaic_of(Footage([(641, 481)] * count))
        height, width = picture.shape[:2]
        assert width <= 1920 and height <= 1080 and width % 2 == height % 2 == 0
        # Every camera has its tile: the grey background fills at least the tiles' share.
        assert np.any(picture > 60, axis=-1).mean() > 0.5


def test_a_window_shows_everybody_and_little_else() -> None:
    """Of the same size in all pictures; the body is drawn where it is in the whole picture."""
    sequence, figure = Footage([(1280, 960)] * 4), Figure(tracks.walker(6))
    corners, size = find_window(sequence.rig, [figure])
    assert (size % 16 == 0).all() and size[0] < 1280
    for view, camera in enumerate(sequence.rig):
        pixels, _ = camera.project(figure.track.joints.reshape(-1, 3))
        assert ((pixels > corners[view]) & (pixels < corners[view] + size)).all()
    frame, (left, top) = sequence.read(0), corners[1]
    part = draw_mosaic(frame, sequence.rig, [figure], [1], (corners, size))
    whole = draw_mosaic(frame, sequence.rig, [figure], [1])
    here = whole[top : top + size[1], left : left + size[0]]
    np.testing.assert_array_equal(part[80:], here[80:])  # below the label


@pytest.mark.parametrize(("frames", "fps"), [([1, 3, 5], 30), ([0, 1, 2, 5], 60), ([2], 60)])
def test_video_has_every_frame(tmp_path: Path, frames: list[int], fps: float) -> None:
    sequence = Footage([(320, 240)] * 2)
    walk = tracks.walker(frames=len(frames))
    track = replace(walk, frames=np.array(frames))
    calls: list[None] = []
    path = tmp_path / "out" / "overlay.mp4"
    write_overlay(path, sequence, track, progress=lambda: calls.append(None))
    capture = cv2.VideoCapture(str(path))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == len(frames) == len(calls)
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(fps)
    _, image = capture.read()
    assert image.shape[0] == 240 and image.shape[1] < 640  # cropped to the person
    assert np.abs(image.astype(int) - 90).max() > 60  # the body
    assert [p.name for p in path.parent.iterdir()] == ["overlay.mp4"]


def test_lost_frames_say_so(tmp_path: Path) -> None:
    """Beside the frame's number, where the strip for the text grows wider."""
    sequence, track = Footage([(320, 240)]), tracks.walker(frames=2)
    lost = replace(track, diagnostics={"lost": np.array([False, True])})
    frames = []
    for name, shown in (("a", track), ("b", lost)):
        write_overlay(tmp_path / f"{name}.mp4", sequence, shown)
        capture = cv2.VideoCapture(str(tmp_path / f"{name}.mp4"))
        frames.append([capture.read()[1].astype(int) for _ in range(2)])
    first, second = (np.abs(a - b)[:24].max() for a, b in zip(*frames, strict=True))
    assert first < 20 < 60 < second


class Damaged(Footage):
    def read(self, index: int) -> Frame:
        if index == 2:
            raise InputError("cam0.mp4: frame 2 of 6 cannot be decoded")
        return super().read(index)


@pytest.mark.parametrize(
    ("kind", "frames", "message"),
    [
        (Footage, [4, 5, 6], "frames 4..6; the sequence 6"),
        (Footage, [], "no frame"),
        (Damaged, range(6), "frame 2"),
    ],
)
def test_frames_that_fail_leave_no_video(
    tmp_path: Path, kind: type[Footage], frames: Sequence[int], message: str
) -> None:
    track = replace(tracks.walker(frames=len(frames)), frames=np.array(frames, int))
    with pytest.raises(InputError, match=message):
        write_overlay(tmp_path / "a.mp4", kind([(320, 240)]), track)
    assert list(tmp_path.iterdir()) == []
