"""The Track type, tracks of several people, and their files."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from helpers import tracks

from apf.body.kinematics import posed_cones
from apf.body.limbs import limb_names
from apf.tracking.people import PeopleTracks, holds_people, list_people, parse_spans
from apf.tracking.track import PEOPLE, Track, spans
from cl import InputError
from psfs.voxels.body_prior import TrackedBody


def test_npz_round_trip(tmp_path: Path) -> None:
    track = tracks.walker(start=12)
    track.save(tmp_path / "run" / "track.npz")
    for path in (tmp_path / "run" / "track.npz", tmp_path / "run"):
        again = Track.open(path)
        assert set(again.diagnostics) == {"ess", "best_log_weight"}
        np.testing.assert_equal(*({**vars(one), "body": None} for one in (again, track)))
    assert [p.name for p in (tmp_path / "run").iterdir()] == ["track.npz"]  # nothing temporary


def test_what_the_tracker_knows_of_itself(tmp_path: Path) -> None:
    track = tracks.walker()
    assert not track.lost.any() and np.isnan(track.confidence).all()
    assert np.isnan(track.covariance).all() and not len(track.restarts)
    lost, restart = np.zeros(30, bool), np.zeros(30, np.int64)
    lost[3:6], restart[6] = True, 2
    told = {"lost": lost, "restart": restart, "confidence": np.linspace(0, 1, 30)}
    told["covariance"] = np.ones((30, len(track.joint_names), 3, 3))
    replace(track, diagnostics=told, frames=np.arange(10, 40)).save(tmp_path / "track.npz")
    found = Track.open(tmp_path)
    assert spans(found.frames[found.lost].tolist()) == "13-15"
    assert found.restarts.tolist() == [16]
    np.testing.assert_array_equal(found.covariance, told["covariance"])
    np.testing.assert_array_equal(found.confidence, told["confidence"])
    assert spans([1, 2, 5, 8, 9]) == "1-2, 5, 8-9" and spans([]) == ""
    for frames in ([], [3], [0, 1, 2], [1, 2, 5, 7, 8]):
        assert parse_spans(spans(frames)).tolist() == frames
    assert spans([1, 2, 5, 8, 9], 2) == "1-2, 5 and 1 more" and spans([1, 3], 2) == "1, 3"


def test_the_cones_in_the_npz_are_those_that_are_known(tmp_path: Path) -> None:
    track = tracks.walker(frames=3)
    body = track.its_body
    sound = np.ones((3, len(limb_names(body))))
    sound[1, limb_names(body).index("left arm")] = 0.2
    diagnostics = {"lost": np.array([False, False, True]), "limb_confidence": sound}
    replace(track, diagnostics=diagnostics).save(tmp_path / "track.npz")
    found = TrackedBody.open(tmp_path)
    np.testing.assert_array_equal(found.frames, track.frames)
    np.testing.assert_allclose(found[0], posed_cones(body, track.poses[:1])[0], atol=1e-6)
    arm = {body.bones[cone.bone].name for cone, row in zip(body.cones, found[1], strict=True)
           if np.isnan(row).any()}  # fmt: skip
    assert arm and all("l_" in name or "left" in name for name in arm)
    assert np.isnan(found[2]).all()


def test_csv_rows_and_endings_of_no_format(tmp_path: Path) -> None:
    track = tracks.walker(frames=3, start=30)
    track.save(tmp_path / "joints.csv")
    with (tmp_path / "joints.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:4] == ["frame", "time_s", "pelvis_x_m", "pelvis_y_m"]
    assert [row["frame"] for row in rows] == ["30", "31", "32"]
    assert float(rows[0]["time_s"]) == 0.5
    wrist = [float(rows[2][f"l_wrist_{axis}_m"]) for axis in "xyz"]
    joint = track.joints[2, track.joint_names.index("l_wrist")]
    np.testing.assert_allclose(wrist, joint, atol=1e-6)
    for name in ("walk.fbx", "walk"):
        with pytest.raises(InputError, match=rf"{name}.*expected \.npz, \.trc, \.csv"):
            track.save(tmp_path / name)


def test_a_notebook_shows_the_motion_in_few_words() -> None:
    track = replace(tracks.walker(300), body_name="<b>", body=None)
    shown = track._repr_html_()
    assert "<b>" not in shown and "300 frames at 60/s" in shown and len(repr(track)) < 100
    picture = ElementTree.fromstring(shown[: shown.index("<div>")])
    assert sum("values" in move.attrib for move in picture.iter()) == 4 * len(track.edges)


def test_saved_people_are_opened_again(tmp_path: Path) -> None:
    seen = (np.arange(10), np.array([2, 3, 7]))
    people = PeopleTracks(
        (tracks.walker(10), tracks.walker(6, 2)), np.arange(10), seen, 1, ("good", "")
    )
    people.save(tmp_path)
    assert holds_people(tmp_path)
    again = PeopleTracks.open(tmp_path)
    assert [len(track) for track in again] == [10, 6]
    assert again.counts.tolist() == [1, 1, 2, 2, 1, 1, 1, 2, 1, 1]
    assert again.objects == 1
    with pytest.raises(InputError, match=r"of several people; expected one, as .*person1"):
        Track.open(tmp_path)
    assert again.select_seen(1).frames.tolist() == [2, 3, 7]
    listed = json.loads((tmp_path / PEOPLE).read_text())
    assert listed["frames_with"] == {"1": 7, "2": 3}
    assert [person.get("verdict") for person in listed["persons"]] == ["good", ""]
    (alone,) = PeopleTracks.open(tmp_path / "person2")  # of one person, in the same way
    assert len(alone) == 6
    assert repr(again) == "<PeopleTracks of 2 in 10 frames: seen in 10, 3>"
    PeopleTracks(people.tracks[:1], np.arange(10), seen[:1]).save(tmp_path)
    assert list_people(tmp_path) == [tmp_path / "person1"]  # person2 is of the run before


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"frames": "3 to 5"}, "frames"),
        ({"persons": []}, "persons"),
        ({"persons": [{"folder": "../elsewhere", "frames": 1, "seen": "1"}]}, "folder"),
        ({"people": 99}, "99 people in the folders person1"),
        ({"frames": "9-2"}, "frames 9-2; expected them ascending"),
        ({"frames": ", ".join(["0-9999999"] * 500)}, "expected them ascending"),
    ],
)
def test_other_lists_are_refused(changed: dict[str, object], said: str, tmp_path: Path) -> None:
    people = PeopleTracks((tracks.walker(3),), np.arange(3), (np.arange(3),))
    people.save(tmp_path)
    path = tmp_path / PEOPLE
    path.write_text(json.dumps({**json.loads(path.read_text()), **changed}))
    with pytest.raises(InputError, match=said) as error:
        PeopleTracks.open(tmp_path)
    assert str(error.value).startswith(f"{path}: ")
