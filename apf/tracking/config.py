"""Settings of tracking: recovery, fusion of passes, parallel takes, smoothing, feet, gait."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pydantic import model_validator

from cl import InputError
from psfs.cameras.triangulation import TriangulationConfig
from psfs.common.config import Config, fraction, natural, nonnegative, part, positive, setting

if TYPE_CHECKING:
    from apf.body.model import BodyModel


class RecoveryConfig(Config):
    """Detection of a lost track, and the new search for the person.

    A track is lost if the misfit (see `apf.likelihood.base`) exceeds a limit.
    """

    SOURCE: ClassVar = "tuned on the shared walks with 4 and 8 cameras"

    on: bool = setting(True, "Whether a track can be lost at all.")
    ratio: float = setting(
        2.0, "Ratio of the limit to the median misfit of the last good frames.", above=1
    )
    window: int = natural(
        60, "Number of these good frames; 60 are a second at 60 frames/s.", unit="frames"
    )
    least: float = positive(
        0.4, "Least value of the limit; misfits of good frames differ by as much."
    )
    worst: float = positive(
        0.9, "Greatest value of the limit; at this misfit hardly anything of the body is visible."
    )
    unknown: float = positive(0.45, "Limit before there are good frames, from `least` to `worst`.")
    retry: int = natural(
        5,
        "Number of lost frames from one global search to the next, because each takes seconds.",
        unit="frames",
    )
    steepness: float = positive(
        4.0, "Power of misfit over limit by which the confidence falls; it is 1/2 at the limit."
    )
    n_steps: int = natural(
        2,
        "Number of consecutive searches in a lost frame, each starting from the result of the "
        "one before.",
    )
    wider: float = positive(4.0, "Factor of the noise in these searches.")
    longer: int = natural(
        2, "Factor of the number of layers in these searches; the SIR filter has none."
    )
    agreement: float = positive(
        0.15,
        "Mean distance of the joints up to which the search around the last pose confirms the "
        "tracker's estimate of a lost frame.",
        "by hand",
        "m",
    )
    everywhere_too: bool = setting(
        False,
        "Whether to search everywhere even if a pose near the last one fits; used for bodies "
        "without a head, because legs alone also fit arms and trunk.",
    )

    @model_validator(mode="after")
    def _ascend(self) -> RecoveryConfig:
        if not self.least <= self.unknown <= self.worst:
            raise InputError(
                f"recovery: limits {self.least:g}, {self.unknown:g}, {self.worst:g}; expected "
                "least <= unknown <= worst"
            )
        return self

    def for_body(self, body: BodyModel) -> RecoveryConfig:
        """Return the config for a track of `body`.

        A body that models only a part of the person never explains the rest of the person: until
        there is a good frame to compare with, only `worst` is a limit.
        """
        from apf.body.stature import has_head, is_whole

        if is_whole(body):
            return self
        return self.replace(unknown=self.worst, everywhere_too=not has_head(body))

    def for_uncertain_start(self) -> RecoveryConfig:
        """Return the config for a track from an automatic start that fits poorly.

        Silhouettes that lack parts of the person misfit the right pose, too: until there is a good
        frame to compare with, only `worst` is a limit.
        """
        return self.replace(unknown=self.worst)


class FloatingFeetConfig(Config):
    """Standing feet that float over the floor, see `apf.tracking.foot_contact.lower_feet`."""

    SOURCE: ClassVar = "chosen on hard_duo_6cam, synth_kick_8cam and synth_pickup_6cam"

    percentile: float = setting(
        20.0,
        "Percentile of the heights of standing ankles that counts, because heels rise at times.",
        least=0,
        most=100,
    )
    share: float = fraction(
        0.5,
        "Share of that height by which feet are lowered: as much would lower the heels of a "
        "person who stands on the toes.",
    )
    least: float = nonnegative(
        0.012,
        "Height up to which feet stay as they are.",
        "the deviation of an ankle's height, `StandingConfig.ankle`",
        "m",
    )
    most: float = nonnegative(
        0.1,
        "Height from which the person stands on something else; 0 leaves all feet as they are.",
        "as `StandingConfig.below`",
        "m",
    )
    air: float = positive(
        0.2,
        "Height over the standing feet at which a lifted foot is no longer lowered.",
        "by hand; 0.15 and 0.3 are as good",
        "m",
    )


class TwoWayConfig(Config):
    """Fusion of the forward and backward passes, see `apf.tracking.two_way`."""

    SOURCE: ClassVar = "by hand"

    near: float = positive(
        0.15,
        "Distance within which joints of two passes agree, so that they are averaged.",
        "tuned on synth_box_4cam and synth_salsa_4cam_hd: 0.1 is nearly as good",
        "m",
    )
    jump: float = positive(
        0.03,
        "Mean jump of the joints where the pass changes that costs as much as `misfit`.",
        unit="m",
    )
    misfit: float = positive(
        0.05,
        "Error of one frame, in the likelihood's unit, that costs as much as `jump`.",
        "three times as much or as little changes nothing",
    )
    steady: float = positive(
        0.15,
        "Length of the Savitzky-Golay window that smooths the poses, see `smooth_poses`.",
        "longer ones flatten fast motion",
        "s",
    )
    steady_within: float = positive(
        0.01, "Largest distance of a limb's joints from their smoothed positions.", unit="m"
    )
    overlap: int = natural(
        30,
        "Number of frames at a window's end that are tracked again in the next window, so that the "
        "backward pass has converged where poses become final; at most a third of the window.",
        unit="frames",
    )
    memory: float = positive(
        0.5,
        "Size of the observations in a window: about 500 frames of 4 cameras of 640 x 480 with"
        " clean silhouettes, 17 frames of 4 cameras of 1920 x 1080 with specks everywhere.",
        unit="GB",
    )
    longest: int = natural(1000, "Greatest number of frames of a window.", unit="frames")
    floor: FloatingFeetConfig = part(FloatingFeetConfig)

    def n_steady(self, fps: float) -> int:
        """Return the number of frames of a parabola, an odd number."""
        return round(self.steady * fps) | 1

    def full(self, n_frames: int, n_bytes: int) -> bool:
        """Return whether a window of so many frames and bytes is full."""
        return n_frames >= self.longest or (n_frames > 2 and n_bytes > 1e9 * self.memory)


class BatchConfig(Config):
    """Number of takes that are tracked at the same time. Measured with takes of 172 frames."""

    on_gpu: int = natural(
        4,
        "Number of takes at a time on a GPU.",
        "on an H200 with 16 cores four at once took 58 s, in consecutive processes about 150 "
        "s; six took as long per take as four, because their Python code runs in turns, above "
        "all that of the starts",
    )
    on_cpu: int = natural(
        2, "Number of takes at a time on CPUs.", "on 2 cores two at once took an eighth less time"
    )


class ContactConfig(Config):
    """Detection of standing feet by the ankle's speed and by its height above its lowest positions.
    The thresholds for start and stop differ (hysteresis), so that the result does not flicker."""

    SOURCE: ClassVar = "chosen on synth_walk_8cam and synth_walk_4cam"

    start_speed: float = positive(
        0.45,
        "Speed along the floor below which a foot may begin to stand.",
        "chosen with `stop_speed` on synth_walk_8cam and synth_walk_4cam, where true feet stand "
        "below 0.3 and swing at up to 4",
        "m/s",
    )
    stop_speed: float = positive(
        0.5,
        "Speed above which a foot no longer stands, because its heel is off the floor; above "
        "`start_speed`.",
        unit="m/s",
    )
    start_height: float = positive(
        0.04,
        "Height above the usual level of the lower foot's ankle below which a foot may begin "
        "to stand.",
        unit="m",
    )
    stop_height: float = positive(
        0.06,
        "Height above that level at which a foot no longer stands; above `start_height`.",
        unit="m",
    )
    window: float = nonnegative(0.1, "Time over which the speed is computed.", unit="s")
    shortest: float = nonnegative(
        0.1,
        "Least duration of a stance, and of a swing between two stances.",
        "a sixth of usual ones",
        "s",
    )
    longest_slide: float = positive(
        0.12,
        "Distance along the floor above which a foot slides and does not stand.",
        "tracks of synth_walk_4cam slide by up to 0.074 where the true foot stands",
        "m",
    )
    flat_height: float = positive(
        0.025,
        "Height above the lowest one of the stance below which the heel of a standing foot is "
        "on the floor, too.",
        "with it the ankles of synth_walk_8cam and synth_walk_4cam are right to 3 degrees",
        "m",
    )
    fade: float = positive(
        0.12, "Time over which the correction of a held foot fades in and out.", "by hand", "s"
    )

    @model_validator(mode="after")
    def _ascend(self) -> ContactConfig:
        for start, stop in (("start_speed", "stop_speed"), ("start_height", "stop_height")):
            if not getattr(self, stop) > getattr(self, start):
                raise InputError(
                    f"{stop} is {getattr(self, stop)}; expected more than {start}, "
                    f"{getattr(self, start)}"
                )
        return self


class SmoothingConfig(Config):
    """Smoothing of a track."""

    cutoff: float = positive(
        6.0,
        "Frequency of motion that keeps half of its amplitude (where the stated deviation is the "
        "usual one).",
        "the custom of gait analysis (Winter 2009)",
        "Hz",
        flag="--cutoff",
        flag_help="smoothing: motion this fast keeps half of its amplitude",
        metavar="HZ",
    )
    lag: int | None = setting(
        None,
        "Number of frames to look ahead; none for all that follow.",
        "the whole track is known",
        "frames",
        least=0,
        most=1_000_000,
        flag="--lag",
        flag_help="look so many frames ahead, as a program that runs live could",
        metavar="FRAMES",
    )
    min_deviation: float = positive(
        0.1,
        "Least deviation, as a share of the median of the stated deviations; smaller ones are "
        "replaced by it.",
        "by hand",
    )
    #: Detection of standing feet, which are then held; none turns this off. With a fixed lag feet
    #: are not held, because the end of a stance is not known yet.
    contact: ContactConfig | None = part(ContactConfig)


class GaitConfig(Config):
    """Definition of walking."""

    SOURCE: ClassVar = "by hand"

    speed: float = positive(
        0.3,
        "Least speed of the pelvis that counts as walking.",
        "old people's slow walk is about 0.6",
        "m/s",
    )
    swing: float = positive(
        0.15, "Least range of a foot's motion relative to the pelvis in every stride.", unit="m"
    )
    window: float = positive(
        0.5, "Time over which direction and speed of the pelvis are computed.", "about a step", "s"
    )


class TriangulatedConfig(Config):
    """Conversion of keypoints to a track without a body."""

    triangulation: TriangulationConfig = part(TriangulationConfig)
    longest_gap: float | None = nonnegative(
        None,
        "Longest gap that is filled; none to fill all.",
        "all are filled",
        "s",
        flag="--longest-gap",
        flag_help="triangulate: leave longer gaps open, blank in the files",
        metavar="S",
    )
    low_pass: float = nonnegative(
        0.0,
        "Frequency of a Butterworth filter; 0 for none. 6 Hz is usual for walking.",
        "off",
        "Hz",
        flag="--low-pass",
        flag_help="triangulate: Butterworth filter of the points, such as 6; 0 for none",
        metavar="HZ",
    )
