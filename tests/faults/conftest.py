"""A stock of small inputs, made once, and a copy of it for each fault."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from helpers import faults


@pytest.fixture(scope="session")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return faults.stock(tmp_path_factory.mktemp("faults") / "stock")


@pytest.fixture
def stock(original: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(original, tmp_path / "stock"))
