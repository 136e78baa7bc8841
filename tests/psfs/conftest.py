"""Searches in coarse voxels: the pictures of these tests are small."""

import pytest


@pytest.fixture(autouse=True)
def _coarse_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Disagreeing cameras and furniture are searched in fewer voxels."""
    monkeypatch.setattr("psfs.diagnostics.agreement._VOXELS", 30_000)
    monkeypatch.setattr("psfs.diagnostics.occluders._VOXELS", 60_000)
