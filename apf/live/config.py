"""Settings of live tracking, in parts.

Where a default names no other source it was tuned on replays of `synth_walk_4cam` and
`bodytrack_walk` on two CPU cores and an H200.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from apf.tracking.recovery import RecoveryConfig
from psfs.reconstructor import ReconstructionConfig
from psfs.silhouettes.config import AppearanceConfig, SilhouetteConfig


@dataclass(frozen=True)
class SizeConfig:
    """The sizes of search that a run chooses from."""

    fewest: int = 960
    """Evaluations of a pose in a frame; with fewer a search does not follow a person."""
    most: int = 6000
    """With more it gains nothing."""
    n_sizes: int = 6
    """Sizes between these, spaced geometrically: each about half as large again as the one
    before."""
    particle_step: int = 16
    """Particles come in multiples of this, a vector of most devices."""
    min_particles: int = 48
    """And there are at least so many."""
    min_layers: int = 6
    """A swarm with fewer iterations does not converge (Rymut 2016, figure 6.9)."""
    max_layers: int = 15
    """Beyond these it gains little (there, too)."""
    trunk_share: float = 1 / 3
    """Share of the layers in which an annealed particle filter moves the trunk alone."""


@dataclass(frozen=True)
class GovernorConfig:
    """When the search is made larger or smaller."""

    share: float = 0.85
    """Share of a frame's time that is planned with."""
    window: int = 8
    """The size is chosen anew by the median of so many frames ..."""
    too_long: float = 1.2
    """... where it is more than this times what is allowed ..."""
    with_room: float = 0.7
    """... or a larger search would take less than this share of it."""


@dataclass(frozen=True)
class CaptureConfig:
    """Cameras whose pictures are read as they come."""

    patience: float = 5.0
    """s without a new picture after which a camera counts as gone."""
    default_fps: float = 30.0
    """frames/s of a camera that states none: that of most."""
    box_side: float = 1.3
    """m, voxels are looked for at first in a box around the first pose: to each side ..."""
    box_below: float = 0.2
    """... m below the lowest joint, for the feet ..."""
    box_height: float = 2.5
    """... and its height, m: a tall person with raised arms."""


@dataclass(frozen=True)
class LiveConfig:
    """Everything that live tracking goes by."""

    noise: float = 0.22
    """Scale of the noise of searches in voxels: their mean shows where the body has moved to, so
    less is needed than in `FilterConfig`."""
    max_gap: float = 0.5
    """s; a pose is searched for as widely as the time since the last good one asks for, up to
    this."""
    max_objective_error: float = 0.9
    """Error of image objectives (1 is no overlap at all) beyond which a pose is not believed."""
    n_probes: int = 2
    """Searches in the first frame that the cost of one is measured by, after one to compile."""
    early: float = 0.25
    """How much earlier than needed the processing begins, as a share of what it takes."""
    smoothing: float = 0.2
    """Weight of the newest in the running means of durations."""
    sizes: SizeConfig = field(default_factory=SizeConfig)
    governor: GovernorConfig = field(default_factory=GovernorConfig)
    recovery: RecoveryConfig = field(
        default_factory=lambda: RecoveryConfig(ratio=3.0, least=0.6, unknown=0.6)
    )
    """Far from the frame before, few particles find no better than 0.6; only beyond it nothing
    fits."""
    reconstruction: ReconstructionConfig = field(
        default_factory=lambda: ReconstructionConfig(
            SilhouetteConfig(appearance=AppearanceConfig(look_again=False))
        )
    )
    """Frames that are dropped leave gaps; time is worth more than a second look at every frame."""
