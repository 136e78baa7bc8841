"""What the cameras have seen of a calibration target so far, drawn and in words."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from psfs.calibration.report import CELLS, Coverage, measure_coverage
from psfs.calibration.targets.target import Sighting
from psfs.cameras.camera import CameraRig
from psfs.page.words import make_lines, make_table

#: RGB of found points, and how much darker parts of pictures without any are.
_POINT, _SHADE = (0, 230, 120), 0.45


class FoundTarget:
    """The sightings of a target by the cameras of `rig`."""

    def __init__(self, rig: CameraRig) -> None:
        self._rig = rig
        self._name = "target"
        self.sightings: list[Sighting] = []
        self.coverage: list[Coverage] = []

    def restart(self, name: str) -> None:
        """Forget all sightings; name: of the target that is searched for from now on."""
        self._name, self.sightings, self.coverage = name, [], []

    def add(self, found: Sequence[Sighting]) -> None:
        """Add the sightings of a frame."""
        self.sightings = [*self.sightings, *found]
        self.coverage = measure_coverage(list(self._rig), self.sightings)

    def mark(self, pictures: Sequence[np.ndarray], frame: int) -> None:
        """Draw the found points over pictures (h, w, 3) uint8 RGB, one per camera: those of a
        frame, by its number, larger; and darken the parts in which nothing was found."""
        for view, (picture, camera) in enumerate(zip(pictures, self._rig, strict=True)):
            if self.coverage:
                _shade(picture, self.coverage[view].cells)
            scale = picture.shape[1] / camera.size[0]
            for sighting in self.sightings:
                if sighting.view == view:
                    size = 3 if sighting.frame == frame else 1
                    for x, y in np.rint(scale * sighting.pixels).astype(int).tolist():
                        cv2.circle(picture, (x, y), size, _POINT, -1)

    def describe(self, lenses_known: bool) -> str:
        """Return what is found and what is missing, HTML. lenses_known: whether only the cameras'
        places are to be found."""
        rows, gaps = [], list[tuple[str, object]]()
        for camera, seen in zip(self._rig, self.coverage, strict=False):
            rows.append((camera.name, seen.frames, seen.shared, f"{seen.share:.0%}"))
            missing = seen.list_gaps(self._name, lenses_known)
            gaps += [("warning", f"{camera.name} {text}") for text in missing]
        if not rows:
            return ""
        heading = ("camera", "frames", "shared", "covered")
        return make_table(rows, heading) + make_lines(
            gaps or [("good", "every camera has seen enough")]
        )


def _shade(picture: np.ndarray, cells: np.ndarray) -> None:
    """Darken the cells (6, 8) of a picture (h, w, 3) uint8 in which nothing was found."""
    height, width = picture.shape[:2]
    columns, rows = CELLS
    for row, column in np.argwhere(~cells).tolist():
        part = picture[
            row * height // rows : (row + 1) * height // rows,
            column * width // columns : (column + 1) * width // columns,
        ]
        part[:] = (_SHADE * part).astype(np.uint8)
