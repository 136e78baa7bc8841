"""What is reported of timings: the results' files, the papers' figures, the page made of them."""

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from timings.report import (
    read_machines,
    serial_share,
)
from timings.results import Results
from timings.stages import find_stage, stage_times

from apf.filters.config import FilterConfig
from apf.synthetic.scene import SceneConfig
from apf.timings.scene import WholeFrame, make_problem, sequence_run, stream_run
from cl import Device, InputError, NumpyDevice


def arguments(folder: Path, **changes: Any) -> argparse.Namespace:
    given = {"out": folder, "quick": True, "seconds": None, "resume": False, "commit": "abc"}
    return argparse.Namespace(**{**given, **changes})


def test_what_is_missing_is_told_and_measured_when_resumed(tmp_path: Path) -> None:
    def absent() -> None:
        raise ModuleNotFoundError("No module named 'open3d'")

    results = Results.begin("psfs", arguments(tmp_path), {})
    assert results.section("mine", lambda: 1) == 1
    assert results.section("open3d", absent) is None
    assert results.section("growth", lambda: 5, quick=False) is None
    assert results.left_out["growth"] == "not with --quick"
    late = Results.begin("psfs", arguments(tmp_path, resume=True, seconds=-1.0), {})
    assert late.section("late", lambda: 2) is None
    assert late.left_out["late"].startswith("no time left")
    resumed = Results.begin("psfs", arguments(tmp_path, resume=True), {})
    assert resumed.section("mine", lambda: 3) == 1
    assert resumed.section("open3d", lambda: 4) == 4
    assert resumed.left_out == {}
    with pytest.raises(InputError, match=r"settings is .*; expected"):
        Results.begin("psfs", arguments(tmp_path, resume=True), {"views": 3})


@pytest.mark.parametrize("text", ["", "[]", '{"schema": 1}'])
def test_a_file_that_is_no_results_is_told(tmp_path: Path, text: str) -> None:
    (tmp_path / "whole.json").write_text(text)
    with pytest.raises(InputError, match=r"whole\.json: .*results of compare_timings"):
        read_machines([tmp_path])


def test_amdahls_serial_share_is_found() -> None:
    times = [(n, 80.0 * (0.3 + 0.7 / n)) for n in (1, 2, 4, 16)]
    assert serial_share(times) == pytest.approx(0.3)


def test_the_whole_frame_on_the_device_agrees_with_the_twins(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two frames of a walk before three small cameras."""
    monkeypatch.setattr("apf.timings.scene.SceneConfig", partial(SceneConfig, size=(160, 120)))
    config = FilterConfig.create(n_particles=30, n_layers=2)
    problem = replace(make_problem(2, views=3), config=config, shape=(50, 50, 33))
    ours = sequence_run(WholeFrame(device, problem), 2)
    twins = sequence_run(WholeFrame(NumpyDevice(), problem), 2)
    assert len(ours["frames"].samples) == len(twins["frames"].samples) == 2
    assert ours["surface_voxels"] == pytest.approx(twins["surface_voxels"], rel=0.02)
    assert ours["error_mm"] == pytest.approx(twins["error_mm"], abs=25)
    held = problem.scene.pin(device)
    streamed = stream_run(WholeFrame(device, problem), held, 3)
    assert len(streamed["frames"].samples) == 3 and min(streamed["frames"].samples) > 0
    assert streamed["error_mm"] == pytest.approx(ours["error_mm"], abs=25)
    profiled = Device(device.handle, profile=True)
    stages = stage_times(WholeFrame(profiled, problem), 1, warm_up=1)
    busy = {"silhouette", "occupancy", "surface", "colour", "reprojection",
            "likelihood", "annealing", "refinement", "download"}  # fmt: skip
    assert busy <= set(stages)
    assert find_stage("score_poses") == "likelihood"
    assert find_stage("a kernel of another project") == "other"
