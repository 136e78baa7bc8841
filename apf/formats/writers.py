"""Writers of files of motion, by file ending."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from apf.formats.angles import write_mot
from apf.formats.bvh import write_bvh
from apf.formats.c3d import write_c3d
from apf.formats.glb import write_glb
from apf.formats.joint_csv import write_csv
from apf.formats.motion import BodyMotion
from apf.formats.trc import JointSeries, write_trc

#: What writes named points over time, by file ending.
WRITERS: dict[str, Callable[[str | Path, JointSeries], object]] = {
    ".trc": write_trc,
    ".csv": write_csv,
    ".c3d": write_c3d,
}
#: What writes the motion of a body, by file ending.
BODY_WRITERS: dict[str, Callable[[str | Path, BodyMotion], None]] = {
    ".bvh": write_bvh,
    ".glb": write_glb,
    ".mot": write_mot,
}
