"""Offsets of cameras by the sound of their videos (`sync = "audio"`).

All microphones hear the same room. The generalised cross-correlation with phase transform (Knapp &
Carter, IEEE Trans. ASSP 24, 1976) of two tracks has a sharp peak at their lag; a clap helps. Sound
comes 3 ms later per metre, a tenth of a frame at 30 frames per second.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from cl import InputError
from psfs.footage.camera_times import MOST_DRIFT, MeasuredOffset, combine_offsets
from psfs.footage.media import Media
from psfs.footage.settings import SequenceSettings
from psfs.footage.timing import describe_delays

#: Samples per second that are compared, and the band that microphones of phones share, Hz.
RATE, _BAND = 8000, (200, 3000)
#: Most sound that is compared, s.
_LONGEST = 600
#: Least height of the correlation's peak beside its largest value elsewhere, by more than the
#: width of a peak, s.
_CLEAR, _WIDTH = 1.5, 0.05
#: Hops of a track in which onsets are counted; s of a window; s to which the drift over a track is
#: measured.
_HOPS, _WINDOW, _FINE = 12_000, 10, 1e-3
#: Standard deviation of an offset, s: sound takes this long for 2 m.
_TRAVEL = 0.006


def apply_sound(
    settings: SequenceSettings, media: Sequence[Media] | None
) -> tuple[SequenceSettings, list[str]]:
    """Return the settings with the delays, in whole frames, and the speeds of the clocks in place
    of `sync = "audio"`, and a remark with the fractions; other settings unchanged.

    media: of the cameras. Raises InputError as `measure_delays` does.
    """
    if settings.sync != "audio":
        return settings, []
    if not media:
        raise InputError("sync = audio: masks have no sound; expected videos")
    known = next((item.fps for item in media if item.fps), 30.0)
    rates = [settings.fps or item.fps or known for item in media]
    delays = measure_delays(media, rates)
    shown = describe_delays(delays)
    note = f"late by the sound, in frames: {shown}; videos are shifted by whole frames"
    sync = {
        name: [round(by), speed] if speed != 1 else round(by)
        for name, (by, speed) in delays.items()
    }
    return settings.replace(sync=sync), [note]


def measure_delays(
    media: Sequence[Media], rates: Sequence[float]
) -> dict[str, tuple[float, float]]:
    """Return by how many of its own frames each camera comes later than the first, and how many
    seconds its clock counts in one of the first's, by name.

    rates: (V,) frames per second. All pairs of cameras are compared. A clock whose difference would
    shift no frame by half a frame counts as equal. Raises InputError for pictures that are no
    videos, videos without sound, and sounds that do not match any other.
    """
    tracks = [read_sound(_video(item)) for item in media]
    pairs, clearest = dict[tuple[int, int], tuple[float, float]](), [0.0] * len(media)
    for a, b in combinations(range(len(media)), 2):
        lag, speed, clarity = find_clock(tracks[a], tracks[b])
        for view in (a, b):
            clearest[view] = max(clearest[view], clarity)
        if clarity >= _CLEAR:
            pairs[a, b] = lag, speed
    for item, clarity in reversed(list(zip(media, clearest, strict=True))):
        if len(media) > 1 and clarity < _CLEAR:
            raise InputError(
                f"{item.where}: its sound fits that of the others at no offset (clarity "
                f"{clarity:.2f}, expected {_CLEAR:g}); expected videos with sound of one room, "
                "best with a loud clap, or `sync` by camera"
            )
    logs = [MeasuredOffset(a, b, np.log(speed), _TRAVEL) for (a, b), (_, speed) in pairs.items()]
    drifts, _ = combine_offsets(len(media), logs)
    speeds = np.exp(drifts - drifts[0])
    counts = np.array([item.count for item in media])
    speeds[np.abs(speeds - 1) * counts < 0.5] = 1
    lags = [MeasuredOffset(a, b, lag / speeds[b], _TRAVEL) for (a, b), (lag, _) in pairs.items()]
    seconds, _ = combine_offsets(len(media), lags)
    late = (seconds - seconds[0]) * speeds * np.asarray(rates)
    delays = zip(late.tolist(), speeds.tolist(), strict=True)
    return {item.name: delay for item, delay in zip(media, delays, strict=True)}


def read_sound(path: Path) -> np.ndarray:
    """Return a video's sound (N,) float32, `RATE` samples per second, from its first picture
    on.

    Raises InputError if there is no sound.
    """
    import av  # slow to import

    try:
        with av.open(str(path)) as container:
            if not container.streams.audio:
                raise InputError(
                    f"{path}: no sound; expected it for sync = audio, or delays by camera, or auto "
                    "once calibrated: docs/from_phones.md"
                )
            sound, first = _decode(container)
            video = container.streams.video[0]
            begin = float((video.start_time or 0) * (video.time_base or 0))
    except (av.FFmpegError, OSError) as error:
        raise InputError(f"{path}: its sound cannot be read ({error})") from None
    if not len(sound) or not np.any(sound):
        raise InputError(f"{path}: its sound is silent; expected it for sync = audio")
    missing = round((first - begin) * RATE)
    sound = sound - sound.mean()
    if missing <= 0:
        return sound[-missing:]
    return np.concatenate([np.zeros(missing, np.float32), sound])


def _decode(container: object) -> tuple[np.ndarray, float]:
    """Return the samples (N,) of a container's first sound track and their first time, s."""
    import av

    resampler = av.AudioResampler(format="flt", layout="mono", rate=RATE)
    parts: list[np.ndarray] = []
    first, count = 0.0, 0
    for frame in container.decode(audio=0):  # type: ignore[attr-defined]
        if not count:
            first = float(frame.time or 0.0)
        for piece in resampler.resample(frame):
            parts.append(piece.to_ndarray().ravel())
            count += len(parts[-1])
        if count > RATE * _LONGEST:
            break
    return np.concatenate([*parts, np.zeros(0, np.float32)]), first


def _video(item: Media) -> Path:
    if not item.is_video:
        raise InputError(f"{item.where}: pictures have no sound; expected videos for sync = audio")
    return item.paths[0]


def find_clock(a: np.ndarray, b: np.ndarray) -> tuple[float, float, float]:
    """Compare the tracks a (N,) and b (M,) of two clocks.

    Returns by how many seconds sound comes later in b at the start of a, how many seconds the clock
    of b counts in one of a's, and how clear that is, see `find_lag`. The speed is measured between
    the ends of the tracks; where that is not clear, it is first sought by the onsets of sounds.
    """
    lag, clarity = find_lag(a, b)
    best, drift = (lag, 1.0, clarity), _measure_drift(a, b, lag)
    if drift is not None and abs(drift) * len(a) <= _FINE * RATE:
        return best
    for measured in (1 + (drift or 0), None):
        speed = measured or _search_speed(a, b)
        step = speed - 1
        while abs(step) * len(a) > _FINE * RATE:
            resampled = np.interp(np.arange(0, len(b), speed), np.arange(len(b)), b)
            lag, clarity = find_lag(a, resampled)
            if clarity <= best[2]:
                break
            best, step = (speed * lag, speed, clarity), _measure_drift(a, resampled, lag) or 0.0
            speed += step
        if best[1] != 1:
            break
    return best


def _search_speed(a: np.ndarray, b: np.ndarray) -> float:
    """Return the speed of b's clock at which the onsets in both tracks agree best, to a hop over
    the length of a."""
    hop = max(1, len(a) // _HOPS)
    onsets = []
    for track in (a, b):
        energy = (track[: len(track) // hop * hop].reshape(-1, hop) ** 2).mean(axis=1)
        rises = np.diff(np.log(energy + 1e-3 * energy.mean() + 1e-20)).clip(min=0)
        onsets.append(rises - rises.mean())
    first, second = onsets
    size = 1 << (len(first) + len(second)).bit_length()
    spectrum = np.conj(np.fft.rfft(first, size))
    places, step = np.arange(len(second)), 1 / max(len(first), 1)
    speeds = 1 + step * np.arange(-round(MOST_DRIFT / step), round(MOST_DRIFT / step) + 1)
    peaks = []
    for speed in speeds:
        stretched = np.interp(np.arange(0, len(second), speed), places, second)
        peaks.append(np.fft.irfft(spectrum * np.fft.rfft(stretched, size), size).max())
    return float(speeds[int(np.argmax(peaks))])


def _measure_drift(a: np.ndarray, b: np.ndarray, lag: float) -> float | None:
    """Return by how many seconds a second of a lasts longer in b, whose sound comes `lag` s later:
    by the lags of two windows near the beginning and the end of a; None if these are not clear."""
    shift, margin = round(lag * RATE), round(2 * _WIDTH * RATE)
    begin, end = max(0, margin - shift), min(len(a), len(b) - shift - margin)
    window = min((end - begin) // 3, _WINDOW * RATE)
    if window < margin:
        return 0.0
    lags = []
    for start in (begin, end - window):
        heard = b[start + shift - margin : start + shift + window + margin]
        within, clarity = find_lag(a[start : start + window], heard)
        if clarity < _CLEAR:
            return None
        lags.append(within)
    return (lags[1] - lags[0]) * RATE / (end - window - begin)


def find_lag(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Return by how many seconds sound comes later in track `b` (M,) than in `a` (N,), and how
    clear that is: the height of the correlation's peak as a multiple of its largest value
    elsewhere."""
    size = 1 << (len(a) + len(b) - 1).bit_length()
    cross = np.conj(np.fft.rfft(a, size)) * np.fft.rfft(b, size)
    frequencies = np.fft.rfftfreq(size, 1 / RATE)
    within = (frequencies > _BAND[0]) & (frequencies < _BAND[1])
    phase = np.where(within, cross / np.maximum(np.abs(cross), 1e-12), 0)
    found = np.abs(np.fft.irfft(phase, size))
    lags = np.arange(size)
    lags[lags > len(b)] -= size
    best = int(found.argmax())
    far = np.abs(lags - lags[best]) > _WIDTH * RATE
    return float(lags[best] / RATE), float(found[best] / max(found[far].max(), 1e-12))
