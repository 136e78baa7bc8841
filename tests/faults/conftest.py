"""A stock of small inputs, made once, and a copy of it for each fault."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from helpers import faults


@pytest.fixture(autouse=True)
def quick_preview(monkeypatch: pytest.MonkeyPatch) -> None:
    """Six shaded views take seconds, and no fault is in them."""
    picture = np.zeros((4, 6, 3), np.uint8)
    monkeypatch.setattr("psfs.cli.reconstruct.draw_preview", lambda *_: picture)
    monkeypatch.setattr("psfs.cli.view.draw_preview", lambda *_: picture)


@pytest.fixture(scope="session")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return faults.stock(tmp_path_factory.mktemp("faults") / "stock")


@pytest.fixture
def stock(original: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(original, tmp_path / "stock"))
