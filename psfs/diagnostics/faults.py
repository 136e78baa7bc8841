"""The stage `diagnose`: find faults of the footage before hours are spent on it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from cl import Device, NumpyDevice
from psfs.cameras.names import join_names
from psfs.cameras.units import metres_per_unit
from psfs.diagnostics.arrangement import (
    Way,
    find_convention,
    find_flipped_cameras,
    find_swapped_cameras,
    measure_lags,
    measure_turn,
    refine_lags,
)
from psfs.diagnostics.config import FaultConfig
from psfs.diagnostics.fault import Fault
from psfs.diagnostics.lens import find_dropped_distortion
from psfs.diagnostics.picture_faults import find_picture_faults
from psfs.diagnostics.rig_faults import find_rig_faults
from psfs.diagnostics.small_views import SmallViews, shows_several_people, small_views
from psfs.diagnostics.tangency import CAP, Tangency
from psfs.sequence import Sequence
from psfs.session import Session

#: Range of a person's size, m. Outside it, the unit is wrong by a power of ten.
PERSON = (0.25, 4.0)
#: Height of people who stand or walk, m, and units that are no powers of ten, in metres.
_STANDING = (1.1, 2.1)
_IMPERIAL = {0.0254: "inches", 0.3048: "feet"}
#: Range of angles, rad, that count as a turned camera. Usual calibrations err by less; more is no
#: turn.
_TURNED = (0.008, 0.5)


#: Longest side, px, of the pictures in which the lag of a late camera is measured.
_LARGER = 640
#: Faults of the footage as a whole.
_OF_ALL = ("exchange", "mirrored", "convention", "disagree", "unit")


@dataclass(frozen=True)
class Diagnosis:
    """The faults of a sequence.

    faults: the most serious first. disagreement: mean distance between the cameras' silhouettes as
    a share of the person's size, 0 to `CAP`; NaN if they cannot be compared. size: the person's, m,
    or NaN. views: the small pictures that were examined.
    """

    faults: list[Fault]
    disagreement: float
    size: float
    views: SmallViews

    @property
    def late(self) -> dict[str, int]:
        """Frames by which pictures come later than the others', by the name of the late camera."""
        return {fault.cameras[0]: fault.late for fault in self.faults if fault.kind == "late"}

    @property
    def concerns_all(self) -> bool:
        """Whether a fault remains that leaving out one camera cannot mend."""
        return any(fault.kind in _OF_ALL for fault in self.faults)

    @property
    def reasons(self) -> dict[str, str]:
        """The faults of single cameras, by the camera's name."""
        alone = [f for f in reversed(self.faults) if len(f.cameras) == 1 or f.kind == "same"]
        return {name: fault.text for fault in alone for name in fault.cameras}

    def without(self, kind: str) -> Diagnosis:
        """Return the diagnosis without the faults of one kind, after these were mended."""
        return replace(self, faults=[fault for fault in self.faults if fault.kind != kind])


def diagnose(session: Session) -> Diagnosis:
    """Find the faults of a session's footage in small pictures of some hundred frames."""
    return session.compute_once(diagnose, lambda: _find_faults(session.sequence, session.device))


def _find_faults(sequence: Sequence, device: Device | NumpyDevice) -> Diagnosis:
    config = FaultConfig()
    views = small_views(sequence, device, config)
    unusable = find_rig_faults(sequence.rig)
    faults = [*_check_single_camera(sequence), *unusable, *find_picture_faults(sequence, views)]
    tangency = Tangency(views.rig, views.outlines)
    compared = tangency.compare()
    if len(sequence.rig) > 1 and math.isfinite(compared.cost) and not unusable:
        if not any(fault.kind == "exchange" for fault in faults):
            found = _explain_misfit(sequence, device, views, tangency, faults, config)
            estimated = not sequence.footage.background
            found = [f for f in found if not _is_effect_of_ghosts(f, faults, estimated)]
            hangs = {f.cameras for f in faults if f.kind == "frozen"}
            faults = [*(f for f in found if f.cameras not in hangs), *faults]
        if not any(fault.kind in ("disagree", "convention") for fault in faults):
            faults += _find_unit_fault(sequence, tangency.size)
    explained = [fault for fault in faults if fault.kind in ("exchange", "mirrored", "turned")]
    faults = explained[:1] or faults  # it invalidates the faults of single cameras
    return Diagnosis(faults, compared.cost, tangency.size, views)


def _check_single_camera(sequence: Sequence) -> list[Fault]:
    names = sequence.rig.names
    text = (
        f"camera {names[0]} is the only one, which gives no depth: its silhouette extends to "
        "the end "
        "of the volume; expected two or more"
    )
    return [Fault("alone", (names[0],), text)] if len(names) == 1 else []


def _is_effect_of_ghosts(fault: Fault, known: list[Fault], estimated: bool) -> bool:
    """Return whether a fault is the effect of backgrounds that contain a person.

    estimated: the backgrounds come from the frames, in which the person stands still for all
    cameras.
    """
    ghosts = {name for other in known if other.kind == "ghost" for name in other.cameras}
    return bool(ghosts) and (estimated or not fault.cameras or bool(ghosts & set(fault.cameras)))


def _explain_misfit(
    sequence: Sequence,
    device: Device | NumpyDevice,
    views: SmallViews,
    tangency: Tangency,
    known: list[Fault],
    config: FaultConfig,
) -> list[Fault]:
    """Return the fault between the cameras: the first explanation that fits."""
    names = sequence.rig.names
    order = find_swapped_cameras(tangency, config)
    flip = find_flipped_cameras(tangency, config)
    if flip and flip[2] < tangency.compare(order).cost:
        return [_describe_flip(names, *flip[:2])]
    if order != list(range(len(order))):
        return [_describe_exchange(names, order)]
    most = min(round(config.longest_lag * sequence.fps), len(views.frames) // 3)
    shifts = measure_lags(tangency, most, config)
    if any(shifts) and views.rig.width < sequence.rig.width:
        large = small_views(sequence, device, config.replace(longest_side=_LARGER))
        shifts = refine_lags(Tangency(large.rig, large.outlines), shifts)
    shifts = _keep_healing_shifts(tangency, shifts, config)
    late = [_describe_lag(sequence, name, by) for name, by in zip(names, shifts, strict=True) if by]
    compared = tangency.compare(shifts=shifts)
    foreign = None
    if not shows_several_people(views.silhouettes):  # else cameras may outline different people
        foreign = _find_foreign_camera(tangency, names, shifts, config)
    if foreign is not None:
        return [foreign, *late]
    if compared.cost > config.disagreeing:
        return [_explain_disagreement(views, tangency, compared.cost, known, config)]
    lens = None if late else find_dropped_distortion(views.rig, views.outlines, config)
    if lens is not None:
        return [_describe_lens(names, *lens)]
    return late or _find_turned_camera(tangency, names, known, config)


def _keep_healing_shifts(tangency: Tangency, shifts: list[int], config: FaultConfig) -> list[int]:
    """Return the shifts (V,) without those by which a camera hardly fits better: something else
    than its time is wrong."""
    before, after = tangency.compare().cameras, tangency.compare(shifts=shifts).cameras
    heals = after < config.healed * before
    return [by if better else 0 for by, better in zip(shifts, heals, strict=True)]


def _find_foreign_camera(
    tangency: Tangency, names: list[str], shifts: list[int], config: FaultConfig
) -> Fault | None:
    """Return the camera that films another motion than the others: of another take, or of another
    person.

    A camera that was turned or whose calibration is wrong differs from the others by a steady
    amount; what a camera of another take shows is not related to theirs at all.
    """
    if len(names) < 3:
        return None
    compared = tangency.compare(shifts=shifts)
    view = int(np.nan_to_num(compared.cameras).argmax())
    if not compared.cameras[view] >= config.foreign_cost > compared.without(view) or shifts[view]:
        return None
    own, others = tangency.foreign_motion(view)
    if not (own > config.foreign_motion and own > others + 0.5 * (1 - config.foreign_motion)):
        return None
    text = (
        f"camera {names[view]} shows another motion than the others, which agree, at any lag: its "
        "video is of another take or another person; exchange the file, or leave it out (--cameras)"
    )
    return Fault("foreign", (names[view],), text)


def _describe_exchange(names: list[str], order: list[int]) -> Fault:
    wrong = [view for view, image in enumerate(order) if view != image]
    if len(wrong) == 2:
        a, b = (names[view] for view in wrong)
        text = f"cameras {a} and {b} look exchanged: each one's pictures fit the other's place"
    else:
        moves = [f"those of {names[order[view]]} to {names[view]}" for view in wrong]
        text = f"cameras look exchanged; the pictures would fit so: {join_names(moves)}"
    cameras = tuple(names[view] for view in wrong)
    return Fault("exchange", cameras, f"{text}; rename the files, or the calibration's cameras")


def _describe_flip(names: list[str], way: Way, views: list[int]) -> Fault:
    which = "all cameras" if len(views) == len(names) else f"camera {names[views[0]]}"
    mend = {
        "mirrored": "mirrored, left to right; flip them back",
        "turned": "upside down; turn them, and the background, by 180 degrees",
    }
    text = f"the pictures of {which} are {mend[way]}"
    return Fault(way, tuple(names[view] for view in views), text)


def _describe_lag(sequence: Sequence, name: str, by: int) -> Fault:
    seconds = abs(by) / sequence.fps
    return Fault(
        "late",
        (name,),
        f"camera {name} comes about {abs(by)} frames {'late' if by > 0 else 'early'} "
        f"({seconds:.2g} s); --sync auto shifts it",
        late=by,
    )


def _describe_lens(names: list[str], views: list[int], k1: float) -> Fault:
    if len(views) == len(names):
        text = f"the calibration states no lens distortion, but silhouettes fit with k1 = {k1:g}"
        return Fault("lens", (), f"{text}; write the lenses' distortion into the calibration")
    name = names[views[0]]
    text = (
        f"camera {name} has no lens distortion, and its silhouettes fit with that of the other "
        f"cameras (k1 = {k1:.2g}); write its own into the calibration"
    )
    return Fault("lens", (name,), text)


def _explain_disagreement(
    views: SmallViews, tangency: Tangency, cost: float, known: list[Fault], config: FaultConfig
) -> Fault:
    """Return why no two cameras fit, if an explanation is found."""
    meant = find_convention(views.rig, views.outlines, cost, config)
    if meant:
        text = f"the calibration fits only if {meant}; write it as world to camera, x_cam = R x + t"
        return Fault("convention", (), text)
    poor = _describe_poor_silhouettes(views)
    if poor:
        text = f"the cameras do not agree, and silhouettes are poor: {poor}"
    else:
        text = (
            "the cameras do not agree though each silhouette looks sound "
            f"({cost / CAP:.0%} of the worst): the calibration is not of these pictures, or they "
            "are not of one time"
        )
    return Fault("disagree", (), f"{text}; look at them: psfs info FOLDER --masks FILE.png")


def _describe_poor_silhouettes(views: SmallViews) -> str:
    """Return a text that names the cameras whose silhouettes are no single shape of steady size."""
    poor = []
    for view, camera in enumerate(views.rig):
        pixels = camera.size[0] * camera.size[1]
        areas = np.array([0 if row[view] is None else row[view].area for row in views.outlines])  # type: ignore[union-attr]
        shares = areas / np.maximum(views.foreground[:, view] * pixels, 1)
        if (areas == 0).mean() > 0.3:
            poor.append(f"{camera.name} often shows no person")
        elif np.median(shares) < 0.5:
            poor.append(f"{camera.name}'s are in pieces")
        elif np.median(np.abs(np.diff(areas))) > 0.25 * np.median(areas):
            poor.append(f"{camera.name}'s change from frame to frame")
    return join_names(poor) if poor else ""


def _find_turned_camera(
    tangency: Tangency, names: list[str], known: list[Fault], config: FaultConfig
) -> list[Fault]:
    """Return the camera that fits the others much worse than they fit each other, if turning it
    mends that."""
    compared = tangency.compare()
    if len(names) < 4:
        return []
    rest = np.array([compared.without(view) for view in range(len(names))])
    with np.errstate(invalid="ignore"):
        ratios = np.nan_to_num(compared.cameras / rest)
    view = int(ratios.argmax())
    if any(names[view] in fault.cameras for fault in known):
        return []  # a known fault may be the reason
    if ratios[view] < config.turned_ratio or compared.cameras[view] < config.turned_cost:
        return []
    angle, share = measure_turn(tangency, view)
    turned = share < config.turned_share and _TURNED[0] < angle < _TURNED[1]
    if turned:
        why = (
            f"it was turned by about {math.degrees(angle):.1f} degrees since its calibration, or "
            "that is wrong; calibrate it again"
        )
    else:
        why = "it was moved, or its silhouettes are wrong; look: psfs silhouettes FOLDER -o SIL"
    text = f"camera {names[view]} does not fit the others, which agree: {why}"
    return [Fault("moved", (names[view],), text)]


def _find_unit_fault(sequence: Sequence, size: float) -> list[Fault]:
    """Return the fault of a unit that is wrong by a power of ten, if the person would measure
    `size`, m."""
    if sequence.settings.subject == "object" or not size > 0 or PERSON[0] <= size <= PERSON[1]:
        return []
    power = round(math.log10(1.3 / size))
    now = metres_per_unit(sequence.unit)
    names = {1.0: "m", 0.01: "cm", 0.001: "mm"}
    likely = names.get(float(f"{now * 10.0**power:.6g}"), f"{now * 10.0**power:.3g}")
    wrong, what = f"wrong by {10 ** abs(power):,}", likely
    for metres, name in _IMPERIAL.items():
        own, decimal = size * metres / now, size * 10.0**power
        if _STANDING[0] < own < _STANDING[1] and not _STANDING[0] < decimal < _STANDING[1]:
            wrong, what, likely = "wrong", name, f"{metres:g}"
    return [
        Fault(
            "unit",
            (),
            f"a person would be about {size:.3g} m tall: the unit is {wrong}; it looks like "
            f"{what}: --unit {likely} (or --subject object, if it is no person)",
        )
    ]
