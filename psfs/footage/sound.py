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
from psfs.footage.camera_times import MeasuredOffset, combine_offsets
from psfs.footage.media import Media
from psfs.footage.settings import SequenceSettings

#: Samples per second that are compared, and the band that microphones of phones share, Hz.
RATE, _BAND = 8000, (200, 3000)
#: Most sound that is compared, s.
_LONGEST = 600
#: Least height of the correlation's peak beside its largest value elsewhere, by more than the
#: width of a peak, s.
_CLEAR, _WIDTH = 1.5, 0.05
#: Standard deviation of an offset, s: sound takes this long for 2 m.
_TRAVEL = 0.006


def apply_sound(
    settings: SequenceSettings, media: Sequence[Media] | None
) -> tuple[SequenceSettings, list[str]]:
    """Return the settings with the delays, in whole frames, in place of `sync = "audio"`, and a
    remark with the fractions; other settings unchanged.

    media: of the cameras. Raises InputError as `measure_delays` does.
    """
    if settings.sync != "audio":
        return settings, []
    if not media:
        raise InputError("sync = audio: masks have no sound; expected videos")
    known = next((item.fps for item in media if item.fps), 30.0)
    rates = [settings.fps or item.fps or known for item in media]
    late = measure_delays(media, rates)
    shown = ", ".join(f"{name} {by:+.2f}" for name, by in late.items())
    note = f"late by the sound, in frames: {shown}; videos are shifted by whole frames"
    return settings.replace(sync={name: round(by) for name, by in late.items()}), [note]


def measure_delays(media: Sequence[Media], rates: Sequence[float]) -> dict[str, float]:
    """Return by how many of its own frames each camera comes later than the first, by name.

    rates: (V,) frames per second. All pairs of cameras are compared. Raises InputError for pictures
    that are no videos, videos without sound, and sounds that do not match any other.
    """
    tracks = [read_sound(_video(item)) for item in media]
    measured, clearest = [], [0.0] * len(media)
    for a, b in combinations(range(len(media)), 2):
        offset, clarity = find_lag(tracks[a], tracks[b])
        for view in (a, b):
            clearest[view] = max(clearest[view], clarity)
        if clarity >= _CLEAR:
            measured.append(MeasuredOffset(a, b, offset, _TRAVEL))
    for item, clarity in reversed(list(zip(media, clearest, strict=True))):
        if len(media) > 1 and clarity < _CLEAR:
            raise InputError(
                f"{item.where}: its sound fits that of the others at no offset (clarity "
                f"{clarity:.2f}, expected {_CLEAR:g}); expected videos with sound of one room, "
                "best with a loud clap, or `sync` by camera"
            )
    seconds, _ = combine_offsets(len(media), measured)
    late = (seconds - seconds[0]) * np.asarray(rates)
    return {item.name: float(by) for item, by in zip(media, late, strict=True)}


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
