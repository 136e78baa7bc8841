"""All settings in one tree, a node for each room; those of psfs first.

Tables of --config and of presets, validation, and docs/settings.md are derived from it; so are the
flags of single settings.
"""

from __future__ import annotations

from apf.filters.method import Method
from apf.initialisation.start import StartConfig
from apf.live.config import LiveConfig
from apf.synthetic.config import SceneConfig
from apf.tracking.config import RecoveryConfig, SmoothingConfig, TriangulatedConfig
from psfs.common.config import Config, part
from psfs.footage.settings import SequenceSettings
from psfs.self_calibration.config import PersonConfig
from psfs.voxels.config import ReconstructionConfig


class Settings(Config):
    """The settings of every room of psfs and apf."""

    capture: SequenceSettings = part(SequenceSettings)
    reconstruction: ReconstructionConfig = part(ReconstructionConfig)
    person: PersonConfig = part(PersonConfig)
    method: Method = part(Method)
    start: StartConfig = part(StartConfig)
    recovery: RecoveryConfig = part(RecoveryConfig)
    smoothing: SmoothingConfig = part(SmoothingConfig)
    triangulated: TriangulatedConfig = part(TriangulatedConfig)
    live: LiveConfig = part(LiveConfig)
    synthetic: SceneConfig = part(SceneConfig)
