"""A stock of small inputs, made once, and a copy of it for each fault."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import faults

from apf.initialisation.start import StartError


@pytest.fixture(autouse=True)
def _quick_view(monkeypatch: pytest.MonkeyPatch) -> None:
    """No fault is in the pictures of clouds."""
    picture = np.zeros((4, 6, 3), np.uint8)
    monkeypatch.setattr("psfs.cli.view.draw_preview", lambda *_: picture)


@pytest.fixture(scope="module", autouse=True)
def quick_recovery() -> Iterator[None]:
    """The stock's block is nobody, for whom a tracker that is lost searches everywhere in each
    frame; no fault is in that search."""

    def nowhere(*_: Any, **__: Any) -> None:
        raise StartError("nobody")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("apf.tracking.recovery.find_start", nowhere)
        yield


@pytest.fixture(scope="session")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return faults.stock(tmp_path_factory.mktemp("faults") / "stock")


@pytest.fixture
def stock(original: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy, which is the folder one is in."""
    folder = Path(shutil.copytree(original, tmp_path / "stock"))
    monkeypatch.chdir(folder)
    return folder
