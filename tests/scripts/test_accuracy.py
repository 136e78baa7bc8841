"""scripts/accuracy.py: the methods of settings, and the file that stores runs."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest
from helpers.shared import ROOT

from cl import InputError

sys.path.insert(0, str(ROOT / "scripts"))

from accuracy.runs import Results, Run, Setting, make_method
from timings.grid import replace_marked

BASE = Setting("walk", 8, 1, "apf", "voxel", 200, 10)


def a_run(setting: Setting, seed: int, mean: float, *lost: str) -> Run:
    joints = {"pelvis": [mean, 1.0, 2.0]}
    return Run(
        setting, seed, 9, mean, mean, 99.0, 3.0, 10.0, 20.0, list(lost), 0.0, 0, 0.9, 1.5, joints
    )


def test_runs_are_kept_and_resumed(tmp_path: Path) -> None:
    path = tmp_path / "out" / "results.json"
    results = Results.resume(path, {"filter": {"noise": 0.5}})
    results.add(a_run(BASE, 0, 40.0))
    results.add(a_run(BASE, 1, 44.0, "left arm"))
    again = Results.resume(path, {"filter": {"noise": 0.5}})
    assert again.runs == results.runs
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
    for key, wrong in (("method", "luck"), ("objective", "edge+smell")):
        with pytest.raises(InputError, match=rf"{wrong[-4:]}.*expected"):
            make_method(replace(BASE, **{key: wrong}), 0)


def test_shapes_by_their_vertices() -> None:
    """Rymut 2016, table 6.5."""
    setting = replace(BASE, method="pso", objective="sp@130")
    assert make_method(setting, 0).image.vertices_per_part == 130
    assert make_method(replace(setting, objective="sp"), 0).image.vertices_per_part == 4
    with pytest.raises(InputError, match=r"many.*expected"):
        make_method(replace(setting, objective="sp@many"), 0)


def test_text_between_marks(tmp_path: Path) -> None:
    page = tmp_path / "README.md"
    page.write_text("a\n<!-- x: begin -->\nold\n<!-- x: end -->\nb\n")
    replace_marked(page, "x", "new")
    assert page.read_text() == "a\n<!-- x: begin -->\nnew\n<!-- x: end -->\nb\n"
    with pytest.raises(InputError, match="expected <!-- y: begin -->"):
        replace_marked(page, "y", "new")
