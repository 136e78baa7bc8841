"""Track a person: the annealed particle filter over voxels, a skeleton with 32 degrees of freedom.

    import apf, psfs

    track = apf.track(psfs.open_sequence("walk/"))
    track.joints  # (frames, joints, 3) m in the world, Z up
    track.angles["l_knee_flexion"]  # (frames,) degrees
    track.confidence  # (frames,) 0 to 1
    apf.smooth_track(track).save("walk.bvh")

`track` does what `apf track` does: finds the person, tracks the person, and searches again after
losing track. The parts below it: a `Method` is a search (`AnnealedParticleFilter`, `ParticleSwarm`,
`SirParticleFilter`), an objective and their settings (`FilterConfig` and others); a search in a
`Scene` (device, rig, grid, body) gives an `Estimate` per frame of voxels; `initialise` finds the
first pose. Angles are radians, lengths metres. Errors that the user can fix are `InputError`,
`MissingFileError` or `DeviceError`, subclasses of `UserError`.
"""

from psfs.common.lazy import attach_names as _attach_names

# The names are in __init__.pyi; each is imported when it is first asked for: `import apf` alone
# must not wait for OpenCL, OpenCV and SciPy.
__getattr__, __dir__, __all__ = _attach_names(__name__, __file__)
