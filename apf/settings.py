"""All settings of tracking in one tree, a node for each room; those of `psfs.settings` first."""

from __future__ import annotations

from apf.filters.method import Method
from apf.initialisation.config import StartConfig
from apf.live.config import LiveConfig
from apf.synthetic.config import SceneConfig
from apf.tracking.config import RecoveryConfig, SmoothingConfig, TriangulatedConfig
from psfs import settings as of_psfs
from psfs.common.config import part


class Settings(of_psfs.Settings):
    """The settings of every room of psfs and apf."""

    method: Method = part(Method)
    start: StartConfig = part(StartConfig)
    recovery: RecoveryConfig = part(RecoveryConfig)
    smoothing: SmoothingConfig = part(SmoothingConfig)
    triangulated: TriangulatedConfig = part(TriangulatedConfig)
    live: LiveConfig = part(LiveConfig)
    synthetic: SceneConfig = part(SceneConfig)
