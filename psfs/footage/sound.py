"""Delays of cameras by the sound of their videos (`sync = "audio"`).

All microphones hear the same room. The generalised cross-correlation with phase transform (Knapp &
Carter, IEEE Trans. ASSP 24, 1976) of two tracks has a sharp peak at their lag; a clap helps. Sound
comes 3 ms later per metre, a tenth of a frame at 30 frames per second.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cl import InputError
from psfs.footage.config import SoundConfig
from psfs.footage.media import Media
from psfs.footage.settings import SequenceSettings


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


def measure_delays(
    media: Sequence[Media], rates: Sequence[float], config: SoundConfig | None = None
) -> dict[str, float]:
    """Return by how many of its own frames each camera comes late, by name.

    rates: (V,) frames per second. The first camera is the reference. Raises InputError for pictures
    that are no videos, videos without sound, and sounds that do not match.
    """
    config = config or SoundConfig()
    tracks = [read_sound(_video(item), config) for item in media]
    late = {media[0].name: 0.0}
    for item, track, rate in zip(media[1:], tracks[1:], rates[1:], strict=True):
        lag, clarity = find_lag(tracks[0], track, config)
        if clarity < config.clear:
            raise InputError(
                f"{item.where}: its sound fits that of {media[0].where} at no lag (clarity "
                f"{clarity:.2f}, expected {config.clear:g}); expected videos with sound of one "
                "room, best with a loud clap, or `sync` by camera"
            )
        late[item.name] = lag * rate
    return late


def read_sound(path: Path, config: SoundConfig) -> np.ndarray:
    """Return a video's sound (N,) float32, `config.rate` samples per second, from its first picture
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
            sound, first = _decode(container, config)
            video = container.streams.video[0]
            begin = float((video.start_time or 0) * (video.time_base or 0))
    except (av.FFmpegError, OSError) as error:
        raise InputError(f"{path}: its sound cannot be read ({error})") from None
    if not len(sound) or not np.any(sound):
        raise InputError(f"{path}: its sound is silent; expected it for sync = audio")
    missing = round((first - begin) * config.rate)
    sound = sound - sound.mean()
    if missing <= 0:
        return sound[-missing:]
    return np.concatenate([np.zeros(missing, np.float32), sound])


def _decode(container: object, config: SoundConfig) -> tuple[np.ndarray, float]:
    """Return the samples (N,) of a container's first sound track and their first time, s."""
    import av

    resampler = av.AudioResampler(format="flt", layout="mono", rate=config.rate)
    parts: list[np.ndarray] = []
    first, count = 0.0, 0
    for frame in container.decode(audio=0):  # type: ignore[attr-defined]
        if not count:
            first = float(frame.time or 0.0)
        for piece in resampler.resample(frame):
            parts.append(piece.to_ndarray().ravel())
            count += len(parts[-1])
        if count > config.rate * config.longest:
            break
    return np.concatenate([*parts, np.zeros(0, np.float32)]), first


def _video(item: Media) -> Path:
    if not item.is_video:
        raise InputError(f"{item.where}: pictures have no sound; expected videos for sync = audio")
    return item.paths[0]


def find_lag(a: np.ndarray, b: np.ndarray, config: SoundConfig) -> tuple[float, float]:
    """Return by how many seconds sound comes later in track `b` (M,) than in `a` (N,), and how
    clear that is: the height of the correlation's peak as a multiple of its largest value
    elsewhere."""
    size = 1 << (len(a) + len(b) - 1).bit_length()
    cross = np.conj(np.fft.rfft(a, size)) * np.fft.rfft(b, size)
    frequencies = np.fft.rfftfreq(size, 1 / config.rate)
    within = (frequencies > config.low) & (frequencies < config.high)
    phase = np.where(within, cross / np.maximum(np.abs(cross), 1e-12), 0)
    found = np.abs(np.fft.irfft(phase, size))
    lags = np.arange(size)
    lags[lags > len(b)] -= size
    best = int(found.argmax())
    far = np.abs(lags - lags[best]) > config.apart * config.rate
    return float(lags[best] / config.rate), float(found[best] / max(found[far].max(), 1e-12))
