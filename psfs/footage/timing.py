"""Which frames of the cameras are of one time: where rates differ, or some cameras come late."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cl import InputError
from psfs.cameras.names import listed
from psfs.footage.layouts.common import Footage
from psfs.footage.media import Media

#: Frame rates that differ by less than this share are the same.
_SAME_RATE = 0.01


@dataclass(frozen=True)
class Timing:
    """How cameras go together in time.

    rates: (V,) frames per second of each camera. late: (V,) by how many of its own frames each
    comes later than the others. fps: of the sequence, the slowest rate.
    """

    rates: tuple[float, ...]
    late: tuple[int, ...]

    @property
    def fps(self) -> float:
        return min(self.rates)

    @property
    def plain(self) -> bool:
        """Is frame k of the sequence frame k of every camera?"""
        return len(set(self.rates)) == 1 and not any(self.late)

    def picks(self, counts: Sequence[int]) -> list[list[int]]:
        """Return which frames, of so many, each camera shows in all frames of the sequence: the
        nearest in time. The sequence begins with the first time that all of them have."""
        per_frame = np.array(self.rates) / self.fps
        late = np.array(self.late)
        first = math.ceil(max(0.0, float((-late / per_frame).max())))
        picked: list[list[int]] = [[] for _ in counts]
        for frame in range(first, first + max(counts)):
            indices = np.floor(frame * per_frame + 0.5).astype(int) + late
            if (indices >= np.array(counts)).any():
                break
            for frames, index in zip(picked, indices, strict=True):
                frames.append(int(index))
        return picked


def timing_of(
    footage: Footage, fps: float | None, sync: Mapping[str, int], default: float
) -> tuple[Timing, list[str]]:
    """Return how the cameras of `footage` go together, and remarks on it.

    fps: stated of all, which then run alike; else the videos' rates count, and `default` where
    none is known. Rates that differ pair frames by time, unless the cameras have as many frames
    each: then the files' rates are taken for wrong. sync: see `Settings`. Raises InputError if that
    names a camera that is not there.
    """
    names = footage.rig.names
    unknown = [name for name in sync if name not in names]
    if unknown:
        raise InputError(f"sync names {listed(unknown)}; the cameras are {listed(names)}")
    late = tuple(sync.get(name, 0) for name in names)
    notes = []
    if any(late):
        shifts = [f"{name} {by:+d}" for name, by in zip(names, late, strict=True) if by]
        notes.append(f"cameras are shifted in time, in frames: {listed(shifts)}")
    media = footage.images or footage.masks or ()
    known = [item.fps for item in media if item.fps]
    if fps is not None or not known:
        return Timing((fps or default,) * len(names), late), notes
    rates = [item.fps or known[0] for item in media]
    if max(rates) - min(rates) <= _SAME_RATE * max(rates):
        return Timing((rates[0],) * len(names), late), notes
    listed_rates = listed(f"{name} {rate:g}" for name, rate in zip(names, rates, strict=True))
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


def timed(footage: Footage, timing: Timing) -> Footage:
    """Return the footage whose frame k is of one time in all cameras. Raises InputError if there is
    none such."""
    if timing.plain:
        return footage
    media = [kind for kind in (footage.images, footage.masks) if kind]
    counts = [min(kind[view].count for kind in media) for view in range(len(footage.rig))]
    picks = timing.picks(counts)
    if not picks[0]:
        raise InputError(
            f"no time is in all cameras, which are shifted by {listed(map(str, timing.late))} "
            f"frames and have {listed(map(str, counts))}"
        )

    def chosen(kind: tuple[Media, ...] | None) -> tuple[Media, ...] | None:
        return kind and tuple(item.picked(of) for item, of in zip(kind, picks, strict=True))

    return replace(footage, images=chosen(footage.images), masks=chosen(footage.masks))
