"""Read what other programs' files say of a board: Caliscope, Pose2Sim, OpenCV."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cl import InputError, MissingFileError
from psfs.calibration.targets.dictionaries import DICTIONARIES
from psfs.cameras.calibration.common import name_file_in_errors
from psfs.cameras.calibration.filestorage import read_storage
from psfs.common.files import read_toml
from psfs.common.numbers import INCH

EXPECTED = (
    "Caliscope's charuco.toml or config.toml, Pose2Sim's Config.toml, or the settings of OpenCV's "
    "calibration sample (xml, yml)"
)
#: Patterns of OpenCV's sample.
_PATTERNS = {"CHESSBOARD": "chessboard", "CHARUCOBOARD": "charuco"}


@dataclass(frozen=True)
class BoardFacts:
    """A board. kind: charuco or chessboard. squares: (columns, rows). square, marker: sides, m;
    marker None: not stated. dictionary: a name of `DICTIONARIES`, or auto."""

    kind: str
    squares: tuple[int, int]
    square: float
    marker: float | None = None
    dictionary: str = "auto"


def read_board(path: Path) -> BoardFacts:
    """Read a board's file. Raises InputError, which names the file, for one that states none."""
    if not path.is_file():
        raise MissingFileError(
            f"{path}: no such file; expected charuco, chessboard, or a board's file: {EXPECTED}"
        )
    with name_file_in_errors(path):
        try:
            if path.suffix.lower() != ".toml":
                return _read_opencv(path)
            content = read_toml(path)
            if (table := content.get("charuco", content)).keys() >= {"columns", "rows"}:
                return _read_caliscope(table)
            lenses = content["calibration"]["calculate"]["intrinsics"]
            return _read_pose2sim(lenses)
        except KeyError as error:
            raise InputError(f"no {error}; expected {EXPECTED}") from None
        except (TypeError, ValueError, AttributeError) as error:
            raise InputError(f"{error}; expected {EXPECTED}") from None


def _read_caliscope(table: Mapping[str, Any]) -> BoardFacts:
    """Read the table of a ChArUco board: its squares fill the page unless a side, cm, is stated."""
    columns, rows = int(table["columns"]), int(table["rows"])
    override = table.get("square_size_override_cm") or table.get("square_size_overide_cm")
    if override:
        square = float(override) / 100
    else:
        unit = {"inch": INCH, "cm": 0.01}[str(table["units"])]
        width, height = float(table["board_width"]), float(table["board_height"])
        square = unit * min(width / columns, height / rows)
    family = _find_family(str(table["dictionary"]))
    marker = square * float(table.get("aruco_scale", 0.75))
    return BoardFacts("charuco", (columns, rows), square, marker, family)


def _read_pose2sim(table: Mapping[str, Any]) -> BoardFacts:
    """Read the checkerboard for intrinsics: inner corners, and the square's side, mm."""
    corners, side = table["intrinsics_corners_nb"], table["intrinsics_square_size"]
    if not isinstance(side, (int, float)):
        raise InputError(f"intrinsics_square_size is {side}; expected one number, mm")
    rows, columns = (int(count) + 1 for count in corners)
    return BoardFacts("chessboard", (columns, rows), float(side) / 1000)


def _read_opencv(path: Path) -> BoardFacts:
    """Read the settings of OpenCV's sample: sizes in mm; a chessboard's by its inner corners."""
    content = read_storage(path)
    node = content.get("Settings", content)
    pattern = _PATTERNS.get(str(node.get("Calibrate_Pattern")), "")
    width, height, square, marker = (
        float(node.get(key, 0))
        for key in ("BoardSize_Width", "BoardSize_Height", "Square_Size", "Marker_Size")
    )
    name = str(node.get("ArUco_Dict_Name", ""))
    if not pattern or min(width, height, square) <= 0:
        raise InputError(
            "no Calibrate_Pattern of CHESSBOARD or CHARUCOBOARD with BoardSize_Width, "
            f"BoardSize_Height and Square_Size; expected {EXPECTED}"
        )
    squares, side = (int(width), int(height)), square / 1000
    if pattern == "chessboard":
        return BoardFacts(pattern, (squares[0] + 1, squares[1] + 1), side)
    return BoardFacts(pattern, squares, side, marker / 1000 or None, _find_family(name))


def _find_family(name: str) -> str:
    """Return the family of OpenCV's set of markers; auto for none. Raises InputError."""
    if not name:
        return "auto"
    for family, sets in DICTIONARIES.items():
        if name == f"DICT_{family}" or name.rsplit("_", 1)[0] == f"DICT_{family}" or name in sets:
            return family
    raise InputError(f"dictionary {name}; expected one of {', '.join(DICTIONARIES)}")
