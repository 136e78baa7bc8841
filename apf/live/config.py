"""Settings of live tracking."""

from __future__ import annotations

from typing import ClassVar

from apf.tracking.config import RecoveryConfig
from psfs.common.config import Config, natural, nonnegative, part, positive, setting
from psfs.silhouettes.config import AppearanceConfig, SilhouetteConfig
from psfs.voxels.config import ReconstructionConfig


class LiveConfig(Config):
    """All settings of live tracking."""

    SOURCE: ClassVar = "tuned on two CPU cores and a GPU"

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
    fewest: int = natural(
        960,
        "Fewest evaluations of a pose in a frame; with fewer a search does not follow a person.",
    )
    most: int = natural(6000, "Most evaluations of a pose in a frame; with more it gains nothing.")
    share: float = setting(
        0.85,
        "Share of a frame's time that is planned with. A search that takes all of it is made "
        "smaller; a larger one is chosen if it is expected to take this share of the share.",
        above=0,
        below=1,
    )
    #: Detection of a lost person. Far from the pose of the frame before, a few particles reach a
    #: misfit of about 0.6; only above that nothing fits.
    recovery: RecoveryConfig = part(RecoveryConfig, ratio=3.0, least=0.6)
    #: Frames that are dropped leave gaps; time is worth more than a second look at every frame.
    reconstruction: ReconstructionConfig = part(
        ReconstructionConfig,
        silhouette=SilhouetteConfig(appearance=AppearanceConfig(look_again=False)),
    )
