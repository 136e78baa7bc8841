"""Follow the clocks of cameras that run differently, by silhouettes in several places of a take."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy

from psfs.common.numbers import FALSE_ALARMS
from psfs.diagnostics.fault import LONGEST_OFFSET
from psfs.diagnostics.small_views import small_views
from psfs.diagnostics.tangency import Tangency
from psfs.footage.camera_times import MOST_DRIFT
from psfs.footage.settings import split_delays
from psfs.sequence import Sequence
from psfs.session import Session


def follow_clocks(session: Session, late: Mapping[str, int], n_frames: int) -> Sequence:
    """Return the session's sequence with late cameras shifted, and clocks followed that run
    differently.

    late: frames by which cameras come later in the middle, by name. n_frames: of a stretch in which
    offsets are measured. These are measured on both sides of the middle: first so near it that no
    clock leads beyond the offsets that are tried, then at the ends. A clock differs if chance would
    make it with a probability of at most `FALSE_ALARMS`, and if some frame is then half
    a frame off.
    """
    sequence = session.sequence.synchronise(late)
    n_frames = min(n_frames, len(sequence) // 2)
    most = min(round(LONGEST_OFFSET * sequence.fps), n_frames // 3)
    if most < 2:
        return sequence
    leader: int | None = None
    for reach in (most / (2 * MOST_DRIFT), np.inf):
        away = int(min(reach, (len(sequence) - n_frames) // 2))
        starts = [(len(sequence) - n_frames) // 2 + side * away for side in (-1, 1)]
        (first, before), (last, after) = (
            _measure_clocks(session, sequence, range(start, start + n_frames), most)
            for start in starts
        )
        passed = last - first
        if leader is None:
            leader = int(passed.argsort()[(len(passed) - 1) // 2])
        speeds = passed / passed[leader]
        sigmas = np.hypot(before, after)
        limit = scipy.special.ndtri(1 - FALSE_ALARMS / 2) / passed[leader]
        differs = np.abs(speeds - 1) > limit * np.hypot(sigmas, sigmas[leader])
        differs &= np.abs(speeds - 1) * len(sequence) > 0.5
        delays = dict.fromkeys(sequence.rig.names, (0.0, 1.0))
        delays |= split_delays(sequence.settings.sync)
        rates = sequence.timing.rates
        time = first[leader] - delays[sequence.rig.names[leader]][0] / rates[leader]
        for view in np.flatnonzero(differs):
            lag = float(first[view] - speeds[view] * time) * rates[view]
            delays[sequence.rig.names[view]] = lag, float(speeds[view])
        sequence = sequence.with_delays(delays)
        if away < reach:
            break
    return sequence


def _measure_clocks(
    session: Session, sequence: Sequence, frames: range, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return what each camera's clock shows at one time, in the middle of `frames` (V,), s, and the
    standard deviations (V,): infinite where the silhouettes do not tell."""
    views = small_views(sequence, session.device, frames=frames)
    times = Tangency(views.rig, views.outlines).measure_times(most)
    middle = frames[len(frames) // 2]
    clocks = np.array([clock[middle] for clock in sequence.timing.clocks])
    unsure = (np.array(times.whole) != 0) & (times.chances >= FALSE_ALARMS)
    sigmas = np.where(unsure, np.inf, times.sigmas)
    return clocks + times.offsets / sequence.fps, sigmas / sequence.fps
