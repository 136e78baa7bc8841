"""Judge a calibration camera by camera, and advise what to do where it is not good."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from psfs.calibration.calibrator import CalibrationResult
from psfs.calibration.config import CalibrationConfig
from psfs.calibration.coverage import Coverage, find_cells
from psfs.calibration.scene import all_reprojection_errors, rms
from psfs.calibration.targets.target import group_by_view
from psfs.cameras.camera import Camera

#: Reprojection errors, px: up to the first good, above the second unusable.
_GOOD, _BAD = 1.0, 3.0


@dataclass(frozen=True, eq=False)
class ViewReport:
    """The sightings of one camera.

    frames: number of frames with the target. shared: most frames shared with one other camera.
    pixels: (N, 2) of its points. errors: (N,) px. cells: (6, 8) bool, which cells hold points.
    dropped: sightings rejected as false. faults: what is wrong and what to do.
    """

    camera: Camera
    frames: int
    shared: int
    pixels: np.ndarray
    errors: np.ndarray
    cells: np.ndarray
    dropped: int
    faults: tuple[str, ...] = ()

    @property
    def coverage(self) -> float:
        """Share of the picture's cells that held points."""
        return float(self.cells.mean())

    def figures(self) -> dict[str, float]:
        """Return mean, median, 95th percentile and root mean square of the errors, px."""
        errors = self.errors
        return {
            "mean": float(errors.mean()),
            "median": float(np.median(errors)),
            "p95": float(np.percentile(errors, 95)),
            "rms": rms(errors),
        }


def summarise_views(
    result: CalibrationResult, lenses_known: bool, config: CalibrationConfig
) -> list[ViewReport]:
    """Summarise what every camera saw, and its faults."""
    found = []
    own = group_by_view(result.sightings, len(result.scene.cameras))
    for view, camera in enumerate(result.scene.cameras):
        sightings = own[view]
        pixels = np.concatenate([s.pixels for s in sightings] or [np.zeros((0, 2))])
        errors = all_reprojection_errors(result.scene, result.target, sightings)
        cells = find_cells(pixels, camera.size)
        shared = int(np.delete(result.shared[view], view).max(initial=0))
        dropped = result.dropped[camera.name]
        report = ViewReport(camera, len(sightings), shared, pixels, errors, cells, dropped)
        found.append(replace(report, faults=_list_faults(result, report, lenses_known, config)))
    return found


def _list_faults(
    result: CalibrationResult, view: ViewReport, lenses_known: bool, config: CalibrationConfig
) -> tuple[str, ...]:
    """List what is wrong with a camera and what to do."""
    name, what = view.camera.name, result.target.name
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
    seen = Coverage(view.frames, view.shared if result.target.known is None else None, view.cells)
    return (*faults, *seen.list_gaps(what, lenses_known, config))


def judge_calibration(views: list[ViewReport]) -> str:
    """Return one line that says how far the calibration can be trusted."""
    sound = [view for view in views if not view.faults] or views
    errors = np.concatenate([view.errors for view in sound])
    level = rms(errors)
    found = f"reprojection error {level:.2f} px (95 %: {np.percentile(errors, 95):.2f})"
    wrong = sum(bool(view.faults) for view in views)
    if level > _BAD:
        return f"not to be used: {found}"
    if level > _GOOD or wrong:
        count = f"; {wrong} of {len(views)} cameras to look at" if wrong else ""
        return f"to be used with care: {found}{count}"
    return f"good: {found}"


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
            "name": result.target.name,
            "points": len(result.target.points),
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
        "frames": view.frames,
        "points": len(view.errors),
        "left_out_as_false": view.dropped,
        "reprojection_px": {key: round(value, 4) for key, value in view.figures().items()},
        "coverage": round(view.coverage, 3),
        "position_m": camera.centre.round(5).tolist(),
        "focal_px": [round(camera.K[0, 0], 3), round(camera.K[1, 1], 3)],
        "centre_px": camera.K[:2, 2].round(3).tolist(),
        "distortion": camera.distortion.round(6).tolist(),
        "faults": list(view.faults),
    }
