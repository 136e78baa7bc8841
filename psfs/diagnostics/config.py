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
    agrees: float = 0.8
    """Share of its silhouette that must lie within the others' shape, before furniture is an excuse
    for what it lacks. By hand."""
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


@dataclass(frozen=True)
class AlignmentConfig:
    """How a rig that is a little off is corrected, see `psfs.diagnostics.alignment`.

    Priors are what rigs in rooms are off by; the rest was set by hand on `hard_real_5cam` and tried
    on laboratory sequences whose calibration was spoilt by 0.3 to 0.7 degrees.
    """

    on: bool = True
    """Whether it is corrected at all."""
    turn: float = 0.008
    """rad, by which a camera is turned about an axis: half a degree."""
    focal: float = 0.005
    """Share by which a focal length is wrong."""
    middle: float = 0.001
    """m, by which the scene's middle moves as all cameras see it: what all agree on stays."""
    noise: float = 0.006
    """m, deviation of the distance between planes that touch the same body."""
    reach: float = 0.02
    """m at which a distance counts a quarter (Geman & McClure 1987): shadows, lost limbs."""
    information: float = 0.2
    """Independent measurements in one: frames that follow each other are alike."""
    n_steps: int = 10
    """Gauss-Newton steps."""
    least_rows: int = 10
    """Measurements per unknown that are asked for."""
    least_moved: float = 1.6 / 640
    """Share of the picture's longer side by which cameras must be off in the mean square: exact
    rigs seem off by up to 1.4 px, for silhouettes lose hair and gain shadows ..."""
    share: float = 0.5
    """... distances must shrink to this share (exact rigs: to 0.52 and more) ..."""
    most_left: float = 0.02
    """... and to no more than so many m, else something else is wrong."""
    first_share: float = 0.75
    """In small pictures to this one, before larger ones are looked at ..."""
    longest_side: int = 640
    """... whose longest side, px, is this: they know directions twice as well."""


@dataclass(frozen=True)
class OccluderConfig:
    """Where furniture hides people, see `psfs.diagnostics.occluders`.

    Set by hand on `hard_chair_6cam`; laboratory sequences with a table painted over some cameras
    and the clean ones confirmed them.
    """

    on: bool = True
    """Whether it is looked for at all; Song et al. know none."""
    samples: int = 64
    """Frames spread over the sequence that are looked at: with 25 of 122 a twelfth of what is
    hidden was not found."""
    longest_side: int = 640
    """Longest side of the pictures that are looked at, px."""
    voxels: int = 600_000
    """Voxels of the grid around the person, at most: about 3 cm."""
    agreeing: int = 3
    """Cameras that must show foreground which nothing explains: two alone see ghosts."""
    denying: int = 2
    """At most so many cameras may be hidden from the same place at once."""
    margin: int = 3
    """px around what is explained that passes for explained, too: rims."""
    least_frames: int = 2
    """Frames in which a pixel must deny what the others see."""
    least_share: float = 0.1
    """Of the frames in which it shows the person or denies him, it must deny so many."""
    least_confirmed: float = 0.5
    """A camera must show the person in so many pixels for each that denies him, over all frames,
    else it is not furniture that is wrong with it."""
    gap: int = 13
    """px of holes that are filled, for the person is not behind everything in some frame."""
    least_pixels: int = 300
    """Smaller parts are noise."""


@dataclass(frozen=True)
class FaultConfig:
    """When footage counts as faulty, see `psfs.diagnostics.faults`.

    Set between what the sequences at hand show untouched and what they show spoilt: every two
    cameras exchanged, every camera 2 to 10 frames late.
    """

    longest_side: int = 320
    """Longest side of the small pictures, px."""
    window: tuple[int, int] = (60, 200)
    """Frames that are looked at, in a row: at least and at most..."""
    pixels: float = 1.5e9
    """...so many that not more pixels are decoded."""
    samples: int = 24
    """Frames among them whose pictures are kept."""
    longest_lag: float = 2.0
    """Seconds by which a camera may come late, or early; at most a third of the frames."""
    least_lag: int = 2
    """Frames: less is not told from the ways in which cameras expose."""
    lag_gain: float = 1.1
    """A lag counts if the cost is so much higher without it. Untouched: up to 1.06."""
    exchange_share: float = 0.92
    """Cameras count as exchanged if that lowers the cost to this share. Untouched: above 1.1."""
    mirror_share: float = 0.6
    """The same for pictures that are mirrored, and for calibrations of another convention."""
    disagreeing: float = 0.075
    """Cost above which the cameras do not fit each other at all. Untouched: up to 0.061."""
    turned_ratio: float = 2.5
    """A camera is looked at closer where its cost is so much higher than the others'..."""
    turned_cost: float = 0.045
    """...and at least this; 0.035 among four frames of four cameras. It..."""
    turned_share: float = 0.5
    """...counts as turned if turning it back lowers its cost to this share."""
