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

    crop: CropConfig = part(CropConfig, "Cropping of pictures for the network.")
    standing: StandingRegionConfig = part(
        StandingRegionConfig, "Regions in which the network looks for each of several people."
    )
    persons: PersonConfig = part(PersonConfig, "Choice of the person to follow.")
    association: AssociationConfig = part(
        AssociationConfig, "Assignment of the persons in the pictures to several people."
    )
    agreement: AgreementConfig = part(
        AgreementConfig, "Limits beyond which the cameras' keypoints disagree."
    )
    lags: LagConfig = part(LagConfig, "Limits beyond which keypoints count as late.")
    sides: SideConfig = part(SideConfig, "Limits beyond which left and right count as exchanged.")


class ClusterSettings(Config):
    """Many takes, and long ones in chunks."""

    at_once: BatchConfig = part(BatchConfig, "Number of takes that a process tracks at a time.")
    chunks: ChunksConfig = part(ChunksConfig, "Overlap of the chunks of a long take.")
    workers: WorkerConfig = part(WorkerConfig, "Number of workers.")


class Settings(of_psfs.Settings):
    """The settings of every room of psfs and apf."""

    method: Method = part(Method, "Search, objective, terms of the likelihood.")
    start: StartConfig = part(StartConfig, "The automatic start.")
    joint_start: JointFitConfig = part(JointFitConfig, "The start from 3-D joints.")
    keypoint_start: KeypointStartConfig = part(KeypointStartConfig, "The start from keypoints.")
    recovery: RecoveryConfig = part(
        RecoveryConfig, "Detection of a lost track, and the new search."
    )
    two_way: TwoWayConfig = part(TwoWayConfig, "Fusion of the forward and backward passes.")
    smoothing: SmoothingConfig = part(SmoothingConfig, "Smoothing of a track.")
    confidence: ConfidenceConfig = part(ConfidenceConfig, "Confidence of a track's limbs.")
    correction: CorrectionConfig = part(CorrectionConfig, "Corrections of a track by hand.")
    gait: GaitConfig = part(GaitConfig, "Definition of walking.")
    keypoints: KeypointSettings = part(KeypointSettings, "Keypoints in the pictures.")
    triangulated: TriangulatedConfig = part(
        TriangulatedConfig, "A track from keypoints without a body."
    )
    quality: QualityConfig = part(QualityConfig, "Limits of the verdict on a track.")
    motion: MotionConfig = part(MotionConfig, "Limits of what people do.")
    live: LiveConfig = part(LiveConfig, "Live tracking.")
    captures: CaptureConfig = part(CaptureConfig, "Cameras that are read live.")
    cluster: ClusterSettings = part(ClusterSettings, "Many takes, and long ones in chunks.")
    synthetic: SceneConfig = part(SceneConfig, "Synthetic sequences.")
