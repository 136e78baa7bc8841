"""Parameters of the diagnostics."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ConsistencyConfig:
    """When a camera disagrees with the others, see `psfs.diagnostics.camera_consistency`.

    The defaults were set by hand; the tests hold them on sequences with one spoilt camera.
    """

    samples: int = 4
    """Frames spread over the sequence that are looked at."""
    low_share: float = 0.6
    """A camera is named when its IoU is below this share of the others' median. At 0.7 a sound
    camera of `synth_salsa_4cam_hd` was left out, whose share is 0.68: few cameras leave shapes of
    which each view tells another part."""
    agreeing: float = 0.2
    """Where the others' median IoU is lower, they do not agree among themselves, or see nobody."""
    voxels: int = 250_000
    """Voxels of the coarse shapes, at most."""
    camera_share: float = 0.5
    """Share of the cameras that must see the room where the coarse shapes are looked for."""
    full: float = 0.5
    """Silhouettes that fill more of the picture are no person."""
    least_contrast: float = 2.0
    """Standard deviation, grey levels, below which a picture is of one colour."""
    lags: tuple[int, ...] = (-20, -15, -10, -5, 5, 10, 15, 20)
    """Frames by which a camera's pictures may come late, or early."""
    rise: float = 0.1
    """IoU that a lag must add to be believed."""
