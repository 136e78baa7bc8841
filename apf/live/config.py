"""Settings of live tracking, by part."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from apf.tracking.config import RecoveryConfig
from psfs.common.config import Config, fraction, natural, nonnegative, part, positive, setting
from psfs.silhouettes.config import AppearanceConfig, SilhouetteConfig
from psfs.voxels.config import ReconstructionConfig

#: The source of defaults that name no other source.
_TUNED = "tuned on replays of synth_walk_4cam and bodytrack_walk on two CPU cores and an H200"


class SizeConfig(Config):
    """The sizes of search to choose from."""

    SOURCE: ClassVar = _TUNED

    fewest: int = natural(
        960,
        "Fewest evaluations of a pose in a frame; with fewer a search does not follow a person.",
    )
    most: int = natural(6000, "Most evaluations of a pose in a frame; with more it gains nothing.")
    n_sizes: int = natural(
        6,
        "Number of sizes between these, spaced geometrically: each about half as large again as "
        "the one before.",
    )
    particle_step: int = natural(
        16, "Number that particles come in multiples of: a vector of most devices."
    )
    min_particles: int = setting(48, "Fewest particles.", least=2)
    min_layers: int = natural(
        6,
        "Fewest layers.",
        "a swarm with fewer iterations does not converge (Rymut 2016, figure 6.9)",
    )
    max_layers: int = natural(
        15, "Most layers.", "beyond these it gains little (Rymut 2016, figure 6.9)"
    )
    trunk_share: float = fraction(
        1 / 3, "Share of the layers in which an annealed particle filter moves the trunk alone."
    )


class GovernorConfig(Config):
    """Rules for enlarging and reducing the search."""

    SOURCE: ClassVar = _TUNED

    share: float = setting(0.85, "Share of a frame's time that is planned with.", above=0, most=1)
    window: int = natural(
        8,
        "Number of frames over whose median time the size of the search is chosen.",
        unit="frames",
    )
    too_long: float = positive(
        1.2, "Factor of the time allowed above which a smaller search is chosen."
    )
    with_room: float = positive(
        0.7, "Share of the time allowed that a larger search must stay below to be chosen."
    )


class CaptureConfig(Config):
    """Cameras that are read live."""

    SOURCE: ClassVar = "by hand"

    patience: float = positive(
        5.0, "Time without a new picture after which a camera counts as gone.", unit="s"
    )
    default_fps: float = positive(
        30.0, "Frame rate of a camera that states none.", "that of most", "frames/s"
    )
    box_side: float = positive(
        1.3,
        "Distance to each side of the first pose up to which voxels are first reconstructed.",
        unit="m",
    )
    box_below: float = nonnegative(
        0.2, "Depth of that box below the lowest joint, for the feet.", unit="m"
    )
    box_height: float = positive(
        2.5, "Height of that box: a tall person with raised arms.", unit="m"
    )


def _without_second_look() -> ReconstructionConfig:
    appearance = AppearanceConfig(look_again=False)
    return ReconstructionConfig(silhouette=SilhouetteConfig(appearance=appearance))


class LiveConfig(Config):
    """All settings of live tracking."""

    SOURCE: ClassVar = _TUNED

    noise: float = positive(
        0.22,
        "Standard deviation of the noise of searches in voxels: their mean shows where the body "
        "has moved to, so less is needed than in `FilterConfig`.",
        unit="of the body's sigmas",
    )
    max_gap: float = nonnegative(
        0.5,
        "Greatest time since the last good pose that widens a search: a pose is searched for as "
        "widely as that time asks for.",
        unit="s",
    )
    max_objective_error: float = nonnegative(
        0.9, "Error of image objectives (1 is no overlap at all) above which a pose counts as lost."
    )
    n_probes: int = natural(
        2,
        "Number of searches in the first frame that the cost of one is measured by, after one to "
        "compile.",
    )
    early: float = nonnegative(
        0.25,
        "Time by which the processing begins earlier than needed, as a share of what it takes.",
    )
    smoothing: float = setting(
        0.2, "Weight of the newest duration in the running means.", above=0, most=1
    )
    sizes: SizeConfig = part(SizeConfig)
    governor: GovernorConfig = part(GovernorConfig)
    #: Detection of a lost person. Far from the pose of the frame before, a few particles reach a
    #: misfit of about 0.6; only above that nothing fits.
    recovery: RecoveryConfig = part(RecoveryConfig, ratio=3.0, least=0.6)
    #: Frames that are dropped leave gaps; time is worth more than a second look at every frame.
    reconstruction: ReconstructionConfig = Field(default_factory=_without_second_look)
