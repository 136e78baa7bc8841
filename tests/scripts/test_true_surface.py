"""scripts/true_surface.py: distances between a cloud and a known surface."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.shared import ROOT

from cl import Device
from psfs.reference.surface import surface_voxels
from psfs.voxels.grid import VoxelCloud, VoxelGrid

sys.path.insert(0, str(ROOT / "scripts"))

import true_surface

GRID = VoxelGrid.covering(np.full(3, -0.4), np.full(3, 0.4), 0.02)


def ball(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points, axis=1) - 0.3


def cloud(filled: np.ndarray) -> VoxelCloud:
    indices = surface_voxels(filled)
    return VoxelCloud(GRID, indices, np.ones(len(indices), np.float32))


def test_a_ball_and_half_of_it() -> None:
    filled = (ball(GRID.centres()) < 0).reshape(GRID.shape)
    whole = true_surface.score_surface(cloud(filled), ball)
    assert whole["accuracy_mm"] < 12 and whole["completeness_mm"] < 15
    assert whole["accurate"] == 1 and whole["complete"] > 0.9
    filled[:, :, : GRID.shape[2] // 2] = False
    half = true_surface.score_surface(cloud(filled), ball)
    assert 0.4 < half["complete"] < 0.6 and half["completeness_mm"] > 50
    assert half["accurate"] < 0.8  # the cut is no part of the surface


def test_the_area_of_the_sampled_surface() -> None:
    points = true_surface.find_surface_points(GRID, ball)
    assert len(points) * 0.01**2 == pytest.approx(4 * np.pi * 0.3**2, rel=0.05)
    assert np.abs(ball(points)).max() < 0.005


def test_other_folders_have_no_true_surface(tmp_path: Path, device: Device) -> None:
    assert true_surface.open_true_surface(tmp_path, device) is None
