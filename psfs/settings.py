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
    InViewConfig,
    OccluderConfig,
)
from psfs.diagnostics.picture_config import PictureConfig
from psfs.footage import settings as footage
from psfs.footage.config import SoundConfig
from psfs.people.config import PeopleConfig
from psfs.self_calibration.config import PersonConfig
from psfs.voxels.config import EdgeConfig, ReconstructionConfig


class BackgroundSettings(Config):
    """The estimation of the background from pictures of the empty scene."""

    model: BackgroundModelConfig = part(
        BackgroundModelConfig, "Density of the empty scene at each pixel."
    )
    screen: ScreenConfig = part(ScreenConfig, "Search for the screen of a chroma key.")
    take: TakeConfig = part(TakeConfig, "Estimation of the empty scene from the take itself.")


class DiagnosticsSettings(Config):
    """Limits beyond which footage and cameras count as faulty."""

    consistency: ConsistencyConfig = part(ConsistencyConfig, "Search for cameras that disagree.")
    faults: FaultConfig = part(FaultConfig, "Search for late, exchanged or turned cameras.")
    pictures: PictureConfig = part(PictureConfig, "Search for faults of one camera's pictures.")
    alignment: AlignmentConfig = part(AlignmentConfig, "Correction of a slightly wrong rig.")
    occluders: OccluderConfig = part(OccluderConfig, "Search for furniture that hides the person.")
    in_view: InViewConfig = part(InViewConfig, "What each camera should see of the person.")


class Settings(Config):
    """The settings of every room of psfs."""

    capture: footage.SequenceSettings = part(
        footage.SequenceSettings,
        "Facts of a sequence that its files do not state: the keys of sequence.toml.",
    )
    sound: SoundConfig = part(SoundConfig, "Delays of cameras by the sound of their videos.")
    background: BackgroundSettings = part(
        BackgroundSettings, "Estimation of the background from pictures."
    )
    reconstruction: ReconstructionConfig = part(
        ReconstructionConfig, "Reconstruction from pictures to silhouettes and voxels."
    )
    edges: EdgeConfig = part(EdgeConfig, "The edges of the voxels' silhouettes.")
    diagnostics: DiagnosticsSettings = part(
        DiagnosticsSettings, "Limits beyond which footage and cameras count as faulty."
    )
    people: PeopleConfig = part(PeopleConfig, "Counting and following of people.")
    calibration: CalibrationConfig = part(CalibrationConfig, "Calibration of cameras.")
    person: PersonConfig = part(PersonConfig, "Calibration of cameras by a person.")
