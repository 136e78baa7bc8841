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

from psfs.common.lazy import attach_names as _attach_names

# The names are in __init__.pyi; each is imported when it is first asked for: `import psfs` alone
# must not wait for OpenCL, OpenCV and SciPy.
__getattr__, __dir__, __all__ = _attach_names(__name__, __file__)
