"""All settings of tracking in one tree, a node for each room; those of `psfs.settings` first."""

from __future__ import annotations

from apf.cluster.config import ChunksConfig, WorkerConfig
from apf.filters.method import Method
from apf.initialisation.config import StartConfig
from apf.initialisation.fit_config import JointFitConfig, KeypointStartConfig
from apf.keypoints.config import (
    AgreementConfig,
    AssociationConfig,
    CropConfig,
    LagConfig,
    PersonConfig,
    SideConfig,
)
from apf.live.config import CaptureConfig, LiveConfig
from apf.synthetic.config import SceneConfig
from apf.tracking.config import (
    BatchConfig,
    GaitConfig,
    RecoveryConfig,
    SmoothingConfig,
    TriangulatedConfig,
    TwoWayConfig,
)
from psfs import settings as of_psfs
from psfs.common.config import Config, part


class KeypointSettings(Config):
    """Keypoints in the pictures: found, chosen, compared."""

    crop: CropConfig = part(CropConfig, "How pictures are cropped before a network sees them.")
    persons: PersonConfig = part(PersonConfig, "Which of the persons is followed.")
    association: AssociationConfig = part(
        AssociationConfig, "Which persons of the cameras are the same, if several are followed."
    )
    agreement: AgreementConfig = part(AgreementConfig, "When the cameras' keypoints disagree.")
    lags: LagConfig = part(LagConfig, "When keypoints are late.")
    sides: SideConfig = part(SideConfig, "When left and right of the keypoints are exchanged.")


class ClusterSettings(Config):
    """Many takes, and long ones in chunks."""

    at_once: BatchConfig = part(BatchConfig, "How many takes a process works on at a time.")
    chunks: ChunksConfig = part(ChunksConfig, "How chunks of a long take overlap.")
    workers: WorkerConfig = part(WorkerConfig, "How many workers there are.")


class Settings(of_psfs.Settings):
    """The settings of every room of psfs and apf."""

    method: Method = part(Method, "Search, objective, terms of the likelihood.")
    start: StartConfig = part(StartConfig, "The automatic start.")
    joint_start: JointFitConfig = part(JointFitConfig, "The start from 3-D joints.")
    keypoint_start: KeypointStartConfig = part(KeypointStartConfig, "The start from keypoints.")
    recovery: RecoveryConfig = part(RecoveryConfig, "When a person is lost, and found again.")
    two_way: TwoWayConfig = part(TwoWayConfig, "How passes forward and backward are made one.")
    smoothing: SmoothingConfig = part(SmoothingConfig, "How a track is smoothed.")
    gait: GaitConfig = part(GaitConfig, "What counts as walking.")
    keypoints: KeypointSettings = part(KeypointSettings, "Keypoints in the pictures.")
    triangulated: TriangulatedConfig = part(
        TriangulatedConfig, "A track from keypoints without a body."
    )
    live: LiveConfig = part(LiveConfig, "Live tracking.")
    captures: CaptureConfig = part(CaptureConfig, "Cameras that are read as they come.")
    cluster: ClusterSettings = part(ClusterSettings, "Many takes, and long ones in chunks.")
    synthetic: SceneConfig = part(SceneConfig, "Synthetic sequences.")
