"""C3D files as truth, and markers fixed to a body against those of motion capture."""

from pathlib import Path

import numpy as np
import pytest
from helpers.commands import succeed
from helpers.footage import write_c3d
from helpers.striders import SONG, track_of_poses

from apf.body.kinematics import bone_matrices
from apf.body.stature import stature
from apf.evaluation.marker_truth import evaluate_markers, load_markers
from apf.evaluation.truth import load_truth
from apf.formats.c3d import read_c3d
from apf.formats.trc import CONVENTIONS
from apf.keypoints.landmarks import locate_points
from apf.tracking.track import Track
from cl import InputError

LABELS = ("LASI", "RASI", "LKNE", "RKNE", "LWRA", "C7", "LFHD")
N_FRAMES, FPS = 12, 30.0


def a_track() -> Track:
    """A body that turns and bends."""
    poses = SONG.rest_pose + 0.02 * np.arange(N_FRAMES)[:, None] * np.linspace(-1, 1, SONG.n_dof)
    return track_of_poses(SONG, poses, FPS)


def true_markers(track: Track, labels: tuple[str, ...]) -> np.ndarray:
    """(F, P, 3) m of the shipped set on the track's body, by its own matrices."""
    found = load_markers("plugingait")
    points = locate_points(track.its_body, labels, found.markers, found.stature)
    rotations, origins = bone_matrices(track.its_body, track.poses)
    pairs = list(zip(points.bones, points.offsets, strict=True))
    frames = range(len(track.poses))
    return np.array([[origins[f, b] + rotations[f, b] @ o for b, o in pairs] for f in frames])


def test_a_c3d_is_read_back_as_truth(tmp_path: Path) -> None:
    track, path = a_track(), tmp_path / "walk.c3d"
    markers = true_markers(track, LABELS)
    markers[3, 1] = np.nan
    markers[:, 5] += [0.0, 0.0, 0.02]  # C7 lies 20 mm higher
    write_c3d(path, 1000 * markers, tuple(f"S1:{label}" for label in LABELS), FPS, up="+Z")
    truth = load_truth(path)
    assert truth.fps == FPS and truth.joint_names[0] == "S1:LASI"
    np.testing.assert_allclose(truth.joints, markers, atol=1e-6)

    found = evaluate_markers(track, load_markers("plugingait"), truth)
    errors = dict(zip(found.joint_names, found.errors.T, strict=True))
    assert errors.pop("c7") == pytest.approx(0.02, abs=1e-6)  # eq. (6.1)
    assert all(np.nanmax(of) < 1e-6 for of in errors.values())
    assert found.n_ignored == 1 and "l_toe" in found.unmatched_track
    assert found.mean_error == pytest.approx(0.02 * N_FRAMES / (7 * N_FRAMES - 1), abs=1e-6)

    track.save(tmp_path / "out" / "track.npz")
    words = ["evaluate", str(tmp_path / "out"), "--truth", str(path), "--markers", "plugingait"]
    out = succeed("apf", *words).out
    assert "c7" in out and "20.0" in out and (tmp_path / "out/evaluation.png").is_file()


def test_units_axes_rates_and_beginnings(tmp_path: Path) -> None:
    track, path = a_track(), tmp_path / "walk.c3d"
    labels = LABELS[:2]
    markers = true_markers(track, labels)
    y_up = markers @ CONVENTIONS["y-up"]  # world = file @ matrix.T
    write_c3d(path, 100 * y_up, labels, FPS, unit="cm", up="+Y")
    np.testing.assert_allclose(read_c3d(path).joints, markers, atol=1e-6)
    write_c3d(path, 100 * y_up, labels, FPS, unit="cm")  # says nothing
    np.testing.assert_allclose(read_c3d(path, "y-up").joints, markers, atol=1e-6)

    # Four frames before the sequence, at twice its rate; one marker is missing in between.
    twice = np.repeat(markers, 2, axis=0)
    twice[1::2][:-1] = (markers[1:] + markers[:-1]) / 2
    early = np.concatenate([np.full((4, 2, 3), 7.0), twice])
    early[4 + 3, 0] = np.nan
    write_c3d(path, 1000 * early, labels, 2 * FPS)
    truth = read_c3d(path)
    at = truth.resample(FPS, 4.0)
    np.testing.assert_allclose(at.joints[:N_FRAMES], markers, atol=1e-6)
    half = truth.resample(FPS, 4.5)  # a frame of theirs earlier by half
    np.testing.assert_allclose(half.joints[4], (3 * markers[4] + markers[5]) / 4, atol=1e-6)
    assert np.isnan(half.joints[1, 0]).all() and np.isfinite(half.joints[1, 1]).all()
    write_c3d(path, 1000 * markers[5:], labels, FPS, first=5)
    numbered = read_c3d(path).resample(FPS)
    assert numbered.frames.tolist() == list(range(5, N_FRAMES))


def test_a_set_of_one_s_own(tmp_path: Path) -> None:
    track, own = a_track(), tmp_path / "mine.toml"
    own.write_text(
        'stature = 3.0\n[[marker]]\nname = "M1"\njoint = "l_knee"\noffset = [0.1, 0, 0]\n'
    )
    path = tmp_path / "walk.c3d"
    knee = track.joints[:, [track.joint_names.index("l_knee")]]
    write_c3d(path, 1000 * knee, ("M1",), FPS)
    found = evaluate_markers(track, load_markers(own), load_truth(path))
    tall = stature(track.its_body)
    assert found.mean_error == pytest.approx(0.1 * tall / 3.0, rel=1e-3)
    constant, rest = found.constant_and_rest  # in the bone's own axes
    assert constant[0] == pytest.approx(found.mean_error, rel=1e-4) and rest[0] < 1e-6


def test_bad_files(tmp_path: Path) -> None:
    path, track = tmp_path / "walk.c3d", a_track()
    path.write_bytes(b"no c3d at all")
    with pytest.raises(InputError, match=r"walk\.c3d: .*expected a C3D"):
        read_c3d(path)
    with pytest.raises(InputError, match="expected a TOML file or one of plugingait"):
        load_markers("vicon")
    for text, message in (
        ("[[markers]]\n", r"markers; expected \[\[marker\]\] tables"),
        ("stature = 9.0\n", "stature"),
    ):
        (tmp_path / "mine.toml").write_text(text)
        with pytest.raises(InputError, match=message):
            load_markers(tmp_path / "mine.toml")
    for said, message in (
        ({"unit": "inch"}, r"POINT:UNITS is 'inch'; expected mm, cm, m"),
        ({"up": "-Z"}, r"Y_SCREEN is '-Z'; expected \+Z or \+Y"),
        ({}, "no marker in common: the truth has X9; the set plugin"),
    ):
        write_c3d(path, np.zeros((3, 1, 3)), ("X9",), FPS, **said)
        with pytest.raises(InputError, match=message):
            evaluate_markers(track, load_markers("plugingait"), load_truth(path))
