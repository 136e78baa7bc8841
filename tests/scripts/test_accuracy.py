"""scripts/accuracy.py: methods of settings, the file of runs, and a suite from both starts."""

import csv
import json
import runpy
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import accuracy.suite as suite
import numpy as np
import pytest
from accuracy.ablation import ABLATIONS, READINGS, load_preset
from accuracy.runs import Results, Run, Setting, make_method
from accuracy.suite import (
    Job,
    heading_error,
    lacking_jobs,
    suite_folders,
    suite_settings,
)
from accuracy.suite_report import Row, suite_rows, write_suite
from helpers.shared import ROOT
from timings.grid import replace_marked

import psfs
from apf.evaluation.truth import load_truth
from apf.formats.trc import JointSeries
from apf.presets import Preset
from apf.synthetic.scene import SceneConfig
from apf.tracking.track import Track
from cl import Device, InputError

SCRIPT = ROOT / "scripts" / "accuracy.py"
FRAMES = 4
BASE = Setting("walk", 8, 1, "apf", "voxel", 200, 10)
FOUND = Setting("walk", 4, 1, "apf", "voxel", 30, 3, "found")


@pytest.fixture
def folder(small_walk: Path) -> Path:
    """A suite of one sequence."""
    return small_walk.parent


def a_run(setting: Setting, seed: int, mean: float, heading: float = 5.0) -> Run:
    return Run(
        setting, seed, 9, mean, mean, 99.0, 3.0, 10.0, 20.0, ["left arm"], 0.25, 0, 0.9, 1.5,
        {"pelvis": [mean, 1.0, float("nan")]}, wrists=70.0, heading=heading, stature=-2.0,
        limb_frames=0.5, limbs=mean - 1, limbs_rest=15.0, limbs_far=0.125,
        flags=[7, 8, 1, 25 + seed], inside_unflagged=0.95,
    )  # fmt: skip


def write_true_keypoints(take: Path) -> None:
    """Write keypoints at the true joints into a take's folder."""
    truth, rig = load_truth(take / "truth.npz"), psfs.open_sequence(take).rig
    points = np.ones((len(rig), *truth.joints.shape))
    for view, camera in zip(points, rig, strict=True):
        view[..., :2] = camera.project(truth.joints)[0]
    np.savez(
        take / "keypoints.npz", keypoints=points, keypoint_names=truth.joint_names,
        camera_names=rig.names,
    )  # fmt: skip


def command(suite_folder: Path, out: Path, *flags: str) -> list[str]:
    small = ["--particles", "30", "--layers", "3", "--commit", "c0ffee"]
    script = [sys.executable, str(SCRIPT), "--suite", str(suite_folder), "-o", str(out)]
    return [*script, *small, *flags]


@pytest.mark.usefixtures("quick_start")
def test_a_suite_from_both_starts(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    main = runpy.run_path(str(SCRIPT), run_name="accuracy.py")["main"]
    flags = ("--seeds", "1", "--processes", "1")
    monkeypatch.setattr("sys.argv", command(folder, out, *flags)[1:])
    assert main() == 0
    results = Results.read(out / "results.json")
    assert {r.setting.start for r in results.runs} == {"found", "true"}
    by_start = {r.setting.start: r for r in results.runs}
    true = by_start["true"]
    assert not true.failed and true.frames == FRAMES
    assert true.mean < 100 and true.heading < 20 and abs(true.stature) < 5
    assert true.wrists > 0 and 0 <= true.limb_frames <= 1 and true.seconds > 0
    kept = json.loads((out / "silhouettes" / "walk.json").read_text())
    assert kept["mean_iou"] > 0.7 and list(kept["frames"]) == ["0"]
    assert "IoU" in capsys.readouterr().out
    assert "| walk | 4 | default | voxels | true | 1 |" in (out / "suite.md").read_text()
    with (out / "suite.csv").open() as file:
        row = next(row for row in csv.DictReader(file) if row["start"] == "true")
    assert row["runs"] == "1" and float(row["iou"]) == pytest.approx(kept["mean_iou"], abs=1e-3)
    assert (out / "suite.png").stat().st_size > 10_000
    assert len((out / "runs.csv").read_text().splitlines()) == 3


def test_triangulation_voxels_keypoints_and_both_side_by_side(folder: Path, tmp_path: Path) -> None:
    """Keypoints at the true joints: triangulated they are the truth; without any there is none of
    them."""
    takes = tmp_path / "takes"
    shutil.copytree(folder, takes, ignore=shutil.ignore_patterns("truth_masks"))
    shutil.copytree(takes / "walk", takes / "without")
    write_true_keypoints(takes / "walk")
    by = ("triangulation", "voxels", "keypoints", "both")
    first = {"method": "apf", "objective": "voxel", "particles": 60, "layers": 4}
    folders = [takes / "walk", takes / "without"]
    settings = dict(suite_settings(folders, ["true"], by, first))
    assert [(s.sequence, s.observations, s.start) for s in settings] == [
        ("walk", "triangulation", "none"), *(("walk", name, "true") for name in by[1:]),
        ("without", "voxels", "true"),
    ]  # fmt: skip
    alone = dict(suite_settings(folders, ["true"], by, first, ["song"]))
    assert [(s.sequence, s.observations, s.preset) for s in alone] == [
        ("walk", "voxels", "song"), ("without", "voxels", "song"),
    ]  # fmt: skip
    results = Results(tmp_path / "results.json", {"device": "abacus", "commit": "c0ffee"})
    jobs = lacking_jobs(settings, results, 2, lambda name: True)
    assert [job.seeds for job in jobs] == [(0,), *4 * [(0, 1)]]
    device = Device.best()
    done = [setting for setting in settings if setting.observations in ("triangulation", "both")]
    for setting in done:
        (found,) = suite.done(device, Job(takes / "walk", setting, (0,)), lambda: None)
        results.add(found)
    exact, both = results.runs
    assert exact.limbs < 0.1 and exact.heading < 0.1 and exact.seconds > 0
    assert exact.limbs_far == 0 and np.isnan(exact.stature)
    assert exact.exported["mean"] == pytest.approx(exact.limbs) and exact.exported["gaps"] == 0
    assert both.limbs < 100 and both.frames == FRAMES and abs(both.stature) < 5
    assert both.exported["mean"] < 100 and both.exported["jitter"] < 100
    assert np.mean(both.by_frame) == pytest.approx(both.mean, abs=0.1)
    write_suite(tmp_path, results, suite_rows(results, done, lambda name: float("nan")))
    table = (tmp_path / "suite.md").read_text()
    assert all(f"| walk | 4 | default | {one.observations} |" in table for one in done)
    with pytest.raises(InputError, match="no sequence has keypoints"):
        list(suite_settings([takes / "without"], ["found"], ["both"], first))


def test_folders_with_truth(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    main = runpy.run_path(str(SCRIPT), run_name="accuracy.py")["main"]

    def refused(suite_folder: Path, *flags: str) -> str:
        monkeypatch.setattr("sys.argv", command(suite_folder, tmp_path / "out", *flags)[1:])
        assert main() == 2
        return capsys.readouterr().err

    assert suite_folders(folder) == suite_folders(folder / "walk") == [folder / "walk"]
    with pytest.raises(InputError, match=r"no sequence with truth\.npz"):
        suite_folders(tmp_path)
    assert "no sequence with" in refused(tmp_path)
    for flags, message in (
        (("--processes", "0"), "--processes 0"),
        (("--readme",), "expected either"),
        (("--seeds", "0"), "--seeds 0"),
    ):
        assert message in refused(folder, *flags)
    assert not (tmp_path / "out").exists()


def test_a_start_that_is_not_found_is_a_run(folder: Path, monkeypatch) -> None:
    def lost(*args, **settings):
        raise suite.StartError("nobody stands there")

    monkeypatch.setattr(suite, "track_take", lost)
    (run,) = suite.done(Device.best(), Job(folder / "walk", FOUND, (7,)), lambda: None)
    assert (run.seed, run.frames, run.failed) == (7, 0, "nobody stands there")
    row = Row.create(FOUND, [run, a_run(FOUND, 0, 40.0)], float("nan"))
    assert (row.runs, row.failed, row.mean, row.heading_right) == (2, 1, 40.0, 1)
    assert row.cells()[5] == "2, 1 failed" and row.cells()[13] == "1/2"


def test_runs_are_kept_and_resumed(tmp_path: Path) -> None:
    path = tmp_path / "out" / "results.json"
    results = Results.resume(path, {"filter": {"noise": 0.5}})
    exported = {"mean": 39.0, "skating": float("nan")}
    results.add(replace(a_run(BASE, 0, 40.0), exported=exported))
    results.add(a_run(BASE, 1, 44.0))
    assert "NaN" not in path.read_text()  # what is not known is null, and comes back
    again = Results.resume(path, {"filter": {"noise": 0.5}})
    assert repr(again.runs) == repr(results.runs)
    assert again.lacks(BASE, 2) and not again.lacks(BASE, 1)
    again.write_csv(tmp_path / "runs.csv")
    assert "44,44,99,3,10,20,left arm" in (tmp_path / "runs.csv").read_text()
    with pytest.raises(InputError, match=r"other conditions \(filter\)"):
        Results.resume(path, {"filter": {"noise": 0.6}})
    again = Results.resume(path, {"filter": {"noise": 0.5}, "folders": {"a": "/a"}})
    again.add(a_run(BASE, 2, 50.0))
    more = Results.resume(path, {"filter": {"noise": 0.5}, "folders": {"b": "/b"}})
    assert more.conditions["folders"] == {"a": "/a", "b": "/b"}
    with pytest.raises(InputError, match=r"other conditions \(a\)"):
        Results.resume(path, {"filter": {"noise": 0.5}, "folders": {"a": "/elsewhere"}})
    path.write_text("[]")
    with pytest.raises(InputError, match=r"not the results of accuracy\.py"):
        Results.resume(path, {})


def test_methods_and_objectives() -> None:
    assert make_method(BASE, 3).filter.search.seed == 3
    song = make_method(replace(BASE, objective="edge+silhouette"), 0)
    assert song.uses_voxels and song.filter.likelihood.weights[2:].tolist() == [0, 0]
    thesis = make_method(replace(BASE, method="pso", objective="sp", particles=96), 0)
    assert not thesis.uses_voxels and thesis.filter.search.n_particles == 96
    search = make_method(replace(BASE, method="sir"), 0).filter.search
    assert (search.n_particles, search.n_layers) == (2000, 1)
    vertices = make_method(replace(BASE, method="pso", objective="sp@130"), 0).image
    assert vertices.vertices_per_part == 130 and thesis.image.vertices_per_part == 4
    for key, wrong in (("method", "luck"), ("objective", "edge+smell"), ("objective", "sp@many")):
        with pytest.raises(InputError, match=rf"{wrong[-4:]}.*expected"):
            make_method(replace(BASE, **{key: wrong}), 0)


def test_text_between_marks(tmp_path: Path) -> None:
    page = tmp_path / "README.md"
    page.write_text("a\n<!-- x: begin -->\nold\n<!-- x: end -->\nb\n")
    replace_marked(page, "x", "new")
    assert page.read_text() == "a\n<!-- x: begin -->\nnew\n<!-- x: end -->\nb\n"
    with pytest.raises(InputError, match="expected <!-- y: begin -->"):
        replace_marked(page, "y", "new")


def test_presets_of_readings_and_ablations_change_settings() -> None:
    for name, (base, _) in READINGS.items():
        changed, paper = load_preset(name), load_preset(base)
        assert changed.name == name and changed != paper.replace(name=name)
    assert load_preset("rymut-impulse").method.features.proximity.function == "impulse"
    assert load_preset("kwolek-plain").background == "mog-plain"
    every = [load_preset(name, search="apf", objective="voxel") for name in ABLATIONS]
    settings = {repr((one.method, one.reconstruction)) for one in [Preset(), *every]}
    assert len(settings) == 1 + len(ABLATIONS)
    with pytest.raises(InputError, match="by no such name"):
        load_preset("by no such name")


def test_headings_by_the_hips() -> None:
    names, frames = ("l_hip", "r_hip"), np.array([5])
    ahead = np.array([[0.0, 0.1, 0.9], [0.0, -0.1, 0.9]])
    edges = np.zeros((0, 2), int)
    track = Track("points", (), names, 30.0, frames, np.zeros((1, 0)), ahead[None], edges)
    for degrees in (0, 30, 170, -120):
        angle = np.radians(degrees)
        left = np.array([-np.sin(angle), np.cos(angle), 0.2])
        truth = JointSeries(names, np.stack([left, -left])[None], 30.0, frames)
        assert heading_error(track, truth) == pytest.approx(abs(degrees), abs=1e-6)
    assert np.isnan(heading_error(track, replace(truth, frames=frames + 1)))


def test_statures_as_stated(folder: Path, tmp_path: Path) -> None:
    walk = folder / "walk"
    truth = suite.load_truth(walk / "truth.npz")
    assert suite.true_stature(walk, truth) == SceneConfig().height
    (tmp_path / "truth.npz").write_bytes((walk / "truth.npz").read_bytes())
    assert suite.true_stature(tmp_path, truth) == pytest.approx(SceneConfig().height, rel=0.04)
    (tmp_path / "README.md").write_text("- person: body variant `man`, height 1.83 m (bare)\n")
    assert suite.true_stature(tmp_path, truth) == 1.83
