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
    StandingRegionConfig,
)
from apf.live.config import CaptureConfig, LiveConfig
from apf.report.config import MotionConfig, QualityConfig
from apf.synthetic.config import SceneConfig
from apf.tracking.confidence_config import ConfidenceConfig, CorrectionConfig
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
    """Detection, choice and comparison of keypoints."""

    crop: CropConfig = part(CropConfig)
    standing: StandingRegionConfig = part(StandingRegionConfig)
    persons: PersonConfig = part(PersonConfig)
    association: AssociationConfig = part(AssociationConfig)
    agreement: AgreementConfig = part(AgreementConfig)
    lags: LagConfig = part(LagConfig)
    sides: SideConfig = part(SideConfig)


class ClusterSettings(Config):
    """Many takes, and long ones in chunks."""

    at_once: BatchConfig = part(BatchConfig)
    chunks: ChunksConfig = part(ChunksConfig)
    workers: WorkerConfig = part(WorkerConfig)


class Settings(of_psfs.Settings):
    """The settings of every room of psfs and apf."""

    method: Method = part(Method)
    start: StartConfig = part(StartConfig)
    joint_start: JointFitConfig = part(JointFitConfig)
    keypoint_start: KeypointStartConfig = part(KeypointStartConfig)
    recovery: RecoveryConfig = part(RecoveryConfig)
    two_way: TwoWayConfig = part(TwoWayConfig)
    smoothing: SmoothingConfig = part(SmoothingConfig)
    confidence: ConfidenceConfig = part(ConfidenceConfig)
    correction: CorrectionConfig = part(CorrectionConfig)
    gait: GaitConfig = part(GaitConfig)
    keypoints: KeypointSettings = part(KeypointSettings)
    triangulated: TriangulatedConfig = part(TriangulatedConfig)
    quality: QualityConfig = part(QualityConfig)
    motion: MotionConfig = part(MotionConfig)
    live: LiveConfig = part(LiveConfig)
    captures: CaptureConfig = part(CaptureConfig)
    cluster: ClusterSettings = part(ClusterSettings)
    synthetic: SceneConfig = part(SceneConfig)
