"""Settings of the comparison of cameras' sounds."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, setting


class SoundConfig(Config):
    """Delays of cameras by the sound of their videos."""

    SOURCE: ClassVar = "by hand"

    rate: int = setting(
        8000, "Samples per second that are compared.", unit="1/s", least=1000, most=192_000
    )
    longest: float = setting(600, "Length of sound that is compared.", unit="s", above=0)
    low: float = setting(
        200.0, "Lower end of the band that microphones of phones share.", unit="Hz", least=0
    )
    high: float = setting(3000.0, "Upper end of the same band.", unit="Hz", above=0)
    clear: float = setting(
        1.5,
        "Least height of the correlation's peak beside its largest value elsewhere.",
        least=1,
    )
    apart: float = setting(0.05, "Time away from the peak that is elsewhere.", unit="s", above=0)
