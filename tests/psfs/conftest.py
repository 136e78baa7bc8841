"""Searches in coarse voxels, and a walk that takes some seconds."""

from pathlib import Path

import pytest

from apf.synthetic.generate import generate
from apf.synthetic.scene import SceneConfig
from cl import Device


@pytest.fixture(scope="session")
def slow_walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of four seconds of a walk, to read alone: 4 cameras, 12 frames, with a plate."""
    folder = tmp_path_factory.mktemp("slow") / "walk"
    config = SceneConfig(cameras=4, frames=12, fps=3, size=(160, 120), seed=4)
    generate(folder, config, Device.best())
    return folder


@pytest.fixture(autouse=True)
def _coarse_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are small: disagreeing cameras and furniture are searched in fewer voxels."""
    monkeypatch.setattr("psfs.diagnostics.agreement._VOXELS", 30_000)
    monkeypatch.setattr("psfs.diagnostics.occluders._VOXELS", 60_000)
