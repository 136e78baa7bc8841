"""Scaling and inverse kinematics by OpenSim, in a process of its own: it writes a log where it
runs."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from apf.formats.motion import BodyMotion
from apf.formats.opensim.model import find_model, read_model
from apf.formats.opensim.setup import (
    ANGLES,
    INVERSE_KINEMATICS,
    MARKER_SET,
    MARKERS,
    MODEL,
    SCALED,
    SCALING,
    write_setup,
)
from cl import InputError
from psfs.common.files import write_atomically

_PROGRAM = f"""
import opensim
opensim.Logger.setLevelString("error")
opensim.ScaleTool("{SCALING}").run()  # returns False in 4.6, also where it succeeds
opensim.InverseKinematicsTool("{INVERSE_KINEMATICS}").run()
"""


def write_opensim(folder: Path, motion: BodyMotion, model: Path | None) -> tuple[Path, ...]:
    """Write the set-up of the motion for OpenSim into `folder`, see `apf.formats.opensim.setup`,
    and, if Python's opensim is installed, the scaled model and its angles over time. model: the
    generic one, by default Pose2Sim's. Returns the files. Raises InputError."""
    generic = read_model(find_model(model))
    folder.mkdir(parents=True, exist_ok=True)
    files = write_setup(folder, motion, generic)
    if importlib.util.find_spec("opensim") is None:
        return files
    return files + run_tools(folder, Path(sys.executable))


def run_tools(folder: Path, python: Path) -> tuple[Path, ...]:
    """Scale the model in `folder` and compute its inverse kinematics, by a Python that has opensim;
    return the new files. Raises InputError with OpenSim's last line if it fails."""
    with tempfile.TemporaryDirectory() as scratch:
        for name in (MODEL, MARKERS, MARKER_SET, SCALING, INVERSE_KINEMATICS):
            shutil.copy(folder / name, scratch)
        done = subprocess.run(
            [str(python), "-c", _PROGRAM], cwd=scratch, capture_output=True, text=True, check=False
        )
        made = [Path(scratch) / name for name in (SCALED, ANGLES)]
        if done.returncode or not all(path.is_file() for path in made):
            lines = (done.stderr.strip() or done.stdout.strip()).splitlines()
            last = lines[-1] if lines else "no message"
            raise InputError(f"{folder}: OpenSim failed: {last}")
        for path in made:
            with write_atomically(folder / path.name) as temporary:
                shutil.copy(path, temporary)
    return tuple(folder / path.name for path in made)
