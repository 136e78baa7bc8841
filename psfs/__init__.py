"""Probabilistic shape from silhouette: calibrated views in, coloured voxel clouds out.

    import psfs

    sequence = psfs.open_sequence("walk/")
    for voxels in psfs.reconstruct(sequence):  # a VoxelCloud per frame
        print(len(voxels), voxels.centres.mean(axis=0))

`open_sequence` and `reconstruct` do what `psfs reconstruct` does. The parts below them keep the
data on the device: `Reconstructor(device, rig, grid, background)` makes voxels of a `Frame`.
Lengths are metres, the world is right-handed, Z is up. What a user can mend raises `InputError`,
`MissingFileError` or `DeviceError`, all of them `UserError`.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cl import (
        Device,
        DeviceError,
        InputError,
        MissingFileError,
        NumpyDevice,
        UserError,
        select_device,
    )
    from psfs.api import open_sequence, reconstruct
    from psfs.background.config import (
        AdaptationConfig,
        BackgroundConfig,
        ChromaKeyConfig,
        EvidenceConfig,
    )
    from psfs.cameras.camera import Camera, CameraRig
    from psfs.presets import preset
    from psfs.reconstructor import ReconstructionConfig, Reconstructor
    from psfs.sequence import Frame, Sequence
    from psfs.session import Session, SessionSettings
    from psfs.silhouettes.config import (
        AppearanceConfig,
        EvidenceSmoothingConfig,
        FloorConfig,
        RimConfig,
        SilhouetteConfig,
    )
    from psfs.volume import automatic_grid
    from psfs.voxels.clouds import read_cloud, write_cloud
    from psfs.voxels.config import ColourConfig, ForegroundJoinConfig, OccupancyConfig, VolumeConfig
    from psfs.voxels.grid import VoxelCloud, VoxelGrid

__version__: str

__all__ = [
    "AdaptationConfig",
    "AppearanceConfig",
    "BackgroundConfig",
    "Camera",
    "CameraRig",
    "ChromaKeyConfig",
    "ColourConfig",
    "Device",
    "DeviceError",
    "EvidenceConfig",
    "EvidenceSmoothingConfig",
    "FloorConfig",
    "ForegroundJoinConfig",
    "Frame",
    "InputError",
    "MissingFileError",
    "NumpyDevice",
    "OccupancyConfig",
    "ReconstructionConfig",
    "Reconstructor",
    "RimConfig",
    "Sequence",
    "Session",
    "SessionSettings",
    "SilhouetteConfig",
    "UserError",
    "VolumeConfig",
    "VoxelCloud",
    "VoxelGrid",
    "__version__",
    "automatic_grid",
    "open_sequence",
    "preset",
    "read_cloud",
    "reconstruct",
    "select_device",
    "write_cloud",
]

#: Where the public names live. They are imported when they are first asked for: `import psfs` alone
#: must not wait for OpenCL and OpenCV.
_MODULES = {
    "cl": (
        "Device",
        "DeviceError",
        "InputError",
        "MissingFileError",
        "NumpyDevice",
        "UserError",
        "select_device",
    ),
    "psfs.api": ("open_sequence", "reconstruct"),
    "psfs.background.config": (
        "AdaptationConfig",
        "BackgroundConfig",
        "ChromaKeyConfig",
        "EvidenceConfig",
    ),
    "psfs.cameras.camera": ("Camera", "CameraRig"),
    "psfs.presets": ("preset",),
    "psfs.reconstructor": ("ReconstructionConfig", "Reconstructor"),
    "psfs.sequence": ("Frame", "Sequence"),
    "psfs.session": ("Session", "SessionSettings"),
    "psfs.silhouettes.config": (
        "AppearanceConfig",
        "FloorConfig",
        "RimConfig",
        "SilhouetteConfig",
        "EvidenceSmoothingConfig",
    ),
    "psfs.volume": ("automatic_grid",),
    "psfs.voxels.clouds": ("read_cloud", "write_cloud"),
    "psfs.voxels.config": (
        "ColourConfig",
        "ForegroundJoinConfig",
        "OccupancyConfig",
        "VolumeConfig",
    ),
    "psfs.voxels.grid": ("VoxelCloud", "VoxelGrid"),
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
