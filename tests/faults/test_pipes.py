"""Pipes and devices in the place of files: nobody waits for their other end."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.faults import refused

from apf.keypoints.opening import read_raw
from cl import InputError
from psfs.common.reading import open_input

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
VIEW = ["psfs", "view", "out", "--frame", "1"]
EVALUATE = ["apf", "evaluate", "track", "--truth", "truth.npz", "-o", "new"]
INFO = ["psfs", "info", "seq", "--no-pictures"]


PIPES = {
    "truth.npz": EVALUATE,
    "track/track.npz": ["apf", "smooth", "track", "-o", "new"],
    "c.toml": [*INFO, "--config", "c.toml"],
    "x.log": [*INFO, "--log-file", "x.log"],
    "out/summary.json": [*VIEW, "--png", "x.png"],
    "out/clouds/frame_000001.npz": [*VIEW, "--png", "x.png"],
    "out/manifest.txt": VIEW,
    "walk/calibration.toml": ["psfs", "info", "walk", "--no-pictures"],
    "walk/videos/cam01.mp4": ["psfs", "info", "walk", "--no-pictures"],
    "takes.toml": ["apf", "batch", "takes.toml", "-o", "new"],
}


@pytest.mark.parametrize("name", PIPES)
def test_pipes(stock: Path, name: str) -> None:
    (stock / name).unlink(missing_ok=True)
    os.mkfifo(stock / name)
    refused(PIPES[name], stock, Path(name).name)


@pytest.mark.parametrize("name", ["k.npz", "k.npy", "k.pkl", "k.csv", "k/c1_000000.json"])
def test_pipes_of_keypoints(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    os.mkfifo(path)
    with pytest.raises(InputError, match="is no regular file"):
        read_raw(path.parent if path.suffix == ".json" else path)


@pytest.mark.parametrize("path", ["/dev/zero", "/dev/null"])
def test_devices(path: str) -> None:
    with pytest.raises(InputError, match="is no regular file"):
        open_input(Path(path))


def test_files_are_written_for_a_reader_who_has_gone(stock: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    words = [sys.executable, "-m", "apf.cli", *EVALUATE[1:]]
    ended = subprocess.run(words, stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert (stock / "new" / "evaluation.csv").is_file()
