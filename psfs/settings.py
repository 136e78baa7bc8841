"""All settings of a reconstruction in one tree, a node for each room.

Tables of --config and of presets, validation, and docs/settings.md are derived from it; so are the
flags of single settings.
"""

from __future__ import annotations

from psfs.calibration.config import CalibrationConfig
from psfs.common.config import Config, part
from psfs.diagnostics.config import (
    AlignmentConfig,
    FaultConfig,
    InViewConfig,
    OccluderConfig,
)
from psfs.footage import settings as footage
from psfs.self_calibration.config import PersonConfig
from psfs.voxels.config import ReconstructionConfig


class DiagnosticsSettings(Config):
    """Limits beyond which footage and cameras count as faulty."""

    faults: FaultConfig = part(FaultConfig)
    alignment: AlignmentConfig = part(AlignmentConfig)
    occluders: OccluderConfig = part(OccluderConfig)
    in_view: InViewConfig = part(InViewConfig)


class Settings(Config):
    """The settings of every room of psfs."""

    capture: footage.SequenceSettings = part(footage.SequenceSettings)
    reconstruction: ReconstructionConfig = part(ReconstructionConfig)
    diagnostics: DiagnosticsSettings = part(DiagnosticsSettings)
    calibration: CalibrationConfig = part(CalibrationConfig)
    person: PersonConfig = part(PersonConfig)
