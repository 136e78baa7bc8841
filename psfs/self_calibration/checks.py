"""Checks of cameras that were found from a person: whether the silhouettes fit, whether another
arrangement fits as well, and how well the cameras' directions are known."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cl import InputError
from psfs.cameras.camera import Camera
from psfs.diagnostics.frontier import FrontierPoints
from psfs.self_calibration.adjustment import (
    Adjusted,
    PersonPoints,
    adjust_frontier,
    measure_pairs,
    measure_turn,
    summarise_pairs,
)
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.take import FILM


def differ(first: Adjusted, second: Adjusted, step: int, config: PersonConfig) -> bool:
    """Return whether two rigs are different arrangements."""
    turn = measure_turn(first.rig.cameras, second.rig.cameras)
    late = float(np.abs(first.lags - second.lags).max())
    return turn > config.growth.same or late > config.search.same_lag * step


def find_rival(
    best: Adjusted, ranked: list[tuple[float, Adjusted]], points: PersonPoints, step: int,
    config: PersonConfig,
) -> Adjusted | None:  # fmt: skip
    """Return another arrangement that fits every camera about as well as the best, if there is
    one. An arrangement that becomes the best one when it is adjusted is not another."""
    if len(ranked) < 2 or ranked[1][0] > config.distinct * ranked[0][0]:
        return None
    rival = adjust_frontier(ranked[1][1].rig, ranked[1][1].lags, points)
    return rival if rival is not None and _fit_alike(best, rival, points, step, config) else None


def check_unambiguous(
    best: Adjusted, rival: Adjusted, points: PersonPoints, step: int, config: PersonConfig
) -> None:
    """Raise InputError if the rival fits every camera about as well as the best."""
    if not _fit_alike(best, rival, points, step, config):
        return
    own, other = (summarise_pairs(measure_pairs(of, points)) for of in (best, rival))
    late = float(np.abs(rival.lags - best.lags).max())
    turn = np.degrees(measure_turn(best.rig.cameras, rival.rig.cameras))
    raise InputError(
        f"two arrangements of the cameras fit alike, to {own.max():.2f} and {other.max():.2f} px: "
        f"times differ by up to {late:.0f} frames, directions by {turn:.0f} degrees, as of "
        "somebody who walks on a circle; film one person who walks straight lines to and fro, "
        "turns and stops"
    )


def _fit_alike(
    best: Adjusted, rival: Adjusted, points: PersonPoints, step: int, config: PersonConfig
) -> bool:
    """Return whether two rigs are different arrangements of which the second fits no camera worse.

    Cameras are compared one by one, for most of them may stand the same in both. Misfits below the
    contours' noise are alike.
    """
    own, other = (summarise_pairs(measure_pairs(of, points)) for of in (best, rival))
    worse = other > config.distinct * np.maximum(own, config.adjustment.narrow.noise)
    return differ(rival, best, step, config) and not worse.any()


def check_directions(best: Adjusted, config: PersonConfig) -> None:
    """Raise InputError if the silhouettes do not tell well enough where the cameras look, as of
    somebody who stays in place. The times, which silhouettes tell better, are in the message."""
    turns = np.degrees(np.linalg.norm(best.last.sigmas[:, :3], axis=1))
    worst, names = int(np.argmax(turns)), best.rig.names
    if not turns[worst] <= np.degrees(config.worst_direction):
        late = list_lags(best.rig, best.lags)
        raise InputError(
            f"the silhouettes tell the direction of {names[worst]} to a standard deviation of "
            f"{turns[worst]:.2f} degrees, as of somebody who stays in place; expected "
            f"{np.degrees(config.worst_direction):.2f} or less; the times are found, frames late: "
            f"{late}; {FILM}"
        )


def list_lags(cameras: Iterable[Camera], lags: np.ndarray) -> str:
    return ", ".join(f"{of.name} {lag:+.2f}" for of, lag in zip(cameras, lags, strict=True))


def measure_worst_misfit(adjusted: Adjusted, points: PersonPoints) -> float:
    misfits = summarise_pairs(measure_pairs(adjusted, points))
    return float(np.nan_to_num(misfits, nan=np.inf).max())


def check_fit(
    best: Adjusted | None, points: PersonPoints, config: PersonConfig
) -> tuple[Adjusted, np.ndarray, FrontierPoints]:
    """Return the adjusted rig, the cameras' misfits (V,), px, and its frontier points. Raises
    InputError if the silhouettes do not fit."""
    if best is None:
        raise InputError(f"no arrangement of the cameras fits the silhouettes; {FILM}")
    names, pairs = best.rig.names, measure_pairs(best, points)
    misfits = summarise_pairs(pairs)
    worst = int(np.argmax(misfits))
    if not np.isfinite(misfits[worst]):
        raise InputError(
            f"{names[worst]} shares too few pictures of the whole person with two other cameras "
            f"that do not stand opposite to it; {FILM}"
        )
    most = config.worst_residual if len(names) > 3 else config.worst_of_three
    if misfits[worst] > most:
        raise InputError(
            f"the silhouettes fit no arrangement of the cameras: those of {names[worst]} and the "
            f"other cameras differ by {misfits[worst]:.2f} px, expected at most {most:g} with "
            f"{len(names)} cameras; {FILM}"
        )
    judged = exclude_lone_pairs(pairs, config)
    if np.nanmax(judged) > config.worst_pair:
        a, b = divmod(int(np.nanargmax(judged)), len(names))
        raise InputError(
            f"the silhouettes fit no arrangement of the cameras: those of {names[a]} and "
            f"{names[b]} differ by {pairs[a, b]:.2f} px, expected at most {config.worst_pair:g}; "
            f"{FILM}"
        )
    shifts = np.round(best.lags).astype(int)
    touched = points.find_all(best.rig.cameras, shifts, config.adjustment.gates[-1])
    return best, misfits, touched


def exclude_lone_pairs(pairs: np.ndarray, config: PersonConfig) -> np.ndarray:
    """Return the pairs (V, V), px, NaN where both cameras fit all others, two or more each: cameras
    that face each other may see the same shadow on the floor, which tells nothing then."""
    judged = pairs.copy()
    for a, b in np.argwhere(pairs > config.worst_pair):
        others = [np.delete(pairs[view], [a, b]) for view in (a, b)]
        known = [own[np.isfinite(own)] for own in others]
        if all(len(own) >= 2 and own.max() <= config.worst_of_three for own in known):
            judged[a, b] = np.nan
    return judged
