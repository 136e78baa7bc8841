"""Searches in coarse voxels: the pictures of these tests are small."""

import pytest

from psfs.diagnostics.occluders import find_hidden_in_box


@pytest.fixture(autouse=True)
def _coarse_searches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Disagreeing cameras and furniture are searched in fewer voxels."""
    monkeypatch.setattr("psfs.diagnostics.agreement._VOXELS", 30_000)
    _, margin = find_hidden_in_box.__defaults__
    monkeypatch.setattr(find_hidden_in_box, "__defaults__", (60_000, margin))
