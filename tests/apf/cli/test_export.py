"""`apf export` and `apf.export`."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import fail, succeed
from helpers.striders import SONG, strider
from helpers.tracks import lose

import apf
from apf.body.toml import save_body
from apf.formats.trc import read_trc
from apf.tracking.motion_files import EXPORTS
from apf.tracking.smoothing import SmoothingConfig, smooth_track
from apf.tracking.track import Track

FILES = set(EXPORTS.values()) - {"person.glb"}  # the track has no surface


def test_all_of_it(tmp_path: Path) -> None:
    track = strider(150, noise=0.01)
    track.save(tmp_path / "track.npz")
    before = (tmp_path / "track.npz").read_bytes()
    said = succeed("apf", "export", tmp_path).out
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"track.npz", "manifest.txt", *FILES}
    assert (tmp_path / "track.npz").read_bytes() == before  # the raw poses
    assert "smoothed at 6 Hz and feet held" in said and "steps/min" in said
    assert all(name in said for name in FILES) and "no surface of the person" in said
    smooth = smooth_track(track)
    np.testing.assert_allclose(
        read_trc(tmp_path / "motion.trc").joints, smooth.points.joints, atol=1e-6
    )
    gait = json.loads((tmp_path / "gait.json").read_text())
    assert gait["cadence_steps_per_min"] == pytest.approx(120, rel=0.03)


def test_choices(tmp_path: Path) -> None:
    track = lose(strider(60, noise=0.01), np.arange(20, 30))
    track.save(tmp_path / "track.npz")
    out = tmp_path / "out"
    wanted = ["--to", "trc", "bvh", "gait", "-o", str(out), "--axes", "z-up", "--raw"]
    said = " ".join(succeed("apf", "export", tmp_path / "track.npz", *wanted).out.split())
    assert {path.name for path in out.iterdir()} == {"motion.trc", "motion.bvh", "manifest.txt"}
    assert "not smoothed" in said and "lost in frames 20-29" in said
    assert "no walk of two steps" in said
    found = read_trc(out / "motion.trc", "z-up").joints
    np.testing.assert_allclose(found, track.points.joints, atol=1e-6)


def test_a_smoothed_track_is_not_smoothed_again(tmp_path: Path) -> None:
    track = smooth_track(strider(60, noise=0.01), SmoothingConfig(cutoff=3))
    written = apf.export(track, tmp_path, ["c3d", "gait", "c3d"])
    assert written.track is track and written.files == (tmp_path / "motion.c3d",)
    assert written.gait is None  # one step only


def test_points_without_a_body(tmp_path: Path) -> None:
    """As `apf track --method triangulate` makes them, NaN where a point is missing."""
    body = strider(150)
    names = [name for name in body.joint_names if name != "pelvis"]
    joints = body.joints[:, [body.joint_names.index(name) for name in names]].copy()
    joints[:20, names.index("l_wrist")] = np.nan
    track = Track("triangulated", (), tuple(names), 60.0, body.frames, np.zeros((150, 0)), joints,
                  np.zeros((0, 2)))  # fmt: skip
    track.save(tmp_path / "track.npz")
    assert "not smoothed" in succeed("apf", "export", tmp_path).out
    found = {path.name for path in tmp_path.iterdir()} - {"track.npz", "manifest.txt"}
    assert found == {"motion.c3d", "motion.trc", "gait.json"}
    np.testing.assert_allclose(read_trc(tmp_path / "motion.trc").joints, joints, atol=1e-6)
    assert json.loads((tmp_path / "gait.json").read_text())["n_steps"] >= 3
    assert "without a body" in fail("apf", "export", tmp_path, "--to", "bvh")


def test_tracks_of_before_hold_no_body_but_have_it_beside_them(tmp_path: Path) -> None:
    replace(strider(20), body=None).save(tmp_path / "track.npz")
    fail("apf", "export", tmp_path, "--to", "bvh")
    save_body(tmp_path / "body.toml", SONG)
    assert Track.open(tmp_path).its_body.name == "song31"
    succeed("apf", "export", tmp_path, "--to", "bvh")
