"""OpenPose's JSON in the layouts of several programs, OpenCap's pickles, DeepLabCut's tables,
persons."""

import json
import pickle
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import footage, scenes
from helpers.keypoints import list_person, of_poses, write_deeplabcut, write_openpose

import apf
import psfs
from apf.body.toml import load_body
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.readers.orders import BODY_25, COCO_17, MEDIAPIPE
from psfs.cameras.camera import CameraRig

RIG = scenes.ring(4, size=(640, 480))
BODY = load_body("song31")
FRAMES = 6
#: Where programs put the file of a camera and frame.
LAYOUTS: dict[str, Callable[[str, int], str]] = {
    "pose2sim": lambda camera, frame: f"pose/{camera}_json/{camera}_{frame:06d}.json",
    "pose2sim_older": lambda camera, frame: f"pose-2d/{camera}_json/{camera}.{frame:04d}.json",
    "sports2d": lambda camera, frame: f"{camera}_Sports2D/{camera}_json/{camera}_{frame:06d}.json",
    "openpose": lambda camera, frame: f"{camera}/take_{frame:012d}_keypoints.json",
    "in_one_folder": lambda camera, frame: f"{camera}_{frame:012d}_keypoints.json",
    "from_1": lambda camera, frame: f"{camera}/{frame + 1}.json",
    "from_120": lambda camera, frame: f"{camera}/{camera}_{frame + 120}.json",
}


def walked(dx: float = 0.0, dy: float = 0.0, rig: CameraRig = RIG, **options: Any) -> Keypoints:
    poses = np.tile(BODY.rest_pose, (FRAMES, 1))
    poses[:, 0] += dx + 0.02 * np.arange(FRAMES)
    poses[:, 1] += dy
    return of_poses(rig, BODY, poses, **options)


def same(read: Keypoints, written: Keypoints) -> None:
    assert (read.names, read.camera_names) == (written.names, written.camera_names)
    np.testing.assert_array_equal(read.points, written.points)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_openpose_and_arrays_of_the_same_points_are_equal(tmp_path: Path, layout: str) -> None:
    written = walked(names=BODY_25)
    write_openpose(tmp_path / "json", written, path_of=LAYOUTS[layout])
    (tmp_path / "json" / "calibration.json").write_text("{}")  # not every JSON is a frame
    (tmp_path / "json" / "notes_1.json").write_text('{"y": 3, "x": 1}')
    np.save(tmp_path / "points.npy", written.points)
    read = Keypoints.open(tmp_path / "json", RIG)
    same(read, written)
    assert read.notes == ()
    same(Keypoints.open(tmp_path / "points.npy", RIG), written)


@pytest.mark.parametrize("form", ["list", "cmu", "open"])
def test_alphaposes_results_of_a_video(tmp_path: Path, form: str) -> None:
    """The first two pictures show nobody, and are missing in the file."""
    written = walked(names=COCO_17)
    written.points[:, :2] = np.nan
    for view, camera in enumerate(written.camera_names):
        path = tmp_path / camera / "alphapose-results.json"
        path.parent.mkdir()
        people = [list_person(points.astype(float)) for points in written.points[view]]
        flat = {f"{k}.jpg": people[k]["pose_keypoints_2d"] for k in range(2, FRAMES)}
        content: Any = {
            "list": [{"image_id": k, "keypoints": v, "score": 1.0} for k, v in flat.items()],
            "cmu": {k: {"version": "a", "bodies": [{"joints": v}]} for k, v in flat.items()},
            "open": {k: {"people": [{"pose_keypoints_2d": v}]} for k, v in flat.items()},
        }[form]
        path.write_text(json.dumps(content))
    same(Keypoints.open(tmp_path, RIG), written)
    film = footage.native(tmp_path / "long", views=len(RIG), frames=FRAMES + 3)
    longer = Keypoints.open(tmp_path, psfs.open_sequence(film))
    np.testing.assert_array_equal(longer.points[:, :FRAMES], written.points)
    assert np.isnan(longer.points[:, FRAMES:]).all()
    assert f"frames 0 to {FRAMES - 1} alone" in longer.notes[-1]
    other = tmp_path / "other"
    other.mkdir()
    (other / "results.json").write_text("[1]")
    with pytest.raises(apf.InputError, match=r"JSON of another layout, results\.json; expected"):
        Keypoints.open(other, RIG)


def as_easymocap(points: np.ndarray) -> str:
    return json.dumps({"annots": [{"personID": 0, "keypoints": np.nan_to_num(points).tolist()}]})


def as_mmpose(points: np.ndarray) -> list[dict[str, Any]]:
    known = np.nan_to_num(points)
    return [{"keypoints": known[:, :2].tolist(), "keypoint_scores": known[:, 2].tolist()}]


def as_yolo(points: np.ndarray) -> str:
    shares = np.nan_to_num((points + np.array([0.5, 0.5, 0])) / np.array([*RIG[0].size, 1]))
    return f"0 0.5 0.5 0.1 0.2 {' '.join(map(str, shares.ravel()))}\n"


@pytest.mark.parametrize("program", ["easymocap", "mmpose", "mmpose_video", "yolo", "sleap"])
def test_files_of_other_programs(tmp_path: Path, program: str) -> None:
    """Pictures without anybody have no file, an empty one, or an empty list."""
    rig = CameraRig(tuple(replace(camera, size=RIG[0].size) for camera in RIG))
    written = walked(names=COCO_17)
    written.points[:, 1] = written.points[1, 2, 4] = np.nan
    for view, camera in enumerate(written.camera_names):
        points = written.points[view].astype(float)
        folder = tmp_path / camera
        folder.mkdir()
        for frame in range(FRAMES):
            shown, path = points[frame], folder / f"{frame:06d}.json"
            if program == "easymocap":
                path.write_text(as_easymocap(shown))
            elif program == "mmpose":
                path.write_text(json.dumps([] if frame == 1 else as_mmpose(shown)))
            elif program == "yolo" and frame != 1:
                (folder / f"take_{frame + 1}.txt").write_text(as_yolo(shown))
        video = [
            {"frame_id": k + 1, "instances": [] if k == 1 else as_mmpose(points[k])}
            for k in range(FRAMES)
        ]
        if program == "mmpose_video":
            (folder / "results.json").write_text(json.dumps({"instance_info": video}))
        if program == "sleap":
            head = ",".join(f"{name}.{axis}" for name in COCO_17 for axis in ("x", "y", "score"))
            rows = [f"track,frame_idx,instance.score,{head}"]
            for frame in range(FRAMES):
                cells = ["" if np.isnan(value) else str(value) for value in points[frame].ravel()]
                rows.append(",".join(["one", str(frame), "0.9", *cells]))
            (folder / f"{camera}.analysis.csv").write_text("\n".join(rows))
    given = tmp_path if program != "sleap" else tmp_path / "*" / "*.csv"
    read = Keypoints.open(given, rig)
    assert (read.names, read.camera_names) == (written.names, written.camera_names)
    np.testing.assert_allclose(read.points, written.points, atol=1e-3)


def test_sleaps_h5(tmp_path: Path) -> None:
    tables = pytest.importorskip("tables")
    written = walked(names=COCO_17)
    for view, camera in enumerate(written.camera_names):
        with tables.open_file(tmp_path / f"{camera}.analysis.h5", "w") as file:
            points = written.points[view].astype(float).T  # (3, K, F)
            file.create_array("/", "tracks", points[None, :2])
            file.create_array("/", "point_scores", points[None, 2])
            file.create_array("/", "node_names", [name.encode() for name in COCO_17])
    read = Keypoints.open(tmp_path / "*.h5", RIG)
    np.testing.assert_allclose(read.points, written.points, atol=1e-3)


def test_frames_that_begin_later_are_placed_by_their_numbers(tmp_path: Path) -> None:
    sequence = psfs.open_sequence(footage.native(tmp_path / "take", views=4, frames=FRAMES + 10))
    written = walked(rig=sequence.rig)
    later = lambda camera, frame: f"{camera}/{camera}_{frame + 8}.json"  # noqa: E731
    folder = write_openpose(tmp_path / "json", written, path_of=later)
    read = Keypoints.open(folder, sequence)
    np.testing.assert_array_equal(read.points[:, 8 : 8 + FRAMES], written.points)
    assert np.isnan(read.points[:, :8]).all() and np.isnan(read.points[:, 8 + FRAMES :]).all()
    assert any("of frames 8 to 13 alone" in note for note in read.notes)


def test_opencaps_pickles(tmp_path: Path) -> None:
    written = walked(names=BODY_25)
    session = tmp_path / "OpenCapData"
    for trial in ("jump", "squat"):
        for view, camera in enumerate(("Cam0", "Cam1", "Cam2", "Cam3")):
            path = session / "Videos" / camera / "OutputPkl_default" / trial / "x_rotated_pp.pkl"
            path.parent.mkdir(parents=True)
            frames = [[list_person(points.astype(float))] for points in written.points[view]]
            path.write_bytes(pickle.dumps(frames if trial == "jump" else [[]] * 3 + frames))
    pattern = session / "Videos" / "Cam*" / "OutputPkl*" / "jump"
    same(Keypoints.open(pattern, RIG), written)  # Cam0 for c0, ..., by order
    named = CameraRig(tuple(SimpleNamespace(name=f"Cam{n}") for n in range(4)))  # type: ignore[misc]
    with pytest.raises(apf.InputError, match=r"could all be camera Cam0.*Cam\*/OutputPkl\*/jump"):
        Keypoints.open(session, named.names)
    with pytest.raises(apf.InputError, match="matches no file"):
        Keypoints.open(session / "Cam*" / "none", RIG)


def test_frames_without_a_file_or_a_person_are_missing(tmp_path: Path) -> None:
    written = walked()
    write_openpose(tmp_path, written, path_of=LAYOUTS["pose2sim"])
    (tmp_path / LAYOUTS["pose2sim"]("c1", 2)).unlink()
    (tmp_path / LAYOUTS["pose2sim"]("c2", 3)).write_text('{"people": []}')
    empty = json.dumps({"people": [{"pose_keypoints_2d": []}]})
    (tmp_path / LAYOUTS["pose2sim"]("c3", 0)).write_text(empty)
    read = Keypoints.open(tmp_path, RIG)
    expected = written.points.copy()
    expected[1, 2] = expected[2, 3] = expected[3, 0] = np.nan
    np.testing.assert_array_equal(read.points, expected)


def write_shuffled(folder: Path, *people: Keypoints) -> None:
    """Write OpenPose's files; in frames 1 and 4 of a camera the people stand in another order."""
    write_openpose(folder, *people, path_of=LAYOUTS["pose2sim"])
    for frame in (1, 4):  # networks do not keep an order
        path = folder / LAYOUTS["pose2sim"](people[0].camera_names[0], frame)
        path.write_text(json.dumps({"people": json.loads(path.read_text())["people"][::-1]}))


def test_the_person_that_all_cameras_see_alike_is_followed(tmp_path: Path) -> None:
    subject = walked(noise=2.0)
    nearer = walked(1.2, 0.6, noise=2.0, seed=1)  # large in some cameras, which see him alone
    shown = nearer.points.copy()
    shown[2:] = np.nan
    bystander = Keypoints(shown, MEDIAPIPE, subject.camera_names)
    write_shuffled(tmp_path, bystander, subject)
    read = Keypoints.open(tmp_path, RIG)
    np.testing.assert_array_equal(read.points, subject.points)
    assert "up to 2 persons in a picture" in read.notes[0]
    sequence = psfs.open_sequence(footage.native(tmp_path / "take", views=4, frames=FRAMES))
    both = [walked(dx, dy, sequence.rig) for dx, dy in ((0.5, 0.2), (-0.6, -0.2))]
    write_shuffled(tmp_path, *both)
    points = Keypoints.open(tmp_path / "pose", sequence).points
    assert any(np.array_equal(points, one.points, equal_nan=True) for one in both)


def test_without_cameras_the_surer_person_is_followed(tmp_path: Path) -> None:
    subject, other = walked(), walked(0.5)
    unsure = other.points.copy()
    unsure[..., 2] *= 0.4
    unsure[:, 3, :, 2] = 1.0  # for once
    people = Keypoints(unsure, MEDIAPIPE, other.camera_names)
    read = Keypoints.open(
        write_openpose(tmp_path, people, subject, path_of=LAYOUTS["openpose"]), subject.camera_names
    )
    np.testing.assert_array_equal(read.points, subject.points)


@pytest.mark.parametrize("individuals", [False, True])
def test_deeplabcuts_tables(tmp_path: Path, individuals: bool) -> None:
    written = walked(names=COCO_17)
    hidden = written.points.copy()
    hidden[1, 2, 3] = np.nan
    written = Keypoints(hidden, COCO_17, written.camera_names)
    paths = write_deeplabcut(tmp_path / "dlc", written, individuals)
    same(Keypoints.open(tmp_path / "dlc", RIG), written)
    one = Keypoints.open(paths[1], ["c1"])
    np.testing.assert_array_equal(one.points[0], written.points[1])
    (tmp_path / "dlc" / "summary.csv").write_text("frame,mean\n0,1\n")  # some other table
    same(Keypoints.open(tmp_path / "dlc", RIG), written)


def test_deeplabcuts_h5_is_its_csv(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    written = walked(names=COCO_17)
    for path in write_deeplabcut(tmp_path, written):
        path.with_suffix(".h5").write_bytes(b"not HDF5")
        path.unlink()
    monkeypatch.setitem(__import__("sys").modules, "tables", None)  # as if not installed
    with pytest.raises(apf.InputError, match=r"needs pandas and tables \(pip install "):
        Keypoints.open(tmp_path, RIG)
    monkeypatch.undo()
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("tables")
    with pytest.raises(apf.InputError, match="expected a pandas table"):
        Keypoints.open(tmp_path, RIG)
    for view, path in enumerate(sorted(tmp_path.glob("*.h5"))):
        keys = [("DLC", name, axis) for name in COCO_17 for axis in ("x", "y", "likelihood")]
        columns = pandas.MultiIndex.from_tuples(keys, names=["scorer", "bodyparts", "coords"])
        values = written.points[view].reshape(FRAMES, -1).astype(float)
        path.unlink()
        pandas.DataFrame(values, columns=columns).to_hdf(path, key="df_with_missing", mode="w")
    same(Keypoints.open(tmp_path, RIG), written)


def test_bad_tables_are_one_clear_error(tmp_path: Path) -> None:
    written = walked(names=COCO_17)
    for number, (pattern, text, n_files, message) in enumerate(
        (
            (r"\A\w+", "bones", 4, "holds no keypoints"),
            (r"^bodyparts", "bones", 1, "has no DeepLabCut's header"),
            (r"(?<=bodyparts,nose),nose", ",nose2", 1, "has no x, y"),
            (r"(?<=^coords),x", ",y", 1, "same column twice"),
            (r"(?<=^2),([^,]*,[^,]*),[^,]*", r",\1,wide", 1, "line 6: could not convert"),
            (r"\Z", "6,1,2\n", 1, "line 10 has 3 cells; expected 52"),
            (r"nose", "snout", 1, r"body parts of c1 .* are not those of c0"),
        )
    ):
        for path in write_deeplabcut(tmp_path / str(number), written)[:n_files]:
            count = 3 if text == "snout" else 1
            path.write_text(re.sub(pattern, text, path.read_text(), count=count, flags=re.M))
        with pytest.raises(apf.InputError, match=message) as error:
            Keypoints.open(tmp_path / str(number), RIG)
        assert "\n" not in str(error.value)
