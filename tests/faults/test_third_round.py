"""Faults of the third round: interrupts while workers start, lists of people, corrections, models
of OpenSim, and errors that are handed on by Dask."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import tracks
from helpers.faults import refused
from helpers.opensim import write_model

from apf.cli.keypoints.flags import keypoints_path
from apf.filters.method import Method
from apf.formats.opensim.model import read_model
from apf.tracking.correction import Correction, Corrections
from apf.tracking.people import PeopleTracks
from apf.tracking.track import PEOPLE
from cl import DeviceError, InputError, MissingFileError
from psfs.cameras.calibration import find_calibration, read_calibration
from psfs.common.system import defer_interrupts
from psfs.voxels.grid import VoxelGrid

needs_signals = pytest.mark.skipif(os.name != "posix", reason="sends signals")


@needs_signals
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_interrupts_wait_until_workers_have_started(name: str) -> None:
    inside, before = [], signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), defer_interrupts():
        os.kill(os.getpid(), getattr(signal, name))
        inside.append(True)
    assert inside and signal.getsignal(signal.SIGINT) is before


@needs_signals
def test_processes_of_threads_started_inside_receive_no_interrupts() -> None:
    show = "import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()))"
    said = []

    def start() -> None:
        said.append(subprocess.run([sys.executable, "-c", show], capture_output=True, text=True,
                                   check=True).stdout.strip())  # fmt: skip

    with defer_interrupts():
        thread = threading.Thread(target=start)
        thread.start()
    thread.join()
    start()
    assert said == ["True", "False"]


@pytest.mark.parametrize("kind", [InputError, MissingFileError, DeviceError])
def test_errors_of_a_worker_arrive_as_they_were(kind: type[Exception]) -> None:
    support = pytest.importorskip("tblib.pickling_support")
    try:
        raise kind("a.toml: no such file")
    except kind as error:
        support.install(error)
        found = pickle.loads(pickle.dumps(error))
    assert type(found) is kind and str(found) == "a.toml: no such file"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"people": 99}, "99 people in the folders person1, person2"),
        ({"frames": "9-2"}, "frames 9-2; expected them ascending"),
        ({"frames": ", ".join(["0-9999999"] * 500)}, "expected them ascending"),
    ],
)
def test_lists_of_people(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    track = tracks.walker(3)
    PeopleTracks((track, track), track.frames, (track.frames,) * 2).save(tmp_path)
    path = tmp_path / PEOPLE
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))
    with pytest.raises(InputError) as error:
        PeopleTracks.open(tmp_path)
    assert said in str(error.value) and str(error.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("points", "bad", "said"),
    [
        ([], [(0, 10**12)], "bad frames 0 to 1000000000000; expected .* from 0 to 5"),
        ([], [(500, 600)], "bad frames 500 to 600"),
        ([0.1, 0.4], [], "l_wrist is corrected twice in frame 1"),
    ],
)
def test_corrections(points: list[float], bad: list[tuple[int, int]], said: str) -> None:
    places = tuple(Correction(1, "l_wrist", (x, 0.2, 1.0)) for x in points)
    with pytest.raises(InputError, match=said):
        Corrections(Path("t"), places, tuple(bad)).check(tracks.walker(6))


def test_a_joint_that_is_put_outside_of_the_room() -> None:
    grid = VoxelGrid(np.zeros(3), 0.1, (20, 20, 20))
    inside, outside = (Correction(1, "l_wrist", (x, 0.2, 1.0)) for x in (2.9, 1000.0))
    Corrections(Path("t"), (inside,)).check_places(grid)
    with pytest.raises(InputError, match=r"put to \[1000.0, 0.2, 1.0\]; expected a place in"):
        Corrections(Path("t"), (outside,)).check_places(grid)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("/bodyset/pelvis", "/bodyset/talus_l"), "not to pelvis"),
        (lambda text: '<!DOCTYPE a [<!ENTITY b "c">]>' + text, "a document type"),
    ],
)
def test_models_of_opensim(tmp_path: Path, change: Callable[[str], str], said: str) -> None:
    path = write_model(tmp_path / "m.osim")
    path.write_text(change(path.read_text()))
    with pytest.raises(InputError) as error:
        read_model(path)
    assert said in str(error.value) and "m.osim" in str(error.value)


def test_a_table_for_a_name_in_settings() -> None:
    with pytest.raises(InputError, match=r"search is \{'a': 1\}; expected apf, sir, pso"):
        Method.from_dict({"search": {"a": 1}})


@pytest.mark.parametrize("pattern", ["x/**a/[*", "**a"])
def test_patterns_of_keypoints(pattern: str, tmp_path: Path) -> None:
    from argparse import Namespace

    with pytest.raises(InputError, match="pattern"):
        keypoints_path(Namespace(keypoints=pattern), tmp_path)


def test_names_with_nul_in_a_list_of_takes(stock: Path) -> None:
    (stock / "list.toml").write_text('[[take]]\nfolder = "se\\u0000q"\n')
    words = ["apf", "batch", str(stock / "list.toml"), "-o", str(stock / "new"), "--workers", "1"]
    refused(words, stock, "holds the character NUL")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
def test_a_pipe_as_calibration(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "calibration.toml")
    found = find_calibration(tmp_path)
    assert found is not None
    with pytest.raises(InputError, match=r"calibration\.toml: is no regular file"):
        read_calibration(found)
