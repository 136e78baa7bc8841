"""Settings of the background's estimation from pictures of the empty scene or from the take."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, natural, nonnegative, part, positive, setting


class BackgroundModelConfig(Config):
    """Settings of the background's estimation from pictures of the empty scene, see
    `psfs.background.gaussian`."""

    SOURCE: ClassVar = "by hand"

    std_floor: float = positive(
        2.0,
        "Least standard deviation of the background's estimate: without it, N(I; mu, sigma) of"
        " a noiseless background would be unbounded.",
        unit="grey levels",
    )
    prior_std: float = positive(
        6.0, "Prior standard deviation of a pixel, before any frame is read.", unit="grey levels"
    )
    prior_frames: float = nonnegative(
        2.0,
        "Weight of `prior_std`; a background of a single picture thus has a standard deviation"
        " of 4.9 grey levels.",
        unit="frames",
    )
    clip: float = positive(
        3.0,
        "Distance from the mean beyond which a value is left out of it.",
        "the usual 3 sigma",
        "standard deviations",
    )
    samples: int = natural(
        25,
        "Number of frames from which the background is estimated if there is no film of the "
        "empty scene.",
        "by hand: enough for a median",
        "frames",
    )
    mixture_samples: int = natural(
        50,
        "Number of frames to which mixtures of Gaussians are fitted if there is no film of the"
        " empty scene.",
        unit="frames",
    )
    mixture_rate: float = fraction(
        0.0005,
        "Learning rate of an adaptive mixture, alpha of Rymut 2016 eq. (2.5). OpenCV counts a "
        "component as background once it is a tenth of the mixture, so a person may stand "
        "still for 210 frames.",
        "by hand; Rymut does not state his",
    )


class StillConfig(Config):
    """Settings of the search for people who stay in a place and thus appear in the median."""

    SOURCE: ClassVar = "by hand, on Pose2Sim's `Demo_MultiPerson`"

    room: float = fraction(
        0.3,
        "Share of the unknown background's density that has the colours of the picture around the "
        "moving region; the rest has those of the nearest pixels there.",
    )
    least_evidence: float = setting(
        -3.0,
        "Mean log ratio over 3 x 3 pixels, person over background, above which a pixel that hardly "
        "changes may belong to somebody who keeps still.",
        unit="nats",
    )
    proof: float = nonnegative(
        2.0,
        "Change of a pixel, as a multiple of the least change that is motion, above which its "
        "background was seen; below it, it may be a person who hardly moves.",
    )
    hidden_share: float = fraction(
        0.9,
        "Share of the frames in which a pixel is hidden above which, if it changes, those with the "
        "least evidence show its background.",
    )
    contrast: float = nonnegative(
        3.5, "Least change of such a pixel, as a multiple of the least change that is motion."
    )
    extremes: float = setting(
        0.08, "Share of the frames at either end of a pixel's evidence that is left out.",
        least=0, below=0.5,
    )  # fmt: skip
    least_range: float = nonnegative(
        1.5, "Least range of a pixel's evidence for that, without the extremes.", unit="nats"
    )
    explained: float = fraction(
        0.46,
        "Share of the silhouettes that the hull of all cameras explains, see `TakeConfig`, below "
        "which several people's places say what they hide.",
        "between `Demo_MultiPerson` (0.40) and hard_duo_6cam (0.53), which loses by it",
    )
    girth: float = positive(
        2.5,
        "Factor of the radii of a person who stands, beyond which nothing is hidden in the estimate"
        " that people are tracked by: hulls there are mostly nobody's, and an arm that moves does "
        "not stay in the median.",
    )
    covered_share: float = fraction(
        0.5,
        "Share of the frames in which the space of a person who stands covers a pixel, above which "
        "its background is not extrapolated.",
    )


class TakeConfig(Config):
    """Settings of the background's estimation from a take with people in it, see
    `psfs.background.take`."""

    SOURCE: ClassVar = (
        "by hand, on synth_box_4cam, synth_pickup_6cam, synth_walk_4cam without films of the empty "
        "scene"
    )

    longest_side: int = setting(
        320, "Longest side of the small pictures in which people are searched.", unit="px", least=32
    )
    moving: float = positive(
        18.0, "Least change of a pixel over the take that counts as motion.", unit="grey levels"
    )
    gap: int = natural(9, "Width of the gaps in the moving region that are closed.", unit="px")
    least_area: float = nonnegative(
        40.0, "Area below which a moving region counts as noise.", unit="px^2"
    )
    extrapolated_std: float = positive(
        10.0,
        "Standard deviation of a background that is extrapolated into the region where something "
        "moved.",
        unit="grey levels",
    )
    least_extrapolated_evidence: float = setting(
        -2.0,
        "Evidence for the person below which an extrapolated background replaces one that is never "
        "seen.",
        unit="nats",
    )
    least_std: float = positive(
        5.0, "Least standard deviation of an estimated background.", unit="grey levels"
    )
    median_blur: float = positive(
        1.5,
        "Standard deviation of the Gaussian that blurs the map of pixels whose median is "
        "background.",
        unit="px",
    )
    unexplained: float = fraction(
        0.05, "Share of a density of colours that is uniform: what no model explains."
    )
    unsure: float = fraction(
        0.1, "Share of an estimated background's density that the extrapolated one keeps."
    )
    colour_limit: float = positive(
        4.0,
        "Bound of the log ratio of a single pixel's colour, person over background.",
        unit="nats",
    )
    least_evidence: float = setting(
        -1.0,
        "Mean log ratio over 3 x 3 pixels, person over background, above which a pixel may belong "
        "to the person.",
        unit="nats",
    )
    voxels: int = setting(
        60_000, "Number of voxels of the coarse hull, at most.", unit="voxels", least=1000
    )
    explained: float = fraction(
        0.62,
        "Least share of the silhouettes (against the medians) that the hull of all cameras "
        "explains; below it, the medians are searched for a person.",
        "between people who walk about (0.78) and who stay in a place (0.39, 0.46)",
    )
    explained_stride: int = natural(4, "Stride of the samples for which this share is computed.")
    contradicting_cameras: int = nonnegative(
        1,
        "Number of cameras, out of more than three, that may contradict a voxel, because their"
        " background may contain a person.",
    )
    margin: int = nonnegative(1, "Distance by which the projected hull is dilated.", unit="px")
    shadow_width: float = positive(
        0.06, "Standard deviation of the light factor of background pixels around 1."
    )
    rounds: int = natural(
        3, "Greatest number of alternations between estimating the hull and the background."
    )
    converged_share: float = fraction(
        0.002, "Share of pixels that change label below which the alternation stops."
    )
    least_free: int = natural(
        3, "Least number of frames in which a background pixel must be visible.", unit="frames"
    )
    free_share: float = fraction(
        0.1, "Least share of the frames in which a background pixel must be visible."
    )
    still: StillConfig = part(StillConfig)
    hidden_prior: float = nonnegative(
        1.0,
        "Prior log-odds of a person at pixels whose background is never visible and not "
        "extrapolated.",
        unit="nats",
    )
