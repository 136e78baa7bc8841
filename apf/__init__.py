"""Track a person: the annealed particle filter over voxels, a skeleton with 31 degrees of freedom.

    import apf, psfs

    track = apf.track(psfs.open_sequence("walk/"))
    track.joints  # (frames, joints, 3) m in the world, Z up
    track.angles["l_knee_flexion"]  # (frames,) degrees
    track.confidence  # (frames,) 0 to 1
    apf.smoothed(track).save("walk.bvh")

`track` does what `apf track` does: finds the person, follows, and finds again whom it lost. The
parts below it: a `Method` is a search (`AnnealedParticleFilter`, `ParticleSwarm`,
`SirParticleFilter`), an objective and their settings (`FilterConfig` and others); a search in a
`Scene` (device, rig, grid, body) gives an `Estimate` per frame of voxels; `initialise` looks for
the first pose. Angles are radians, lengths metres. What a user can mend raises `InputError`,
`MissingFileError` or `DeviceError`, all of them `UserError`.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from apf.api import track
    from apf.body import BodyModel, load_body, save_body
    from apf.evaluation.evaluate import Evaluation, evaluate, load_truth
    from apf.filters.annealed import AnnealedParticleFilter
    from apf.filters.base import Estimate, Tracker
    from apf.filters.config import FilterConfig, LimbSearchConfig, RefinementConfig, SearchConfig
    from apf.filters.method import Method
    from apf.filters.sir import SirConfig, SirParticleFilter
    from apf.filters.swarm import ParticleSwarm, SwarmConfig
    from apf.image_objective.config import FeatureConfig, ObjectiveConfig, ProximityConfig
    from apf.initialisation import Start, StartConfig, StartError, initialise
    from apf.initialisation.from_joints import fit_to_joints
    from apf.keypoints.keypoints import Keypoints
    from apf.likelihood.config import (
        ContourConfig,
        KeypointConfig,
        LikelihoodConfig,
        MotionPriorConfig,
        PartColourConfig,
        ReprojectionConfig,
        SurfaceSamplesConfig,
    )
    from apf.presets import Preset, preset
    from apf.scene import Scene
    from apf.tracking.foot_contact import ContactConfig
    from apf.tracking.gait import Gait, GaitConfig, gait_of
    from apf.tracking.motion_files import Export, export
    from apf.tracking.recovery import RecoveryConfig
    from apf.tracking.settings import TakeSettings
    from apf.tracking.smoothing import SmoothingConfig, smoothed
    from apf.tracking.take import Take, track_take
    from apf.tracking.track import Track
    from cl import (
        Device,
        DeviceError,
        InputError,
        MissingFileError,
        NumpyDevice,
        UserError,
        select_device,
    )

__version__: str

__all__ = [
    "AnnealedParticleFilter",
    "BodyModel",
    "ContactConfig",
    "ContourConfig",
    "Device",
    "DeviceError",
    "Estimate",
    "Evaluation",
    "Export",
    "FeatureConfig",
    "FilterConfig",
    "Gait",
    "GaitConfig",
    "InputError",
    "KeypointConfig",
    "Keypoints",
    "LikelihoodConfig",
    "LimbSearchConfig",
    "Method",
    "MissingFileError",
    "MotionPriorConfig",
    "NumpyDevice",
    "ObjectiveConfig",
    "PartColourConfig",
    "ParticleSwarm",
    "Preset",
    "ProximityConfig",
    "RecoveryConfig",
    "RefinementConfig",
    "ReprojectionConfig",
    "Scene",
    "SearchConfig",
    "SirConfig",
    "SirParticleFilter",
    "SmoothingConfig",
    "Start",
    "StartConfig",
    "StartError",
    "SurfaceSamplesConfig",
    "SwarmConfig",
    "Take",
    "TakeSettings",
    "Track",
    "Tracker",
    "UserError",
    "__version__",
    "evaluate",
    "export",
    "fit_to_joints",
    "gait_of",
    "initialise",
    "load_body",
    "load_truth",
    "preset",
    "save_body",
    "select_device",
    "smoothed",
    "track",
    "track_take",
]

#: Where the public names live. They are imported when they are first asked for: `import apf` alone
#: must not wait for OpenCL, OpenCV and SciPy.
_MODULES = {
    "apf.api": ("track",),
    "apf.body": ("BodyModel", "load_body", "save_body"),
    "apf.filters.annealed": ("AnnealedParticleFilter",),
    "apf.filters.base": ("Estimate", "Tracker"),
    "apf.filters.config": ("FilterConfig", "LimbSearchConfig", "RefinementConfig", "SearchConfig"),
    "apf.filters.method": ("Method",),
    "apf.filters.sir": ("SirConfig", "SirParticleFilter"),
    "apf.filters.swarm": ("ParticleSwarm", "SwarmConfig"),
    "apf.image_objective.config": ("FeatureConfig", "ObjectiveConfig", "ProximityConfig"),
    "apf.initialisation": ("Start", "StartConfig", "StartError", "initialise"),
    "apf.initialisation.from_joints": ("fit_to_joints",),
    "apf.keypoints.keypoints": ("Keypoints",),
    "apf.likelihood.config": (
        "ContourConfig",
        "KeypointConfig",
        "LikelihoodConfig",
        "MotionPriorConfig",
        "PartColourConfig",
        "ReprojectionConfig",
        "SurfaceSamplesConfig",
    ),
    "apf.presets": ("Preset", "preset"),
    "apf.evaluation.evaluate": ("Evaluation", "evaluate", "load_truth"),
    "apf.scene": ("Scene",),
    "apf.tracking.motion_files": ("Export", "export"),
    "apf.tracking.foot_contact": ("ContactConfig",),
    "apf.tracking.gait": ("Gait", "GaitConfig", "gait_of"),
    "apf.tracking.recovery": ("RecoveryConfig",),
    "apf.tracking.settings": ("TakeSettings",),
    "apf.tracking.smoothing": ("SmoothingConfig", "smoothed"),
    "apf.tracking.take": ("Take", "track_take"),
    "apf.tracking.track": ("Track",),
    "cl": (
        "Device",
        "DeviceError",
        "InputError",
        "MissingFileError",
        "NumpyDevice",
        "UserError",
        "select_device",
    ),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


if not TYPE_CHECKING:  # which knows the names above, and that there are no others

    def __getattr__(name: str) -> Any:
        if name == "__version__":
            return version("psfs-apf")
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
