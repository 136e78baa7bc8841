"""Read Middlebury's multi-view `*_par.txt`.

The first line is the number of views; each further line has the image's name, K (9, row-major), R
(9) and t (3), with P = K [R t].
"""

from __future__ import annotations

from pathlib import Path

from cl import InputError
from psfs.cameras.calibration.common import (
    Calibration,
    Size,
    Sizes,
    build_rig,
    name_file_in_errors,
    parse_numbers,
    parse_rotation,
    read_text,
)
from psfs.cameras.camera import Camera
from psfs.cameras.units import Unit

_NUMBERS = 21


def read_middlebury(path: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read the cameras in the order of the file, named after their images without suffix.

    Metres unless `unit` says otherwise. No distortion.
    """
    with name_file_in_errors(path):
        lines = [line.split() for line in read_text(path).splitlines() if line.strip()]
        promised = " ".join(lines.pop(0)) if lines else "nothing"
        if promised != str(len(lines)):
            raise InputError(f"{len(lines)} views; the first line promises {promised}")
        names = [Path(words[0]).stem for words in lines]
        of_view = dict(zip(names, lines, strict=True))
        return build_rig(names, sizes, lambda n, size: _camera(n, of_view[n][1:], size), unit, "m")


def _camera(name: str, words: list[str], size: Size) -> Camera:
    if len(words) != _NUMBERS:
        raise InputError(f"view {name}: {len(words)} numbers; expected {_NUMBERS}")
    values = parse_numbers(words, f"view {name}")
    return Camera(
        name=name,
        K=values[:9] / values[8],
        distortion=values[:0],
        R=parse_rotation(values[9:18], f"view {name}: R"),
        t=values[18:],
        size=size,
    )
