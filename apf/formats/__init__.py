"""File formats of motion. A writer of joints stands in `WRITERS` by the ending of its files."""

from collections.abc import Callable
from pathlib import Path

from apf.formats.joint_csv import write_csv
from apf.formats.trc import JointSeries, write_trc

#: What writes named joints over time, by file ending.
WRITERS: dict[str, Callable[[str | Path, JointSeries], None]] = {
    ".trc": write_trc,
    ".csv": write_csv,
}

__all__ = ["WRITERS", "JointSeries", "write_csv", "write_trc"]
