"""Judge a calibration camera by camera, and advise what to do where it is not good."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from psfs.calibration.calibrator import CalibrationResult
from psfs.calibration.scene import BAD, GOOD, reprojection_errors, rms
from psfs.calibration.start.placing import FEW_FRAMES, count_shared_frames
from psfs.calibration.targets.target import Sighting, group_by_view
from psfs.cameras.camera import Camera

#: Share of a picture's cells that should have held the target.
_COVERED = 0.3

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

    def list_gaps(self, target: str, lenses_known: bool) -> list[str]:
        """List what is missing, and what to do about it. target: its name."""
        gaps = []
        if self.frames < FEW_FRAMES:
            gaps.append(
                f"sees too little: the {target} in {self.frames} frames, expected "
                f"{FEW_FRAMES} or more; wave it longer where this camera looks"
            )
        elif self.shared is not None and self.shared < FEW_FRAMES:
            gaps.append(
                f"sees too little together with others: {self.shared} frames, expected "
                f"{FEW_FRAMES} or more; hold the {target} where two cameras see it at once"
            )
        if not lenses_known and self.share < _COVERED:
            gaps.append(
                f"sees the {target} in {100 * self.share:.0f} % of its picture, expected "
                f"{100 * _COVERED:.0f} or more: bring it nearer and into the corners, or "
                "use known lenses (--intrinsics)"
            )
        return gaps


def measure_coverage(
    cameras: Sequence[Camera], sightings: Sequence[Sighting], shared: np.ndarray | None = None
) -> list[Coverage]:
    """Return the coverage of each camera. shared: frames (V, V) that two cameras share, by default
    those of the sightings."""
    if shared is None:
        shared = count_shared_frames(sightings, len(cameras))
    coverages = []
    for view, group in enumerate(group_by_view(sightings, len(cameras))):
        pixels = np.concatenate([s.pixels for s in group] or [np.zeros((0, 2))])
        others = int(np.delete(shared[view], view).max(initial=0))
        coverages.append(Coverage(len(group), others, find_cells(pixels, cameras[view].size)))
    return coverages


def find_cells(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return which cells (6, 8) bool of a picture of `size` hold one of the pixels (N, 2)."""
    cells = np.zeros(CELLS[::-1], bool)
    at = (pixels / size * CELLS).astype(int).clip(0, np.array(CELLS) - 1)
    cells[at[:, 1], at[:, 0]] = True
    return cells


class ViewReport:
    """The sightings of one camera in a calibration.

    coverage: of its picture. pixels: (N, 2) of its points. errors: (N,) px. dropped: sightings
    rejected as false. faults: what is wrong and what to do.
    """

    def __init__(
        self, result: CalibrationResult, view: int, coverage: Coverage, lenses_known: bool
    ) -> None:
        self.camera, self.coverage = result.scene.cameras[view], coverage
        sightings = [sighting for sighting in result.sightings if sighting.view == view]
        self.pixels = np.concatenate([s.pixels for s in sightings] or [np.zeros((0, 2))])
        self.errors = reprojection_errors(result.scene, sightings)
        self.dropped = result.dropped[self.camera.name]
        self.faults = _list_faults(result, self.camera.name, coverage, lenses_known)

    def figures(self) -> dict[str, float]:
        """Return mean, median, 95th percentile and root mean square of the errors, px."""
        errors = self.errors
        return {
            "mean": float(errors.mean()),
            "median": float(np.median(errors)),
            "p95": float(np.percentile(errors, 95)),
            "rms": rms(errors),
        }


def summarise_views(result: CalibrationResult, lenses_known: bool) -> list[ViewReport]:
    """Summarise what every camera saw, and its faults."""
    coverages = measure_coverage(result.scene.cameras, result.sightings, result.shared)
    return [ViewReport(result, v, seen, lenses_known) for v, seen in enumerate(coverages)]


def _list_faults(
    result: CalibrationResult, name: str, seen: Coverage, lenses_known: bool
) -> tuple[str, ...]:
    """List what is wrong with a camera and what to do."""
    faults = []
    if name in result.disagreeing:
        faults.append(
            f"disagrees with the other cameras, which were calibrated without it: "
            f"{result.disagreeing[name]}"
        )
    if name in result.misfits:
        faults.append(
            f"{result.misfits[name]}; calibrate without --intrinsics, or with those of these "
            "pictures' size and zoom"
        )
    needed = seen if result.scene.target.known is None else replace(seen, shared=None)
    return (*faults, *needed.list_gaps(result.scene.target.name, lenses_known))


def judge_calibration(views: list[ViewReport]) -> str:
    """Return one line that says how far the calibration can be trusted."""
    sound = [view for view in views if not view.faults] or views
    errors = np.concatenate([view.errors for view in sound])
    level = rms(errors)
    summary = f"reprojection error {level:.2f} px (95 %: {np.percentile(errors, 95):.2f})"
    wrong = sum(bool(view.faults) for view in views)
    if level > BAD:
        return f"not to be used: {summary}"
    if level > GOOD or wrong:
        count = f"; {wrong} of {len(views)} cameras to look at" if wrong else ""
        return f"to be used with care: {summary}{count}"
    return f"good: {summary}"


def calibration_summary(
    result: CalibrationResult,
    views: list[ViewReport],
    what: Mapping[str, object],
    warnings: list[str],
) -> dict[str, object]:
    """Return the content of `calibration.json`; what: further entries, such as the command."""
    names = [view.camera.name for view in views]
    return {
        "verdict": judge_calibration(views),
        **what,
        "target": {
            "name": result.scene.target.name,
            "points": len(result.scene.target.points),
            "frames": len({s.frame for s in result.sightings}),
        },
        "warnings": warnings,
        "cameras": {view.camera.name: _view_summary(view) for view in views},
        "shared_frames": {
            name: {other: int(n) for other, n in zip(names, row, strict=True) if other != name}
            for name, row in zip(names, result.shared, strict=True)
        },
    }


def _view_summary(view: ViewReport) -> dict[str, object]:
    camera = view.camera
    return {
        "frames": view.coverage.frames,
        "points": len(view.errors),
        "left_out_as_false": view.dropped,
        "reprojection_px": {key: round(value, 4) for key, value in view.figures().items()},
        "coverage": round(view.coverage.share, 3),
        "position_m": camera.centre.round(5).tolist(),
        "focal_px": [round(camera.K[0, 0], 3), round(camera.K[1, 1], 3)],
        "centre_px": camera.K[:2, 2].round(3).tolist(),
        "distortion": camera.distortion.round(6).tolist(),
        "faults": list(view.faults),
    }
