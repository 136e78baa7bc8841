"""Several people against the truth: counts, identities, and `apf evaluate` of their folder."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import tracks
from helpers.commands import succeed

from apf.cli.batch_take import compare_with_truth
from apf.evaluation.people import evaluate_people
from apf.evaluation.truth import load_people_truth
from apf.formats.trc import JointSeries
from apf.tracking.people import PeopleTracks
from apf.tracking.track import Track
from cl import InputError

N = 20
FRAMES = np.arange(N)


def walker_at(x: float) -> Track:
    track = tracks.walker(N)
    return replace(track, joints=track.joints + np.array([x, 0, 0]))


def pair(*xs: float) -> tuple[PeopleTracks, dict[str, JointSeries]]:
    """Return perfect tracks of people beside each other, and their truth."""
    ones = tuple(walker_at(x) for x in xs)
    truth = {f"at {x}": tracks.truth_of(one) for x, one in zip(xs, ones, strict=True)}
    return PeopleTracks(ones, FRAMES, (FRAMES,) * len(ones)), truth


def save_truth(path: Path, truth: dict[str, JointSeries], **changes: Any) -> None:
    """Write the joints of all people as `truth.npz` has them, with other arrays."""
    names = np.array(truth["at 0"].joint_names)
    arrays = {"joints": np.stack([of.joints for of in truth.values()], axis=1)} | changes
    np.savez(path, joint_names=names, fps=60.0, **arrays)


def test_perfect_tracks_in_another_order() -> None:
    people, truth = pair(0, 1, 2)
    shuffled = PeopleTracks(people.tracks[::-1], FRAMES, people.seen)
    found = evaluate_people(shuffled, truth)
    assert found.tracks.tolist() == [2, 1, 0]
    assert (found.count_right, found.mota, found.idf1) == (1, 1, 1)
    assert found.switches == []
    assert [of.mean_error for of in found.errors if of is not None] == [0, 0, 0]


def test_exchanged_people_are_switches() -> None:
    people, truth = pair(0, 1)
    a, b = (track.joints.copy() for track in people)
    a[12:], b[12:] = b[12:].copy(), a[12:].copy()
    mixed = (replace(people[0], joints=a), replace(people[1], joints=b))
    found = evaluate_people(PeopleTracks(mixed, FRAMES, people.seen), truth)
    assert found.switches == [(12, "at 0"), (12, "at 1")]
    assert found.mota == pytest.approx(1 - 2 / 40)
    assert found.idf1 == pytest.approx(12 / 20)
    assert found.errors[0] is not None
    assert found.errors[0].mean_error == pytest.approx(8 / 20)  # 1 m off in 8 of 20 frames


def test_missed_invented_and_absent_people() -> None:
    """The second person is seen from frame 5 on and truly absent from 15 on."""
    people, truth = pair(0, 1)
    joints = truth["at 1"].joints.copy()
    joints[15:] = np.nan
    truth["at 1"] = replace(truth["at 1"], joints=joints)
    found = evaluate_people(PeopleTracks(people.tracks, FRAMES, (FRAMES, FRAMES[5:])), truth)
    assert (found.misses, found.false_positives) == (5, 5)
    assert found.count_right == 0.5
    assert found.mota == pytest.approx(1 - 10 / 35)
    one = PeopleTracks(people.tracks[:1], FRAMES, (FRAMES,))
    summary = evaluate_people(one, truth).summary()
    assert [person["track"] for person in summary["persons"]] == [1, None]


def test_a_match_lasts_while_it_is_near() -> None:
    """Two tracks pass within the reach of one person: the first one's match stays."""
    people, truth = pair(0, 0.2)
    only = {"at 0": truth["at 0"]}
    moving = np.linspace(0, 0.4, N)[:, None, None] * np.array([1, 0, 0])
    first = replace(people[0], joints=people[0].joints + moving)
    found = evaluate_people(PeopleTracks((first, people[1]), FRAMES, people.seen), only)
    assert found.matches[:, 0].tolist() == [0] * N
    assert found.false_positives == N


def test_npz_of_all_people(tmp_path: Path) -> None:
    _, truth = pair(0, 1)
    path = tmp_path / "truth.npz"
    save_truth(path, truth, person_names=["a", "a"])
    read = load_people_truth(path)
    assert list(read) == ["person1 (a)", "person2 (a)"]
    np.testing.assert_array_equal(read["person2 (a)"].joints, truth["at 1"].joints)
    save_truth(path, truth, joints=truth["at 0"].joints)
    (one,) = load_people_truth(path).values()  # of one person
    np.testing.assert_array_equal(one.joints, truth["at 0"].joints)
    save_truth(path, truth, joints=truth["at 0"].joints[0])
    with pytest.raises(InputError, match="joints"):
        load_people_truth(path)


def test_command_compares_all_people(tmp_path: Path) -> None:
    people, truth = pair(0, 1)
    people.save(tmp_path / "out")
    file, out = tmp_path / "truth.npz", tmp_path / "figures"
    off = [of.joints + np.array([0.01, 0, 0]) for of in truth.values()]
    save_truth(file, truth, joints=np.stack(off, axis=1))
    command = ["evaluate", str(tmp_path / "out"), "--truth", str(file), "-o", str(out)]
    said = succeed("apf", *command, "--json", "--csv").out
    assert "identity switches: 0" in said
    assert "100.0% of 20 frames" in said
    whole = json.loads((out / "evaluation.json").read_text())
    assert [p["errors"]["mean_error_mm"] for p in whole["persons"]] == [10, 10]
    assert (out / "person2" / "evaluation.csv").exists()
    second = str(tmp_path / "out" / "person2")
    said = succeed("apf", "evaluate", second, "--truth", file, "--json").out
    assert "the nearest is person2" in said and "mean error 10.0 mm" in said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scale": 1000.0}, "coordinates times 0.001"),
        ({"shift": 50.0}, "no other axes or unit bring it near"),
        ({"n": 5}, "covers 5 of the track's 20 frames"),
        ({}, ""),
    ],
)
def test_a_truth_that_fits_nobody(tmp_path: Path, change: dict[str, Any], said: str) -> None:
    people, truth = pair(0, 3)
    people.save(tmp_path / "out")
    joints = np.stack([of.joints for of in truth.values()], axis=1)[: change.get("n", N)]
    joints = joints * change.get("scale", 1.0) + change.get("shift", 0.0)
    save_truth(tmp_path / "t.npz", truth, joints=joints)
    command = ["evaluate", str(tmp_path / "out"), "--truth", str(tmp_path / "t.npz"), "--json"]
    printed = succeed("apf", *command).out
    assert said in printed and ("warning" in printed) == bool(said)


def test_each_track_is_compared_with_its_own_person(tmp_path: Path) -> None:
    """As in the rows of `apf batch`: two seeds, people in another order, one of nobody, one
    alone."""
    people, truth = pair(0, 1)
    save_truth(tmp_path / "truth.npz", truth)
    tracks = (walker_at(3), people[1], people[0])

    def finished(track: Track) -> Any:
        judged = [SimpleNamespace(quality=SimpleNamespace(seen=None))] * 2
        off = replace(track, joints=track.joints + np.array([0.01, 0, 0]))
        sequence = SimpleNamespace(folder=tmp_path)
        take = SimpleNamespace(tracks=[track, off], sequence=sequence)
        return SimpleNamespace(take=take, judgements=judged)

    everybody = list(map(finished, tracks))
    for chosen, expected in (
        (everybody, [[None, None], [0, 10], [0, 10]]),
        (everybody[1:2], [[0, 10]]),
    ):
        found = compare_with_truth(chosen)
        errors = [[of and round(1000 * of.mean_error, 6) for of in person] for person in found]
        assert errors == expected
    (tmp_path / "truth.npz").unlink()
    assert compare_with_truth(everybody) == [[None, None]] * 3
