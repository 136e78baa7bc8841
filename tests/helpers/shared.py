"""Locations of the repository and of the shared data."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared" / "data"


def shared_data(name: str) -> Path:
    """Return the folder `name` of the shared data; skip the test if it is absent."""
    folder = SHARED / name
    if not folder.is_dir():
        pytest.skip(f"needs the data folder {folder}")
    return folder
