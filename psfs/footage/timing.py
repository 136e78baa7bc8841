"""Pair the cameras' frames in time, where frame rates differ or cameras start late."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cl import InputError
from psfs.cameras.names import join_names
from psfs.footage.layouts.common import Footage

#: Frame rates that differ by less than this share are treated as equal.
_SAME_RATE = 0.01


@dataclass(frozen=True)
class Timing:
    """The frame rates and delays of the cameras.

    rates: (V,) frames per second of each camera. late: (V,) by how many of its own frames each
    camera is late. fps: of the sequence, the slowest rate.
    """

    rates: tuple[float, ...]
    late: tuple[int, ...]

    @property
    def fps(self) -> float:
        return min(self.rates)

    @property
    def plain(self) -> bool:
        """Whether frame k of the sequence is frame k of every camera."""
        return len(set(self.rates)) == 1 and not any(self.late)

    def count_own_frames(self, late: Sequence[float]) -> list[int]:
        """Return by how many whole frames of its own each camera is late; late: (V,) in frames of
        the sequence."""
        return [round(by * rate / self.fps) for by, rate in zip(late, self.rates, strict=True)]

    def frame_times(self, counts: Sequence[int]) -> list[np.ndarray]:
        """Return the times (F,) s of each camera's frames; counts: their numbers."""
        timed = zip(counts, self.late, self.rates, strict=True)
        return [(np.arange(count) - late) / rate for count, late, rate in timed]


def pair_frames(times: Sequence[np.ndarray]) -> tuple[list[tuple[int, ...]], float]:
    """Return the frames of each camera (V,) at every common time, and the greatest difference, s.

    times: (F,) s of each camera's frames, ascending. The camera with the longest usual interval
    leads; a time is left out if another camera has no frame within half that
    interval.
    """
    intervals = [float(np.median(np.diff(own))) if len(own) > 1 else 0.0 for own in times]
    slowest = max(intervals)
    leader, reach = times[intervals.index(slowest)], 0.5 * slowest
    nearest = np.column_stack([_find_nearest(own, leader) for own in times])  # (F, V)
    found = np.column_stack([own[index] for own, index in zip(times, nearest.T, strict=True)])
    away = abs(found - leader[:, None]).max(1)
    near = away <= reach + 1e-9  # times that are computed are rounded
    picks: list[tuple[int, ...]] = []
    apart = 0.0
    for indices, distance in zip(nearest[near], away[near], strict=True):
        if not (picks and (indices <= picks[-1]).any()):
            picks.append(tuple(indices.tolist()))
            apart = max(apart, float(distance))
    return picks, apart


def _find_nearest(times: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the indices (N,) of those of the ascending `times` (F,) that are nearest to `wanted`
    (N,): the earlier of two that are equally near."""
    after = np.searchsorted(times, wanted).clip(1, max(len(times) - 1, 1))
    before = after - 1
    after = after.clip(max=len(times) - 1)
    return np.where(times[after] - wanted < wanted - times[before], after, before)


def find_timing(
    footage: Footage, fps: float | None, sync: Mapping[str, int], default: float
) -> tuple[Timing, list[str]]:
    """Determine the frame rates and delays of the cameras; return them with remarks.

    fps: stated for all cameras; None: the videos' rates, or `default` where none is known. If rates
    differ, frames are paired by time, except if the cameras have equally many frames: then the
    files' rates are taken to be wrong. sync: see `Settings`. Raises InputError if `sync` names an
    unknown camera.
    """
    names = footage.rig.names
    unknown = [name for name in sync if name not in names]
    if unknown:
        raise InputError(f"sync names {join_names(unknown)}; the cameras are {join_names(names)}")
    late = tuple(sync.get(name, 0) for name in names)
    notes = []
    if any(late):
        shifts = [f"{name} {by:+d}" for name, by in zip(names, late, strict=True) if by]
        notes.append(f"cameras are shifted in time, in frames: {join_names(shifts)}")
    media = footage.images or footage.masks or ()
    known = [item.fps for item in media if item.fps]
    if fps is not None or not known:
        return Timing((fps or default,) * len(names), late), notes
    rates = [item.fps or known[0] for item in media]
    if max(rates) - min(rates) <= _SAME_RATE * max(rates):
        return Timing((rates[0],) * len(names), late), notes
    listed_rates = join_names(f"{name} {rate:g}" for name, rate in zip(names, rates, strict=True))
    counts = np.array([item.count for item in media])
    durations = counts / np.array(rates)
    if durations.max() / durations.min() > counts.max() / counts.min():
        notes.append(
            f"frame rates differ ({listed_rates}), but not the numbers of frames: frame k is taken "
            "for the same time in all; state `fps`"
        )
        return Timing((rates[0],) * len(names), late), notes
    notes.append(
        f"frame rates differ ({listed_rates}): frames are paired by time, {min(rates):g} per second"
    )
    return Timing(tuple(rates), late), notes


def synchronise(footage: Footage, timing: Timing) -> Footage:
    """Resample the footage so that frame k shows the same time in all cameras.

    Raises InputError if no time is in all of them.
    """
    if timing.plain:
        return footage
    media = [kind for kind in (footage.images, footage.masks) if kind]
    counts = [min(kind[view].count for kind in media) for view in range(len(footage.rig))]
    picks, _ = pair_frames(timing.frame_times(counts))
    if not picks:
        raise InputError(
            f"no time is in all cameras, which are late by {join_names(map(str, timing.late))} "
            f"frames and have {join_names(map(str, counts))}"
        )
    return footage.select(lambda _, view: [frame[view] for frame in picks])
