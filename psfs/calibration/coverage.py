"""How much of the target each camera has seen, and what is missing for a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from psfs.calibration.config import CalibrationConfig
from psfs.calibration.start.placing import count_shared_frames
from psfs.calibration.targets.target import Sighting, group_by_view
from psfs.cameras.camera import Camera

#: Cells of a picture, across and down, for measuring coverage.
CELLS = (8, 6)


@dataclass(frozen=True, eq=False)
class Coverage:
    """One camera's sightings of the target, counted.

    frames: number of frames with the target. shared: most frames shared with one other camera; None
    if no other camera is needed. cells: (6, 8) bool, which cells of the picture held points.
    """

    frames: int
    shared: int | None
    cells: np.ndarray

    @property
    def share(self) -> float:
        """Share of the picture's cells that held points."""
        return float(self.cells.mean())

    def list_gaps(self, target: str, lenses_known: bool, config: CalibrationConfig) -> list[str]:
        """List what is missing, and what to do about it. target: its name."""
        gaps = []
        if self.frames < config.few_frames:
            gaps.append(
                f"sees too little: the {target} in {self.frames} frames, expected "
                f"{config.few_frames} or more; wave it longer where this camera looks"
            )
        elif self.shared is not None and self.shared < config.few_frames:
            gaps.append(
                f"sees too little together with others: {self.shared} frames, expected "
                f"{config.few_frames} or more; hold the {target} where two cameras see it at once"
            )
        if not lenses_known and self.share < config.coverage:
            gaps.append(
                f"sees the {target} in {100 * self.share:.0f} % of its picture, expected "
                f"{100 * config.coverage:.0f} or more: bring it nearer and into the corners, or "
                "use known lenses (--intrinsics)"
            )
        return gaps


def measure_coverage(cameras: Sequence[Camera], sightings: Sequence[Sighting]) -> list[Coverage]:
    """Return the coverage of each camera."""
    shared = count_shared_frames(sightings, len(cameras))
    found = []
    for view, own in enumerate(group_by_view(sightings, len(cameras))):
        pixels = np.concatenate([s.pixels for s in own] or [np.zeros((0, 2))])
        others = int(np.delete(shared[view], view).max(initial=0))
        found.append(Coverage(len(own), others, find_cells(pixels, cameras[view].size)))
    return found


def find_cells(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return which cells (6, 8) bool of a picture of `size` hold one of the pixels (N, 2)."""
    cells = np.zeros(CELLS[::-1], bool)
    at = (pixels / size * CELLS).astype(int).clip(0, np.array(CELLS) - 1)
    cells[at[:, 1], at[:, 0]] = True
    return cells
