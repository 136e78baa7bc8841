"""Pair the cameras' frames by their times: those in the videos, or in `timestamps.csv`.

A recorder that drops frames writes `timestamps.csv`: a row per frame of a camera, with `cam_id` (or
`camera`), `frame_index` (or `frame`), `frame_time` (or `time`), s, as Caliscope and FreeMoCap do.
The k-th frame of a camera's rows, ordered by number, is the k-th of its video.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from cl import InputError
from psfs.cameras.names import join_names, name_tokens
from psfs.common.files import MOST_BYTES, read_text
from psfs.common.reading import parsing
from psfs.footage.camera_times import MOST_DRIFT
from psfs.footage.layouts.common import Footage
from psfs.footage.media import Media

#: By how many of its frames a camera is late, and the seconds that its clock counts in a second.
Delay: TypeAlias = tuple[float, float]
TIMESTAMPS = "timestamps.csv"
_WHAT = "times of frames"
#: Least ratio of times in another unit than s: ms or ns, with which other programs count.
_OTHER_UNIT = 100
#: Names of the columns, the first that is there.
_COLUMNS = (("cam_id", "camera"), ("frame_index", "frame"), ("frame_time", "time"))


@dataclass(frozen=True)
class Timing:
    """The cameras' frame rates and clocks.

    rates: (V,) frames per second of each camera. clocks: (V, F) the time of each frame by the
    camera's own clock, s. fps: of the sequence, the slowest rate.
    """

    rates: tuple[float, ...]
    clocks: tuple[np.ndarray, ...] = ()

    @property
    def fps(self) -> float:
        return min(self.rates)

    def count_own_frames(self, late: Sequence[float]) -> list[int]:
        """Return by how many whole frames of its own each camera is late; late: (V,) in frames of
        the sequence."""
        return [round(by * rate / self.fps) for by, rate in zip(late, self.rates, strict=True)]


def synchronise(
    footage: Footage, fps: float | None, sync: Mapping[str, Delay], default: float
) -> tuple[Footage, Timing, list[str]]:
    """Select frames so that frame k shows the same time in all cameras; return the footage, its
    timing, and remarks.

    fps: stated for all cameras; None: by the times of the videos' frames, or `default` where none
    are known. sync: delays by camera. Raises InputError if it names an unknown camera,
    `timestamps.csv` does not fit, or no time is in all cameras.
    """
    names = footage.rig.names
    unknown = [name for name in sync if name not in names]
    if unknown:
        raise InputError(f"sync names {join_names(unknown)}; the cameras are {join_names(names)}")
    kinds = [kind for kind in (footage.images, footage.masks) if kind]
    rates, clocks, notes = _read_clocks(kinds[0], fps, default)
    stamps = read_timestamps(footage)
    delays = {name: by for name, by in sync.items() if by != (0, 1)}
    clocks, times = list(stamps or clocks), []
    for view, name in enumerate(names):
        clocks[view] = clocks[view][: min(kind[view].count for kind in kinds)]
        late, speed = delays.get(name, (0, 1))
        times.append((clocks[view] - late / rates[view]) / speed)
    timing = Timing(tuple(rates), tuple(clocks))
    if delays:
        notes.append(f"cameras are shifted in time, in frames: {describe_delays(delays)}")
    common = min(map(len, times))
    furthest = max(abs(clock[:common] - times[0][:common]).max(initial=0) for clock in times)
    if stamps is None and furthest <= max(map(_usual_interval, times)) / 2:
        return footage, timing, notes
    picks, apart = pair_frames(times)
    if not picks:
        raise InputError(
            f"no time is in all cameras, of {join_names(str(len(clock)) for clock in times)} "
            f"frames, late by {describe_delays(delays) or 0}; expected recordings that overlap"
        )
    if stamps is not None or not delays:
        source = "the times in the videos" if stamps is None else TIMESTAMPS
        notes.append(
            f"frames are paired by {source}: {len(picks)} of up to {max(map(len, times))}, "
            f"{timing.fps:g} per second, at most {1000 * apart:.0f} ms apart"
            f"{_list_gaps(names, times)}"
        )
    rows = np.array(picks).T
    timing = replace(timing, clocks=tuple(c[row] for c, row in zip(clocks, rows, strict=True)))
    return footage.select(lambda _, view: [frame[view] for frame in picks]), timing, notes


def describe_delays(delays: Mapping[str, Delay]) -> str:
    """Return by how many frames cameras are late, and how differently their clocks run."""
    return ", ".join(
        f"{name} {late:+.4g}" + (f" (its clock runs {speed - 1:+.2%})" if speed != 1 else "")
        for name, (late, speed) in delays.items()
    )


def _read_clocks(
    media: Sequence[Media], fps: float | None, default: float
) -> tuple[list[float], list[np.ndarray], list[str]]:
    """Return the frame rate of each camera, the times (F,) s of its frames, and remarks.

    Rates that differ, where the numbers of frames do not, are taken to be wrong.
    """
    known = next((item.fps for item in media if item.fps), default)
    rates = [fps or item.fps or known for item in media]
    counts = np.array([item.count for item in media])
    stamped = [item.times for item in media if item.times is not None and fps is None]
    if max(rates) > min(rates):
        durations = counts / rates
        as_many = np.ptp(counts) == 0 or max(rates) - min(rates) > MOST_DRIFT * max(rates)
        if as_many and durations.max() * counts.min() > counts.max() * durations.min():
            listed = [f"{item.name} {rate:g}" for item, rate in zip(media, rates, strict=True)]
            note = (
                f"frame rates differ ({join_names(listed)}), but not the numbers of frames: frame "
                "k is taken for the same time in all; state `fps`"
            )
            rates, stamped = rates[:1] * len(rates), []
            return rates, [np.arange(n) / rates[0] for n in counts], [note]
    if len(stamped) == len(media):
        return rates, stamped, []
    return rates, [np.arange(n) / rate for n, rate in zip(counts, rates, strict=True)], []


def _list_gaps(names: Sequence[str], times: Sequence[np.ndarray]) -> str:
    """Return the cameras that lack frames, and where their longest gap is."""
    listed = []
    for name, clock in zip(names, times, strict=True):
        intervals = np.diff(clock)
        lost = np.round(intervals / _usual_interval(clock)).astype(int) - 1
        if (lost > 0).any():
            at = int(lost.argmax())
            listed.append(
                f"{name} lacks {lost.sum()} frames, {lost[at]} of them after its frame {at}"
            )
    return "".join(f"; {text}" for text in listed)


def pair_frames(times: Sequence[np.ndarray]) -> tuple[list[tuple[int, ...]], float]:
    """Return the frames of each camera (V,) at every common time, and the greatest difference, s.

    times: (F,) s of each camera's frames, ascending. The camera with the longest usual interval
    leads; a time is left out if another camera has no frame within half that
    interval.
    """
    intervals = [_usual_interval(clock) for clock in times]
    slowest = max(intervals)
    leader, reach = times[intervals.index(slowest)], 0.5 * slowest
    nearest = np.column_stack([_find_nearest(clock, leader) for clock in times])  # (F, V)
    found = np.column_stack([clock[index] for clock, index in zip(times, nearest.T, strict=True)])
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


def _usual_interval(times: np.ndarray) -> float:
    return float(np.median(np.diff(times))) if len(times) > 1 else 0.0


def read_timestamps(footage: Footage) -> list[np.ndarray] | None:
    """Return the times (F,) s of the frames of each camera's video, None without the file.

    It lies beside the videos. Raises InputError for a file that does not fit the videos.
    """
    media = footage.images
    if not media or not all(item.is_video for item in media):
        return None
    path = media[0].paths[0].parent / TIMESTAMPS
    if not path.is_file():
        return None
    _assign_times(path, footage.masks or ())  # raises for masks of other frames than the videos'
    return _assign_times(path, media)


def _assign_times(path: Path, media: Sequence[Media]) -> list[np.ndarray]:
    """Return the times (F,) s of the frames of each camera's video."""
    by_camera = _read_times(path)
    found = []
    for item in media:
        tokens = name_tokens(item.name)
        named = [c for c in by_camera if name_tokens(c) in (tokens, tokens[-1:])]
        if len(named) != 1:
            raise InputError(
                f"{path}: {len(named)} cameras match {item.name}; found {join_names(by_camera)}"
            )
        rows = sorted(by_camera[named[0]])
        times = np.array([time for _, time in rows])
        if len(times) != item.count or (np.diff(times) <= 0).any():
            raise InputError(
                f"{path}: {len(times)} times of {item.name}, whose video has {item.count} frames; "
                "expected one for each frame, ascending"
            )
        interval, rate = _usual_interval(times), item.fps
        if interval and rate and not 1 / _OTHER_UNIT < interval * rate < _OTHER_UNIT:
            raise InputError(
                f"{path}: {interval:.3g} between the frames of {item.name}, whose video has "
                f"{rate:g} per second; expected times in s"
            )
        found.append(times)
    return found


def _read_times(path: Path) -> dict[str, list[tuple[int, float]]]:
    """Return frame numbers and times, s, by camera."""
    text = read_text(path, _WHAT, MOST_BYTES)
    with parsing(path, _WHAT):
        reader = csv.DictReader(io.StringIO(text, newline=""))
        heads, rows = reader.fieldnames or (), list(reader)
    names = [next((name for name in options if name in heads), None) for options in _COLUMNS]
    if None in names:
        wanted = ", ".join(" or ".join(options) for options in _COLUMNS)
        raise InputError(f"{path}: columns {join_names(heads)}; expected {wanted}")
    camera, frame, time = names
    found: dict[str, list[tuple[int, float]]] = {}
    for line, row in enumerate(rows, 2):
        try:
            value = int(row[frame]), float(row[time])
        except (TypeError, ValueError):
            raise InputError(f"{path}: line {line}; expected a frame's number and time") from None
        if not np.isfinite(value[1]):
            raise InputError(f"{path}: line {line}: time {value[1]}; expected seconds")
        found.setdefault(str(row[camera]), []).append(value)
    return found
