"""Probabilistic shape from silhouette: calibrated views in, coloured voxel clouds out.

    import psfs

    sequence = psfs.open_sequence("walk/")
    for voxels in psfs.reconstruct(sequence):  # a VoxelCloud per frame
        print(len(voxels), voxels.centres.mean(axis=0))

`open_sequence` and `reconstruct` do what `psfs reconstruct` does. The parts below them keep the
data on the device: `Reconstructor(device, rig, grid, background)` makes voxels of a `Frame`.
Lengths are metres, the world is right-handed, Z is up. Errors that the user can fix are
`InputError`, `MissingFileError` or `DeviceError`, subclasses of `UserError`.
"""

from __future__ import annotations

import importlib
from typing import Any

import lazy_loader as _lazy

# The names are in __init__.pyi; each is imported when it is first asked for: `import psfs` alone
# must not wait for OpenCL, OpenCV and SciPy.
_attribute, _, __all__ = _lazy.attach_stub(__name__, __file__)
__all__ += ["__version__"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("psfs-apf")
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _attribute(name)


def __dir__() -> list[str]:
    return list(__all__)
