"""scripts/accuracy.py: what is run, and the file that runs are kept in."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import footage
from helpers.shared import ROOT

from apf.formats.trc import JointSeries
from apf.image_objective.config import FeatureConfig
from apf.image_objective.features import Features
from apf.synthetic.scene import SceneConfig, make_rig
from cl import Device, InputError
from psfs.sequence import Sequence
from psfs.voxels.grid import VoxelGrid

sys.path.insert(0, str(ROOT / "scripts"))

from accuracy.recordings import Recording, spread_cameras
from accuracy.report import Summary, grids, headline, joints, write_summary, write_tables
from accuracy.runs import Results, Run, make_method, together
from accuracy.settings import Setting, Table
from accuracy.thesis import TABLES, thesis_headline, thesis_plan, write_thesis
from timings.report.readme import replace_marked

SCRIPT = ROOT / "scripts" / "accuracy.py"
specification = importlib.util.spec_from_file_location("accuracy_script", SCRIPT)
assert specification is not None and specification.loader is not None
accuracy_script = importlib.util.module_from_spec(specification)
specification.loader.exec_module(accuracy_script)

VALUES = {
    "cameras": [8, 4], "step": [1, 4], "method": ["apf"], "objective": ["voxel", "surface"],
    "particles": [200, 50], "layers": [10],
}  # fmt: skip
BASE = Setting("walk", 8, 1, "apf", "voxel", 200, 10)


def a_run(setting: Setting, seed: int, mean: float, *lost: str) -> Run:
    joints = {"pelvis": [mean, 1.0, 2.0]}
    return Run(
        setting, seed, 9, mean, mean, 99.0, 3.0, 10.0, 20.0, list(lost), 0.0, 0, 0.9, 1.5, joints
    )


def test_tables_vary_their_dimensions_alone() -> None:
    settings = list(Table.parse("particles:objective").settings("walk", VALUES))
    assert settings[0] == BASE and len(settings) == 4
    assert {(s.particles, s.objective) for s in settings} == {
        (200, "voxel"), (200, "surface"), (50, "voxel"), (50, "surface"),
    }  # fmt: skip
    assert {(s.cameras, s.step, s.layers) for s in settings} == {(8, 1, 10)}
    table = Table.parse("cameras")
    assert table.columns(table.settings("walk", VALUES)) == [4, 8]
    for wrong in ("colour", "layers:layers", ""):
        with pytest.raises(InputError, match="expected"):
            Table.parse(wrong)


def test_runs_are_kept_and_resumed(tmp_path: Path) -> None:
    path = tmp_path / "out" / "results.json"
    results = Results.resume(path, {"filter": {"noise": 0.5}})
    results.add(a_run(BASE, 0, 40.0))
    results.add(a_run(BASE, 1, 44.0, "left arm"))
    again = Results.resume(path, {"filter": {"noise": 0.5}})
    assert again.runs == results.runs
    assert again.lacks(BASE, 2) and not again.lacks(BASE, 1)
    summary = Summary.create(again.select(BASE))
    assert summary is not None and str(summary) == f"42.0 ± {np.sqrt(8):.1f}, 1 lost"
    table = Table.parse("cameras")
    plan = {table: list(table.settings("walk", VALUES))}
    write_summary(tmp_path / "tables.csv", plan, again)
    again.write_csv(tmp_path / "runs.csv")
    assert "cameras,walk,8,1,apf,voxel,200,10,42.00,2.83," in (tmp_path / "tables.csv").read_text()
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


def test_tables_in_markdown(tmp_path: Path) -> None:
    results = Results(tmp_path / "results.json", {"device": "abacus", "commit": "c0ffee"})
    results.add(a_run(BASE, 0, 40.0))
    results.add(a_run(BASE, 1, 44.0, "left arm"))
    results.add(a_run(replace(BASE, objective="surface"), 0, 50.0))
    tables = [Table.parse(name) for name in ("cameras", "particles:objective")]
    plan = {table: list(table.settings("walk", VALUES)) for table in tables}
    shown = [*grids(plan, results), joints(BASE, results.select(BASE))]
    write_tables(tmp_path / "tables.md", shown, results)
    text = (tmp_path / "tables.md").read_text()
    assert "abacus, 20" in text and "c0ffee" in text and "up to 2 seeds" in text
    assert "| sequence | cameras: 4 | cameras: 8 |" in text
    assert "| walk | - | 42.0 ± 2.8, 1 lost |" in text
    assert "| sequence | particles | voxel | surface |" in text
    assert "| walk | 200 | 42.0 ± 2.8, 1 lost | 50.0 ± 0.0 |" in text
    assert text.index("| walk | 50 | - | - |") < text.index("| walk | 200 |")
    assert "| pelvis | 42.0 | 1.0 | 2.0 |" in text and "| all | 42.0 | 10.0 | 20.0 |" in text
    assert "cameras: 8" in headline(plan, results) and "surface" not in headline(plan, results)


def test_tables_of_the_page_by_stored_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results = Results(tmp_path / "results.json", {"device": "abacus", "commit": "c0ffee"})
    results.add(a_run(BASE, 0, 40.0))
    (tmp_path / "docs").mkdir()
    page = tmp_path / "docs" / "accuracy.md"
    page.write_text("<!-- cameras: begin -->\n<!-- cameras: end -->\n")
    monkeypatch.setattr(accuracy_script, "_ROOT", tmp_path)
    given = SimpleNamespace(out=tmp_path, thesis=None, tables=["cameras"], **VALUES)
    accuracy_script.update_readme(given)
    assert "| walk | 40.0 ± 0.0 |" in page.read_text()
    assert "| walk | 40.0 ± 0.0 |" in (tmp_path / "tables.md").read_text()


def test_methods_and_objectives() -> None:
    assert make_method(BASE, 3).filter.search.seed == 3
    song = make_method(replace(BASE, objective="edge+silhouette"), 0)
    assert song.uses_voxels and song.filter.likelihood.weights[2:].tolist() == [0, 0]
    thesis = make_method(replace(BASE, method="pso", objective="sp", particles=96), 0)
    assert not thesis.uses_voxels and thesis.filter.search.n_particles == 96
    search = make_method(replace(BASE, method="sir"), 0).filter.search
    assert (search.n_particles, search.n_layers) == (2000, 1)
    for wrong in ({"method": "luck"}, {"objective": "edge+smell"}):
        with pytest.raises(InputError, match="expected"):
            make_method(replace(BASE, **wrong), 0)


def test_cameras_stand_around() -> None:
    rig = make_rig(SceneConfig(cameras=8))
    bearings = {c.name: np.degrees(np.arctan2(*c.centre[1::-1])) for c in rig}
    for count, apart in ((4, 90), (3, 90), (2, 90)):
        names = spread_cameras(rig, count)
        assert len(set(names)) == count
        angles = np.sort([bearings[name] for name in names])
        gaps = np.diff(np.append(angles, angles[0] + 360))
        assert gaps.min() == pytest.approx(apart, abs=15)
    assert spread_cameras(rig, 8) == list(rig.names)
    with pytest.raises(InputError, match="expected 1 to 8"):
        spread_cameras(rig, 9)


def test_shapes_by_their_vertices() -> None:
    """Rymut 2016, table 6.5."""
    setting = replace(BASE, method="pso", objective="sp@130")
    assert make_method(setting, 0).image.vertices_per_part == 130
    assert make_method(replace(setting, objective="sp"), 0).image.vertices_per_part == 4
    with pytest.raises(InputError, match="expected"):
        make_method(replace(setting, objective="sp@many"), 0)


def test_seeds_are_tracked_at_once_where_possible() -> None:
    device = Device.best()
    assert together(device, BASE, [0, 2, 3]) == [[0, 2, 3]]
    assert together(device, replace(BASE, objective="edge+silhouette"), [0, 1]) == [[0, 1]]
    for other in ({"method": "pso"}, {"objective": "sp"}, {"objective": "surface+motion_prior"}):
        assert together(device, replace(BASE, **other), [0, 1]) == [[0], [1]]


def test_tables_of_the_thesis(tmp_path: Path) -> None:
    plan = thesis_plan(tmp_path / "walk", 4, list(TABLES))
    assert [len(settings) for settings in plan.values()] == [45, 8, 16, 3, 24]
    chosen = thesis_plan(tmp_path / "walk", 4, ["6.4"])
    (settings,) = chosen.values()
    methods = [make_method(setting, 0) for setting in settings]
    scored = [m.filter.search.n_particles * m.filter.search.n_layers for m in methods]
    assert scored == [960, 2040, 3040, 5120] * 2
    assert {(m.search, m.objective) for m in methods} == {("sir", "sp"), ("pso", "sp")}
    results = Results(tmp_path / "results.json", {"device": "abacus", "commit": "c0ffee"})
    for setting in (*settings[:4], settings[5]):  # a table needs more than half of its runs
        results.add(a_run(setting, 0, float(setting.particles)))
    write_thesis(tmp_path / "thesis.md", Results.read(results.path))
    text = (tmp_path / "thesis.md").read_text()
    assert "abacus, 20" in text and "c0ffee" in text
    assert "| particle filter (PF) | 96.0 ± 0.0 | 204.0 ± 0.0 | 304.0 ± 0.0 | 512.0 ± 0.0 |" in text
    assert "| PF | 112.4 ± 42.2 |" in text  # the thesis's own
    assert "Not run: tables 6.1, 6.5, 6.8, 6.9 (" in text
    for of in thesis_plan(tmp_path / "walk", 4, ["6.8", "6.9"]).values():
        for setting in of:
            results.add(a_run(setting, 0, 30.0))
    write_thesis(tmp_path / "thesis.md", results)
    text = (tmp_path / "thesis.md").read_text()
    assert (
        "| CUDA-OpenGL | 500 | 49.5 ± 36.2 | 43.2 ± 9.4 | 61.7 ± 45.4 | 57.2 ± 28.0 | 37.6 ± 7.6 |"
        in text
    )
    assert "## Thesis figures 6.9 and 6.19 to 6.21\n" in text
    assert "Not run: tables 6.1, 6.5 (" in text
    assert "| PSO, 10 iterations | - |" in thesis_headline(results)
    assert "abacus" in thesis_headline(results)
    results.add(a_run(replace(BASE, sequence="run"), 0, 1.0))
    with pytest.raises(InputError, match="2 sequences; expected one"):
        thesis_headline(results)
    with pytest.raises(InputError, match="not the results"):
        Results.read(tmp_path / "absent.json")


def test_features_are_made_once(tmp_path: Path) -> None:
    """They are shown as they would be made anew."""
    folder = footage.native(tmp_path / "walk", frames=4)
    sequence, device = Sequence.open(folder), Device.best()
    grid = VoxelGrid(np.zeros(3), 0.1, (2, 2, 2))
    truth = JointSeries((), np.zeros((4, 0, 3)), 25.0, np.arange(4))
    recording = Recording(sequence, grid, [0, 2], [], [], truth)
    config = FeatureConfig()
    replay = recording.features(device, config)
    assert recording.features(device, config) is replay
    features = Features(device, sequence.rig, sequence.background, config)
    shown = 0
    for index, seen in replay:
        features(sequence.read(index))
        np.testing.assert_array_equal(seen.maps.get(), features.maps.get())
        np.testing.assert_array_equal(seen.roi.get(), features.roi.get())
        shown += 1
    assert shown == 2


def test_runs_are_begun_seed_by_seed_until_time_is_up(tmp_path: Path, monkeypatch) -> None:
    device = Device.best()
    settings = [replace(BASE, method="pso", objective=name) for name in ("sp", "ws")]
    results = Results(tmp_path / "results.json", {})
    results.add(a_run(settings[0], 0, 1.0))
    todo = accuracy_script.lacking(device, {Table(("objective",)): settings}, results, 2)
    assert todo == [(settings[1], [0]), (settings[0], [1]), (settings[1], [1])]
    began: list[object] = []
    monkeypatch.setattr(accuracy_script, "record", lambda *args: began.append(args))
    plan, args = (
        {Table(("objective",)): settings},
        SimpleNamespace(seconds=1e-9, seeds=2, out=tmp_path),
    )
    accuracy_script.do_runs(device, {}, plan, results, args)
    assert not began and len(results.runs) == 1


def test_text_between_marks(tmp_path: Path) -> None:
    page = tmp_path / "README.md"
    page.write_text("a\n<!-- x: begin -->\nold\n<!-- x: end -->\nb\n")
    replace_marked(page, "x", "new")
    assert page.read_text() == "a\n<!-- x: begin -->\nnew\n<!-- x: end -->\nb\n"
    with pytest.raises(InputError, match="expected <!-- y: begin -->"):
        replace_marked(page, "y", "new")
