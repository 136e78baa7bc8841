"""Where things are: the repository, and the folders of real data beside it."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared" / "data"


def shared_data(name: str) -> Path:
    """The folder `name` of the shared data; the test is skipped where it is absent."""
    folder = SHARED / name
    if not folder.is_dir():
        pytest.skip(f"needs the data folder {folder}")
    return folder
