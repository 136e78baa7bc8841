"""Temporary folders of processes that were killed are removed by the next one."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from psfs.common.files import temporary_folder


def test_folders_of_killed_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    orphan, other = tmp_path / f"psfs-apf-{process.pid}-a", tmp_path / "psfs-apf-notes"
    living = tmp_path / f"psfs-apf-{os.getppid()}-a"
    for folder in (orphan, other, living):
        (folder / "inside").mkdir(parents=True)
    with temporary_folder() as folder:
        assert folder.is_dir() and folder.parent == tmp_path
        assert sorted(tmp_path.iterdir()) == sorted([folder, other, living])
    assert sorted(tmp_path.iterdir()) == sorted([other, living])
