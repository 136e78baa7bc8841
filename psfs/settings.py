"""All settings of a reconstruction in one tree, a node for each room.

Tables of --config and of presets, validation, and docs/settings.md are derived from it; so are the
flags of single settings.
"""

from __future__ import annotations

from psfs.common.config import Config, part
from psfs.footage import settings as footage
from psfs.self_calibration.config import PersonConfig
from psfs.voxels.config import ReconstructionConfig


class Settings(Config):
    """The settings of every room of psfs."""

    capture: footage.SequenceSettings = part(footage.SequenceSettings)
    reconstruction: ReconstructionConfig = part(ReconstructionConfig)
    person: PersonConfig = part(PersonConfig)
