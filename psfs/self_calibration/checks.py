"""Checks of cameras that were found from a person: whether another
arrangement fits as well, and how well the cameras' directions and positions are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from cl import InputError
from psfs.cameras.names import join_names
from psfs.cameras.rig_geometry import intersect_axes_ahead
from psfs.common.least_squares import estimate_noise, robust_weights
from psfs.common.numbers import FALSE_ALARMS, STEP_SECONDS
from psfs.diagnostics.frontier import epipolar_residuals
from psfs.diagnostics.refinement import N_PARAMETERS, NOISE, measure_scene_motion
from psfs.self_calibration.adjustment import (
    FARTHEST,
    LAST_GATE,
    Adjusted,
    PersonPoints,
    differ,
    measure_misfits,
    measure_turn,
)
from psfs.self_calibration.take import FILM


def fits_as_well(rival: Adjusted, best: Adjusted, points: PersonPoints, rate: float) -> bool:
    """Return whether a rig fits no camera worse than the best: by the ratio of the variances (F
    test), of one camera after the other, for most of them may stand the same in both.

    Misfits below the contours' noise are alike. rate: frames per second.
    """
    median = scipy.special.ndtri(0.75)  # of the size of normal noise
    misfits, others = (measure_misfits(a, points) / median for a in (best, rival))
    count = 2 * (len(best.rig) - 1) * points.shortest / (rate * STEP_SECONDS)
    limit = np.sqrt(scipy.special.fdtri(count, count, 1 - FALSE_ALARMS))
    return not (others > limit * np.maximum(misfits, NOISE)).any()


def check_unambiguous(best: Adjusted, rival: Adjusted, points: PersonPoints, rate: float) -> None:
    """Raise InputError if another arrangement fits as well as the best, see `fits_as_well`."""
    if not differ(rival, best) or not fits_as_well(rival, best, points, rate):
        return
    misfits, others = (measure_misfits(a, points) for a in (best, rival))
    late = float(np.abs(rival.lags - best.lags).max())
    turn = np.degrees(measure_turn(best.rig.cameras, rival.rig.cameras))
    raise InputError(
        f"two arrangements of the cameras fit alike, to {misfits.max():.2f} and {others.max():.2f} "
        f"px: times differ by up to {late:.0f} frames, directions by {turn:.0f} degrees, as of "
        "somebody who walks on a circle; film one person who walks straight lines to and fro, "
        "turns and stops"
    )


def advise(names: Sequence[str], points: PersonPoints) -> str:
    """Return what to film, and which camera saw least of it in this take."""
    seen = [whole / count for whole, count in zip(points.whole, points.counts, strict=True)]
    least = int(np.argmin(seen))
    here = f"{names[least]} shows the whole person least, in {points.whole[least]} of "
    return f"{FILM} (here {here}{points.counts[least]} pictures)" if seen[least] < 1 else FILM


def check_fit(best: Adjusted | None, points: PersonPoints) -> tuple[Adjusted, np.ndarray]:
    """Return the rig and the cameras' misfits (V,), px. Raises InputError if no rig was found, if
    a camera shares too little with the others, or if its silhouettes fit worse than any do."""
    if best is None:
        raise InputError(f"no arrangement of the cameras fits the silhouettes; {FILM}")
    advice = advise(best.rig.names, points)
    misfits = measure_misfits(best, points)
    worst = int(np.argmax(misfits))
    if not np.isfinite(misfits[worst]):
        raise InputError(
            f"{best.rig.names[worst]} shares too few pictures of the whole person with two other "
            f"cameras that do not stand opposite to it; {advice}"
        )
    if misfits[worst] > LAST_GATE:
        raise InputError(
            f"the silhouettes fit no arrangement of the cameras: those of {best.rig.names[worst]} "
            f"and the other cameras differ by {misfits[worst]:.2f} px, expected at most "
            f"{LAST_GATE:g}; {advice}"
        )
    return best, misfits


def measure_uncertainty(
    adjusted: Adjusted, points: PersonPoints, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the standard deviations of the cameras' directions (V,), rad, and of their positions
    (V,), as shares of the distance from the person.

    Silhouettes are wrong alike in neighbouring frames, and two cameras may see the same shadow in
    all: the errors of the points of half a second, and those of a pair of cameras, count together
    (cluster-robust covariance: Cameron, Gelbach & Miller, J. Business & Economic Statistics 29,
    2011). The room's edges and limbs, which are not counted, tell more: errors are
    0.4 to 0.7 of it. rate: frames per second.
    """
    cameras, shifts = adjusted.rig.cameras, adjusted.shifts
    touched = points.find_all(shifts, cameras, FARTHEST)  # with what is wrong alike
    residuals, slopes = epipolar_residuals(cameras, touched, shifts - adjusted.lags)
    size, rows = len(cameras) * N_PARAMETERS, np.arange(len(touched))
    by_camera = np.zeros((len(touched), len(cameras), N_PARAMETERS))
    for side in range(2):
        by_camera[rows, touched.views[:, side]] = slopes[:, side]
    jacobian = by_camera.reshape(-1, size)
    noise = estimate_noise(residuals, least=NOISE)
    weights = robust_weights(residuals, noise) / noise**2
    allowed, held = points.spread.copy(), measure_scene_motion(adjusted.rig) / 1e-3
    allowed[6] = 1e-4
    spread = np.tile(allowed, len(cameras))
    normal = (jacobian.T * weights) @ jacobian + np.diag(spread**-2.0) + held.T @ held
    inverse = np.linalg.inv(normal)
    pulls = (weights * residuals)[:, None] * jacobian
    blocks = (touched.frames / (rate * STEP_SECONDS)).astype(int)
    pairs = touched.views[:, 0] * len(cameras) + touched.views[:, 1]
    spreads = np.zeros((size, size))
    for clusters in (pairs, blocks):
        sums = np.zeros((clusters.max(initial=0) + 1, size))
        np.add.at(sums, clusters, pulls)
        spreads += sums.T @ sums
    variances = np.diag(inverse @ spreads @ inverse + inverse).reshape(-1, N_PARAMETERS)
    distances = np.linalg.norm(adjusted.rig.centres - intersect_axes_ahead(adjusted.rig), axis=1)
    turns = np.sqrt(variances[:, :3].sum(axis=1))
    return turns, np.sqrt(variances[:, 3:6].sum(axis=1)) / distances


def check_uncertainty(
    adjusted: Adjusted, turns: np.ndarray, shifts: np.ndarray, points: PersonPoints
) -> None:
    """Raise InputError if the silhouettes do not tell well enough where the cameras stand and look,
    as of somebody who stays in place. The times, which silhouettes tell better, are in the
    message. turns, shifts: see `measure_uncertainty`."""
    config, names = points.config, adjusted.rig.names
    for what, spreads, limit, unit, factor in (
        ("direction", turns, config.worst_direction, "degrees", np.degrees(1)),
        ("position", shifts, config.worst_position, "% of the distance from the person", 100.0),
    ):
        worst = int(np.argmax(spreads))
        if not spreads[worst] <= limit:
            late = (f"{name} {lag:+.2f}" for name, lag in zip(names, adjusted.lags, strict=True))
            raise InputError(
                f"{names[worst]}'s {what} is uncertain "
                f"({factor * spreads[worst]:.2f} {unit}, limit {factor * limit:.2f}), as of "
                "somebody who stays in place or is hidden: walk about more; the times are found, "
                f"frames late: {join_names(late)}; {advise(names, points)}"
            )
