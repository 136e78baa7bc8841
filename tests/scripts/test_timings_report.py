"""What is reported of timings: the results' files, the papers' figures, the page made of them."""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.shared import ROOT

sys.path.insert(0, str(ROOT / "scripts"))

from timings.report import (
    read_machines,
    serial_share,
)
from timings.results import Results
from timings.stages import find_stage, stage_times

from apf.body.toml import load_body
from apf.filters.config import FilterConfig
from apf.initialisation.from_joints import fit_to_joints
from apf.synthetic.render import SyntheticScene
from apf.synthetic.scene import SceneConfig
from apf.timings.scene import Problem, Scene, WholeFrame, sequence_run, stream_run
from cl import Device, InputError, NumpyDevice
from psfs.background.gaussian import Background
from psfs.sequence import Frame


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


def small_problem(device: Device) -> Problem:
    """Two frames of a walk before three small cameras."""
    walk = SyntheticScene(SceneConfig(cameras=3, frames=2, size=(160, 120)), device)
    plates = np.stack([walk.background_frame(i) for i in range(6)]).astype(np.float32)
    shown = [walk.frame(i) for i in range(2)]
    frames = [Frame(i, images, 255 * numbers) for i, (images, numbers) in enumerate(shown)]
    background = Background(plates.mean(0), plates.std(0))
    scene = Scene(walk.rig, background, frames, walk.people_joints, tuple(walk.joint_names))
    joints = dict(zip(walk.joint_names, walk.joints[0], strict=True))
    body, pose, _ = fit_to_joints(load_body("song31"), joints)
    return Problem(scene, body, pose, FilterConfig.create(n_particles=30, n_layers=2), (50, 50, 33))


def test_the_whole_frame_on_the_device_agrees_with_the_twins(device: Device) -> None:
    problem = small_problem(device)
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
