"""Settings of the comparison of cameras' sounds."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, nonnegative, positive, setting


class SoundConfig(Config):
    """Delays of cameras by the sound of their videos."""

    SOURCE: ClassVar = "by hand"

    rate: int = setting(
        8000, "Samples per second that are compared.", unit="1/s", least=1000, most=192_000
    )
    longest: float = positive(600, "Length of sound that is compared.", unit="s")
    low: float = nonnegative(
        200.0, "Lower end of the band that microphones of phones share.", unit="Hz"
    )
    high: float = positive(3000.0, "Upper end of the same band.", unit="Hz")
    clear: float = setting(
        1.5, "Least height of the correlation's peak beside its largest value elsewhere.", least=1
    )
    apart: float = positive(0.05, "Time away from the peak that is elsewhere.", unit="s")
