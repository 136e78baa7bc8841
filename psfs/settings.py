"""All settings of a reconstruction in one tree, a node for each room.

Tables of --config and of presets, validation, and docs/settings.md are derived from it; so are the
flags of single settings.
"""

from __future__ import annotations

from psfs.background.config import ScreenConfig
from psfs.background.estimation_config import BackgroundModelConfig, TakeConfig
from psfs.calibration.config import CalibrationConfig
from psfs.common.config import Config, part
from psfs.diagnostics.config import (
    AlignmentConfig,
    ConsistencyConfig,
    FaultConfig,
    OccluderConfig,
)
from psfs.diagnostics.picture_config import PictureConfig
from psfs.footage import settings as footage
from psfs.people.config import PeopleConfig
from psfs.self_calibration.config import PersonConfig
from psfs.voxels.config import EdgeConfig, ReconstructionConfig


class BackgroundSettings(Config):
    """The estimation of the background from pictures of the empty scene."""

    model: BackgroundModelConfig = part(
        BackgroundModelConfig, "The empty scene as a density per pixel."
    )
    screen: ScreenConfig = part(ScreenConfig, "The screen of one colour.")
    take: TakeConfig = part(TakeConfig, "The empty scene, when only the take itself shows it.")


class DiagnosticsSettings(Config):
    """Limits beyond which footage and cameras count as faulty."""

    consistency: ConsistencyConfig = part(ConsistencyConfig, "Cameras that disagree.")
    faults: FaultConfig = part(FaultConfig, "Cameras that are late, exchanged or turned.")
    pictures: PictureConfig = part(PictureConfig, "Faults of one camera's pictures.")
    alignment: AlignmentConfig = part(AlignmentConfig, "Rigs that are a little off.")
    occluders: OccluderConfig = part(OccluderConfig, "Furniture before the person.")


class Settings(Config):
    """The settings of every room of psfs."""

    capture: footage.Settings = part(
        footage.Settings, "What the files of a sequence do not say: the keys of sequence.toml."
    )
    background: BackgroundSettings = part(
        BackgroundSettings, "How the background is estimated from pictures."
    )
    reconstruction: ReconstructionConfig = part(
        ReconstructionConfig, "From pictures to silhouettes and voxels."
    )
    edges: EdgeConfig = part(EdgeConfig, "The edges of the voxels' silhouettes.")
    diagnostics: DiagnosticsSettings = part(
        DiagnosticsSettings, "When footage and cameras count as faulty."
    )
    people: PeopleConfig = part(PeopleConfig, "Who counts as a person, and is followed.")
    calibration: CalibrationConfig = part(CalibrationConfig, "How cameras are calibrated.")
    person: PersonConfig = part(PersonConfig, "How cameras are calibrated by a person.")
