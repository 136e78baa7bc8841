"""Faults of a calibration: cameras that cannot be, and a person of a size that cannot be."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.distortion import undistort
from psfs.cameras.units import metres_per_unit
from psfs.common.numbers import INCH
from psfs.diagnostics.fault import Evidence, Fault

#: A camera has another unit, or another world, if it is this many times as far from the others as
#: they are from each other.
_FAR = 15.0
#: Range of focal lengths as shares of the picture's longer side: fields of view of 152 to 0.6
#: degrees.
_FOCAL = (0.125, 100.0)
#: Largest factor by which a lens moves the middle of a picture's side, and by which pixels are
#: wider than high, or higher than wide.
_DISTORTED = 3.0
#: Range of a person's size, m. Outside it, the unit is wrong by a power of ten.
PERSON = (0.25, 4.0)
#: Height of people who stand or walk, m, and units that are no powers of ten, in metres.
_STANDING = (1.1, 2.1)
_IMPERIAL = {INCH: "inches", 12 * INCH: "feet"}


def find_wrong_calibration(evidence: Evidence) -> Iterator[Fault]:
    """Yield a camera that cannot be: a focal length in mm instead of pixels, a lens that forms no
    picture, or a place in another unit than the others'. No statistic: the limits are of optics."""
    names = evidence.names
    if len(names) == 1:
        text = (
            f"camera {names[0]} is the only one, which gives no depth: its silhouette extends "
            "to the end of the volume; expected two or more"
        )
        yield Fault("calibration", (names[0],), text)
    yield from find_rig_faults(evidence.sequence.rig)


def find_rig_faults(rig: CameraRig) -> Iterator[Fault]:
    """Yield the faults that the cameras show without pictures."""
    for camera in rig:
        if text := _describe_lens(camera):
            yield Fault("calibration", (camera.name,), f"camera {camera.name}: {text}")
    yield from _find_far_camera(rig)


def _describe_lens(camera: Camera) -> str:
    """Return why a camera's matrix cannot be, or its distortion, which leaves no ray for the
    middle of the picture's nearest side or moves it by a factor; empty for one that can."""
    focal, width, height = float(camera.K[0, 0]), *camera.size
    if not np.linalg.cond(camera.K[:2, :2]) <= _DISTORTED:
        return (
            f"focal lengths of {focal:.3g} and {camera.K[1, 1]:.3g} px, a skew of "
            f"{camera.K[0, 1]:.3g} px; expected about the same along both sides, and no skew"
        )
    if not _FOCAL[0] <= focal / max(camera.size) <= _FOCAL[1]:
        return (
            f"a focal length of {focal:.3g} px for pictures of {width} x {height} px; expected "
            "pixels, not mm"
        )
    side = min(camera.size) / 2
    radius = side / float(camera.K[[0, 1], [0, 1]].mean())
    moved = np.hypot(*undistort(camera.lens, radius * np.eye(2)[0], radius * np.eye(2)[1])) / radius
    if (moved < _DISTORTED).all() and (moved > 1 / _DISTORTED).all():
        return ""
    coefficients = ", ".join(f"{value:.3g}" for value in camera.distortion)
    return (
        f"its distortion ({coefficients}) forms no picture up to {side:g} px from the middle; "
        "expected coefficients k1, k2, p1, p2, k3 of focal lengths, not of pixels"
    )


def _find_far_camera(rig: CameraRig) -> Iterator[Fault]:
    """Yield the one camera that is far from the others, if there is one."""
    if len(rig) < 4:
        return
    apart = np.linalg.norm(rig.centres[:, None] - rig.centres[None], axis=-1)
    view = int(apart.sum(0).argmax())
    others = np.delete(np.arange(len(rig)), view)
    extent, distance = float(apart[np.ix_(others, others)].max()), float(apart[view, others].min())
    if not distance > _FAR * extent > 0:
        return
    text = (
        f"camera {rig.names[view]} stands {distance:,.4g} m from the others, which stand within "
        f"{extent:.3g} m: its translation is in another unit, or its calibration of another world"
    )
    yield Fault("calibration", (rig.names[view],), text)


def find_wrong_unit(evidence: Evidence) -> Iterator[Fault]:
    """Yield a unit that is wrong by a power of ten. Statistic: the person's size, which is that of
    people."""
    sequence, size = evidence.sequence, evidence.tangency.size
    disagree = any(f.kind in ("calibration", "disagrees", "convention") for f in evidence.known)
    sound = not size > 0 or PERSON[0] <= size <= PERSON[1]
    if sequence.settings.subject == "object" or sound or disagree:
        return
    power = round(math.log10(1.3 / size))
    now = metres_per_unit(sequence.unit)
    names = {1.0: "m", 0.01: "cm", 0.001: "mm"}
    likely = names.get(float(f"{now * 10.0**power:.6g}"), f"{now * 10.0**power:.3g}")
    wrong, unit = f"wrong by {10 ** abs(power):,}", likely
    for metres, name in _IMPERIAL.items():
        imperial, decimal = size * metres / now, size * 10.0**power
        if _STANDING[0] < imperial < _STANDING[1] and not (_STANDING[0] < decimal < _STANDING[1]):
            wrong, unit, likely = "wrong", name, f"{metres:g}"
    text = (
        f"a person would be about {size:.3g} m tall: the unit is {wrong}; it looks like {unit}:"
        f" --unit {likely} (or --subject object, if it is no person)"
    )
    yield Fault("unit", (), text)
