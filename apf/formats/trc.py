"""Read and write TRC files, the marker trajectories of OpenSim and Pose2Sim.

Written in millimetres; read in metres, centimetres or millimetres. The axes follow one of
`CONVENTIONS`, by default Y up: TRC (X, Y, Z) = world (x, z, -y).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from apf.formats import AXES
from cl import InputError
from psfs.cameras.units import rotation_to_z_up
from psfs.common.files import MOST_BYTES, open_text, read_text
from psfs.common.numbers import FROM_Y_UP, METRES, drop_origin
from psfs.common.ranges import FARTHEST, LARGEST, MOST_FRAMES

#: Rotations from TRC axes to the world's (Z up): world = trc @ matrix.T
CONVENTIONS: dict[str, np.ndarray] = dict(
    zip(
        AXES,
        (
            FROM_Y_UP,  # world = (X, -Z, Y), as written here
            rotation_to_z_up("y"),  # world = (Z, X, Y)
            rotation_to_z_up("z"),  # world = (X, Y, Z)
        ),
        strict=True,
    )
)
_KEYS = ("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units",
         "OrigDataRate", "OrigDataStartFrame", "OrigNumFrames")  # fmt: skip


@dataclass(frozen=True, eq=False)
class JointSeries:
    """Named points over time.

    joints: (F, J, 3) m in the world, Z up, NaN where missing. frames: (F,) int, frame indices of
    the sequence, counted from 0. fps: of the sequence. deviation: (F, J) m, root mean square error
    of the points, NaN where unknown. note: their origin, for files that have room for a remark.
    """

    joint_names: tuple[str, ...]
    joints: np.ndarray
    fps: float
    frames: np.ndarray
    deviation: np.ndarray | None = None
    note: str = ""

    def resample(self, fps: float, start: float | None = None) -> JointSeries:
        """Resample the points to a sequence with `fps` by linear interpolation.

        NaN next to missing points and frames; the result ends where the points end. start: the row
        that is the sequence's frame 0, by default as the frame numbers say.
        """
        rate, rows = self.to_constant_rate()
        points = np.where(rows[:, None, None] < 0, np.nan, self.joints[rows])
        ratio = rate / fps
        begin = -float(self.frames[0]) * rate / self.fps if start is None else start
        first, last = (math.ceil(-begin / ratio), (len(points) - 1 - begin) / ratio)
        frames = np.arange(max(0, first), math.floor(last + 1e-9) + 1)
        places = np.clip(begin + frames * ratio, 0, len(points) - 1)
        low = np.floor(places + 1e-9).astype(int)
        share = np.maximum(places - low, 0)[:, None, None]
        high = np.minimum(low + 1, len(points) - 1)
        between = (1 - share) * points[low] + share * points[high]
        joints = np.where(share < 1e-9, points[low], between)
        return JointSeries(self.joint_names, joints, fps, frames, note=self.note)

    def at_rate(self, fps: float) -> JointSeries:
        """Return the points at the frames' times of a sequence with `fps`; as they are if the
        rates differ by less than 1 %, as nominal ones do from measured ones."""
        return self if abs(fps - self.fps) <= 0.01 * self.fps else self.resample(fps)

    @property
    def times(self) -> np.ndarray:
        """Times since the sequence's first frame (F,), s."""
        return self.frames / self.fps

    def to_constant_rate(self) -> tuple[float, np.ndarray]:
        """Return a constant rate, frames/s, and the row (N,) of each frame, for files without
        times.

        A row is -1 for a frame that a live program skipped. Raises InputError if the frames are so
        far apart that such a file would consist almost entirely of gaps.
        """
        if len(self.frames) < 2:
            return self.fps, np.arange(len(self.frames))
        beats = self.frames - self.frames[0]
        step = max(int(np.gcd.reduce(beats)), 1)
        if beats[-1] // step >= MOST_FRAMES:
            raise InputError(
                f"frames {self.frames[0]} to {self.frames[-1]} in steps of {step} are too many for "
                f"a file without times; expected at most {MOST_FRAMES}"
            )
        rows = np.full(beats[-1] // step + 1, -1)
        rows[beats // step] = np.arange(len(beats))
        return self.fps / step, rows


def write_trc(path: str | Path, series: JointSeries, convention: str = "y-up") -> None:
    """Write a TRC that OpenSim opens, in mm; convention: its axes, one of `CONVENTIONS`.

    Frame# is the sequence's frame index + 1 and Time is the index over fps, so that a track of some
    frames stays in step with the whole video. Missing points are NaN: OpenSim refuses a row that
    ends blank.
    """
    path = Path(path)
    n, n_joints = series.joints.shape[:2]
    step = float(np.median(np.diff(series.frames))) if n > 1 else 1.0
    start = int(series.frames[0]) + 1 if n else 1
    rate, camera_rate = f"{series.fps / max(step, 1.0):g}", f"{series.fps:g}"
    values = (rate, camera_rate, n, n_joints, "mm", camera_rate, start, n)
    names = ["_".join(name.split()) for name in series.joint_names]
    turned = series.joints @ CONVENTIONS[convention]  # the inverse is the transpose
    points = 1000 * turned.reshape(n, 3 * n_joints)
    header = [
        ["PathFileType", "4", "(X/Y/Z)", path.name],
        _KEYS,
        map(str, values),
        ["Frame#", "Time", *(cell for name in names for cell in (name, "", ""))],
        ["", "", *(f"{axis}{j}" for j in range(1, n_joints + 1) for axis in "XYZ")],
        [],
    ]
    with open_text(path) as file:
        for cells in header:
            file.write("\t".join(cells) + "\n")
        for index, row in zip(series.frames, points, strict=True):
            cells = ["NaN" if np.isnan(value) else f"{value:.5f}" for value in row]
            file.write("\t".join([f"{index + 1}", f"{index / series.fps:.6f}", *cells]) + "\n")


def read_trc(path: str | Path, convention: str = "y-up") -> JointSeries:
    """Read the markers of a TRC in metres, Z up.

    convention: one of `CONVENTIONS`, since a TRC does not state its axes. Missing markers are
    blank, NaN or 0 0 0. Frame numbers count from 1, or from 0 if the first is 0. Raises InputError
    naming the line that is wrong.
    """
    path = Path(path)
    lines = read_text(path, "a TRC file", MOST_BYTES).splitlines()
    if len(lines) < 5 or not lines[0].startswith("PathFileType"):
        raise InputError(
            f"{path}: not a TRC file; expected its first line to be PathFileType 4 ..."
        )
    fps, scale, promised = _parse_header(path, lines)
    labels = lines[3].split("\t")
    names = tuple(label.strip() for label in labels[2:] if label.strip())
    if not names:
        raise InputError(f"{path}: line 4 names no marker; expected Frame#, Time and the names")
    rows = [
        _parse_row(path, number, line, len(names))
        for number, line in enumerate(lines[5:], 6)
        if line.strip()  # skips the blank line after the header, and any at the end
    ]
    if not rows:
        raise InputError(f"{path}: holds no frame after the header")
    table = np.array(rows)
    if not (np.abs(table[:, 0]) <= LARGEST).all():
        raise InputError(f"{path}: a Frame# is not a number from 0 to {LARGEST:g}")
    if promised is not None and promised > len(rows):
        raise InputError(
            f"{path}: {len(rows)} frames; its NumFrames promises {promised}; it is cut or damaged"
        )
    frames = np.rint(table[:, 0]).astype(np.int64)
    frames -= 0 if frames[0] == 0 else 1
    if np.any(np.diff(frames) <= 0):
        raise InputError(f"{path}: its Frame# do not ascend; expected each frame once, in order")
    points = table[:, 2:].reshape(len(rows), len(names), 3) * scale
    if np.nanmax(np.abs(points), initial=0) > FARTHEST:
        raise InputError(
            f"{path}: a marker lies {np.nanmax(np.abs(points)):g} m from the origin; expected up "
            f"to {FARTHEST:g} m: are its Units right?"
        )
    return JointSeries(names, drop_origin(points) @ CONVENTIONS[convention].T, fps, frames)


def _parse_header(path: Path, lines: list[str]) -> tuple[float, float, int | None]:
    """Parse fps, metres per unit and the number of frames, if stated, from lines 2 and 3.

    The keys are on line 2, each above its value.
    """
    header = dict(zip(lines[1].split(), lines[2].split(), strict=False))
    rate = header.get("CameraRate", header.get("DataRate", ""))
    unit = header.get("Units", "")
    if unit not in METRES:
        raise InputError(f"{path}: Units is {unit!r}; expected one of {', '.join(METRES)}")
    try:
        fps = float(rate)
    except ValueError:
        fps = 0.0
    if not 1e-3 <= fps <= 1e5:
        raise InputError(f"{path}: CameraRate is {rate!r}; expected a number from 0.001 to 100000")
    n_frames = header.get("NumFrames", "")
    return fps, METRES[unit], int(n_frames) if re.fullmatch(r"\d{1,9}", n_frames) else None


def _parse_row(path: Path, number: int, line: str, n_markers: int) -> list[float]:
    """Parse Frame#, Time and 3 values per marker; NaN where blank, or where a row ends early."""
    cells = [cell.strip() for cell in line.rstrip("\r\n").split("\t")]
    expected = 2 + 3 * n_markers
    cells = cells[:expected] + [""] * (expected - len(cells)) + [c for c in cells[expected:] if c]
    if len(cells) > expected or not cells[0]:
        raise InputError(
            f"{path}: line {number} has {len(cells)} values; expected {expected} "
            f"(Frame#, Time and 3 for each of {n_markers} markers), separated by tabs"
        )
    try:
        return [float(cell) if cell else np.nan for cell in cells]
    except ValueError as error:
        raise InputError(f"{path}: line {number}: {error}") from None
