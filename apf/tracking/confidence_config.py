"""Settings of the confidence of limbs, and of corrections by hand."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from psfs.common.config import Config, fraction, nonnegative, positive, setting

if TYPE_CHECKING:
    import numpy as np


class ConfidenceConfig(Config):
    """Coefficients of the log-odds that a limb is right.

    Fitted by logistic regression to limbs with errors above 200 mm and below 150 mm, equally many
    of each, of tracks of box, jacks, kick and run in the shared suite. The constants are such that
    4 % of the correct limbs count as lost; 3 % if several passes are compared.

    One pass, seven runs: 86 % of the wrong limbs count as lost; on pickup, salsa and walks 85 %,
    with 4 % of the correct ones. Two runs with two passes each, 25 tracks of box, jacks, run,
    pickup and salsa, all of which served to choose `apart`: 22 of 24 wrong limbs, with 3 % of the
    correct ones. Margin and jitter do not improve that, and make correct limbs in real footage
    count as lost.
    """

    SOURCE: ClassVar = "logistic regression on tracks of box, jacks, kick and run"

    constant: float = setting(
        -12.9, "Log-odds, for one pass, of a limb with zero margin and zero jitter."
    )
    margin: float = setting(36.1, "Coefficient of the square root of the margin.")
    jitter: float = setting(-0.033, "Coefficient of the jitter.", unit="s")
    most_margin: float = positive(
        0.3, "Upper limit of the margin; larger margins carry no more information."
    )
    at_rest: float = positive(
        0.5,
        "Offset added to the speed, so that an end at rest has little jitter.",
        "by hand",
        "m/s",
    )
    apart: float = positive(
        0.045,
        "Distance between the end in the track and in the passes at which a limb is as likely "
        "wrong as right.",
        unit="m",
    )
    disagreement: float = setting(
        -10.9, "Change of the log-odds if the distance grows by a factor of e."
    )
    least: float = positive(
        0.02, "Lower limit of the distance; smaller ones carry no more information.", "by hand", "m"
    )
    window: float = positive(
        0.4, "Time over which all inputs are averaged; distances by their logarithms.", unit="s"
    )
    least_time: float = nonnegative(
        0.5,
        "Time that a track must last for its limbs to be judged: the passes over a shorter one all "
        "begin at nearly the same pose, and agree on it even if it is wrong.",
        "by hand",
        "s",
    )
    elsewhere: float = positive(
        0.15,
        "Distance from the limb's end beyond which another candidate counts as a different place.",
        "by hand",
        "m",
    )
    lost: float = fraction(0.5, "Confidence below which a limb counts as lost.", "even odds")

    def lasts(self, times: np.ndarray) -> bool:
        """Return whether frames at `times` (F,) s last for `least_time`."""
        import numpy as np

        if len(times) < 2:
            return False
        step = float(np.median(np.diff(times)))
        return bool(times[-1] - times[0] + step >= self.least_time - 1e-9)


class CorrectionConfig(Config):
    """Corrections of a track by hand."""

    reach: float = setting(
        0.4,
        "Time before and after a corrected frame that is tracked again.",
        "by hand",
        "s",
        least=0,
        most=60,
    )
    error: float = setting(
        0.02,
        "Error of a joint that is put somewhere by hand.",
        "that of one joint centre between two people who mark it",
        "m",
        least=0.001,
        most=1,
    )
    fade: int = nonnegative(
        3,
        "Frames at each end of what is tracked again over which it passes into the track as it "
        "was.",
        "by hand",
        "frames",
    )
