"""Faults that the pictures of one camera show by themselves, or beside their background."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product

import cv2
import numpy as np

from psfs.background.gaussian import STD_FLOOR
from psfs.cameras.names import join_names
from psfs.common.numbers import find_true_runs
from psfs.diagnostics.fault import Evidence, Fault, significant
from psfs.diagnostics.person_in_view import find_person_in_views
from psfs.volume import describe_expected_person

#: Share of a picture that a person fills at most.
_FILLED = 0.5
#: Correlation of a picture with another of the same view; pictures of other views are below half.
_SAME_VIEW = 0.85
#: Greatest shift between pictures and background that a shaking tripod explains, small pixels, and
#: the gain of the edges' correlation if the shift is undone.
_SHAKING, _GAIN = 2.0, 0.1
#: How many times stronger edges in the background are than in the pictures around what only the
#: background shows.
_STRONGER = 1.5
#: Share of the frames that show what is steady, and of the silhouette's area that is a person.
_STEADY, _LARGE = 0.6, 0.15
#: Change of the light from frame to frame above which it flickers; pictures' noise is a third.
_FLICKER = 0.03
#: Share of an expected silhouette that must have moved while a picture stands still.
_MOVED = 0.3


def find_empty(evidence: Evidence) -> Iterator[Fault]:
    """Yield pictures that show no person: of one brightness, foreground all over, or nobody in any.

    Statistic: the pictures' deviation beside a sensor's noise; the median share of foreground;
    outlines in two other cameras and none in this one. If the background comes from the take
    itself, such foreground says that the take does not show it.
    """
    views, sequence = evidence.views, evidence.sequence
    shares = np.median(views.foreground, axis=0)
    seen = np.array([[outline is not None for outline in row] for row in views.outlines])
    hidden = list[str]()
    for view, (camera, name) in enumerate(zip(evidence.rig, evidence.names, strict=True)):
        width, height = camera.size
        if views.pictures is not None and (views.typical[view, :height, :width].std() < STD_FLOOR):
            text = (
                f"camera {name}: its pictures are of one brightness and show nothing; was its "
                "lens covered, or its signal lost? Leave it out (--cameras)"
            )
            yield Fault("empty", (name,), text, spoils=True)
        elif shares[view] > _FILLED and _judges_silhouettes(evidence):
            if not sequence.empty_scene and sequence.background_kind == "frames":
                hidden.append(name)
                continue
            why = "noise, changed light, or a background that is not this camera's?"
            if sequence.background_kind == "masks":
                why = "are its masks' black and white exchanged? Expected 255 for the person"
            text = f"camera {name}: {shares[view]:.0%} of its picture looks like foreground"
            yield Fault("empty", (name,), f"{text}; {why}", spoils=True)
        elif seen.any(0).sum() >= 2 and not seen[:, view].any():
            text = (
                f"camera {name} shows nobody in {len(views.frames)} frames, others do; is it "
                "turned elsewhere, or does furniture stand before it?"
            )
            yield Fault("empty", (name,), text, spoils=True)
    if hidden:
        number = len(views.frames)
        shots = "one picture" if number == 1 else f"{number} pictures"
        text = (
            f"{shots} of {'camera' if len(hidden) == 1 else 'cameras'} {join_names(hidden)} cannot "
            "say what the room looks like without the person, so there is no silhouette: film the "
            "empty room (a folder background), add masks, or track keypoints alone (--keypoints "
            "FILE --objective keypoints)"
        )
        yield Fault("empty", tuple(hidden), text, spoils=True)
    if not seen.any() and not hidden:
        text = (
            f"nothing stands out from the background in {len(views.frames)} frames; expected "
            f"{describe_expected_person(sequence)}"
        )
        # The reconstruction itself stops if no frame shows a person.
        yield Fault("empty", (), text, serious=False)


def _judges_silhouettes(evidence: Evidence) -> bool:
    """Return whether a silhouette that fills its picture is wrong; an object may fill it."""
    if evidence.sequence.background_kind == "masks":
        return evidence.sequence.subject == "person"
    return evidence.views.backgrounds is not None


def find_repeated(evidence: Evidence) -> Iterator[Fault]:
    """Yield pictures of a camera that repeat: those of another camera, or its own while its view
    changes.

    Statistic: equality to the bit of two cameras; the longest stretch of frames in which no pixel
    changes by more than a codec's noise, and by how much the hull of the other cameras moves in
    this camera's picture meanwhile. Who is elsewhere or stands still moves nothing there.
    """
    views, names = evidence.views, evidence.names
    if views.pictures is not None:
        for a, b in combinations(evidence.sound, 2):
            if (views.pictures[:, a] == views.pictures[:, b]).all():
                text = (
                    f"cameras {names[a]} and {names[b]} show the very same pictures; one is a "
                    "copy of the other's: leave it out (--cameras)"
                )
                yield Fault("repeats", (names[a], names[b]), text)
    if len(evidence.sound) < 3:
        return
    for view in evidence.sound:
        still = views.changes[1:, view] == 0
        runs = [slice(run.start, run.stop + 1) for run in find_true_runs(still)]
        hang = max(runs, key=lambda run: run.stop - run.start, default=slice(0, 0))
        if _measure_motion(evidence, view, hang) > _MOVED:
            first, last = views.frames[hang.start], views.frames[hang.stop - 1]
            where = f"frames {first} to {last}"
            if hang.stop - hang.start == len(views.frames):
                where = "all frames"
            text = (
                f"camera {names[view]} shows the same picture in {where}, while the others "
                "see motion in its view; its recording hangs: leave it out (--cameras)"
            )
            yield Fault("repeats", (names[view],), text)


def _measure_motion(evidence: Evidence, view: int, hang: slice) -> float:
    """Return the share of the hull of the other cameras that changes in a camera's picture
    during a stretch of frames: the least of its halves, since somebody who passes once tells
    little. It is multiplied by the share of that hull that the camera shows in all other frames:
    furniture may stand before it."""
    agreement = evidence.agreement
    numbers = evidence.views.samples[agreement.samples] - evidence.views.frames.start
    within = (numbers >= hang.start) & (numbers < hang.stop)
    if within.sum() < 3:
        return 0.0
    expected = [agreement.expect(k, view, evidence.sound) for k in range(len(numbers))]
    inside = np.flatnonzero(within)
    ends = [expected[k] for k in (inside[0], inside[len(inside) // 2], inside[-1])]
    if not all(end.any() for end in ends):
        return 0.0
    moves = [(a ^ b).sum() / (a | b).sum() for a, b in combinations(ends, 2)]
    seen_shares = [
        (hull & (agreement.masks[k, view] > 0)).sum() / hull.sum()
        for k, hull in enumerate(expected) if not within[k] and hull.any()
    ]  # fmt: skip
    return float(max(moves) * (np.mean(seen_shares) if seen_shares else 1.0))


def find_wrong_background(evidence: Evidence) -> Iterator[Fault]:
    """Yield a background that is not that of the pictures: of another view, flipped, shifted since
    the camera was knocked, or with a person in it.

    Statistics: the correlation of the typical picture with the background; the shift of the edges
    by phase correlation; the ratio of the edges around what stays foreground, in the background
    and in each picture, by a t test.
    """
    if evidence.views.pictures is None or evidence.views.backgrounds is None:
        return
    if evidence.sequence.footage.background:
        yield from _find_other_views(evidence)
    for view in evidence.sound:
        text = _find_knock(evidence, view) or _find_person(evidence, view)
        if text:
            name = evidence.names[view]
            yield Fault("background", (name,), f"camera {name}: {text}")


def _find_other_views(evidence: Evidence) -> Iterator[Fault]:
    """Find cameras whose pictures and background show different views; exchanged ones come in
    pairs."""
    views, names = evidence.views, evidence.names
    alike = np.full((len(names), len(names)), -1.0)
    for a, b in product(evidence.sound, repeat=2):
        if views.rig[a].size == views.rig[b].size:
            alike[a, b] = _correlate(_crop(evidence, views.typical, a), _backdrop(evidence, b))
    for view in evidence.sound:
        name, fit, best = names[view], alike[view, view], int(alike[view].argmax())
        picture, background = _crop(evidence, views.typical, view), _backdrop(evidence, view)
        flips = {"mirrored": picture[:, ::-1], "upside down": picture[::-1, ::-1]}
        flipped = {flip: _correlate(other, background) for flip, other in flips.items()}
        flip = max(flipped, key=flipped.__getitem__)
        if flipped[flip] > max(_SAME_VIEW, fit + _GAIN):
            text = f"its pictures are {flip} relative to its background; turn those that are wrong"
        elif fit >= _SAME_VIEW / 2:
            continue
        elif alike[view, best] > _SAME_VIEW:
            mutual = bool(alike[best].argmax() == view)
            if not (mutual and best < view):  # reported with the first of the two
                text = (
                    f"cameras {name} and {names[best]} look exchanged: the pictures of {name} show "
                    f"what the background of {names[best]} shows; exchange the files"
                )
                yield Fault("exchange", (name, names[best]) if mutual else (name,), text)
            continue
        else:
            text = (
                f"its pictures and its background show different views (correlation {fit:.2f}, "
                f"expected above {_SAME_VIEW / 2:.2f}); film the empty scene again, or take "
                "--background frames"
            )
        yield Fault("background", (name,), f"camera {name}: {text}")


def _crop(evidence: Evidence, pictures: np.ndarray, view: int) -> np.ndarray:
    """Return the pictures (..., h, w) of one camera of all (..., V, H, W)."""
    width, height = evidence.rig[view].size
    return pictures[..., view, :height, :width]


def _backdrop(evidence: Evidence, view: int) -> np.ndarray:
    assert evidence.views.backgrounds is not None
    return _crop(evidence, evidence.views.backgrounds, view)


def _correlate(a: np.ndarray, b: np.ndarray) -> float:
    x, y = (image.astype(np.float32).ravel() - np.float32(image.mean()) for image in (a, b))
    aa, ab, bb = (np.einsum("i,i", *pair) for pair in ((x, x), (x, y), (y, y)))
    return float(ab / np.sqrt(aa * bb)) if aa and bb else 0.0


def _find_knock(evidence: Evidence, view: int) -> str:
    """Return what to say of a camera whose background lies beside its pictures in some frames."""
    views, picture = evidence.views, _backdrop(evidence, view)
    assert views.pictures is not None
    background = _edges(picture)
    window = cv2.createHanningWindow(evidence.rig[view].size, cv2.CV_32F)
    moves = []
    for image, mask in zip(
        _crop(evidence, views.pictures, view), _crop(evidence, views.silhouettes, view), strict=True
    ):
        people = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((7, 7), np.uint8))
        moves.append(_measure_shift(background, _edges(np.where(people, picture, image)), window))
    moved = np.array(moves)
    away = np.linalg.norm(moved, axis=1) > _SHAKING
    typical = np.median(moved[away], axis=0) if away.any() else np.zeros(2)
    away &= np.linalg.norm(moved - typical, axis=1) < _SHAKING  # noise has no direction
    if away.sum() <= max(2, 0.1 * len(moved)):
        return ""
    pixels = evidence.sequence.rig.width / views.rig.width * float(np.linalg.norm(typical))
    first = int(views.samples[int(away.argmax())])
    since = "" if away.all() else f" from about frame {first} on"
    return (
        f"its background is {pixels:.0f} px off its pictures{since}; it was moved: leave it out "
        "(--cameras), or film and calibrate again"
    )


def _measure_shift(
    background: np.ndarray, edges: np.ndarray, window: np.ndarray
) -> tuple[float, float]:
    """Return the shift (x, y), px, of the `edges` (h, w) in the picture from those of the
    background; (0, 0) if they do not correlate better when shifted back."""
    as_is = _correlate(background, edges)
    if as_is >= 1 - _GAIN:  # a correlation is at most 1
        return 0.0, 0.0
    shift, _ = cv2.phaseCorrelate(background.copy(), edges.copy(), window)  # windows its arguments
    back = [-round(s) for s in shift[::-1]]
    laid_back = _correlate(background, np.roll(edges, back, axis=(0, 1)))
    return (shift[0], shift[1]) if laid_back > as_is + _GAIN else (0.0, 0.0)


def _edges(picture: np.ndarray) -> np.ndarray:
    """Return the strength of the edges (h, w) float32."""
    grey = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 1.0)
    return cv2.magnitude(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))


def _find_person(evidence: Evidence, view: int) -> str:
    """Return what to say of a camera whose background contains a person who is not in the pictures:
    foreground in one place in most frames, with edges around it in the background only."""
    views = evidence.views
    assert views.pictures is not None
    masks = _crop(evidence, views.silhouettes, view)
    outlines = [row[view] for row in views.outlines]
    areas = [outline.area for outline in outlines if outline is not None]
    usual = float(np.median(areas)) if areas else np.inf
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    steady = cv2.morphologyEx((masks.mean(0) >= _STEADY).astype(np.uint8), cv2.MORPH_OPEN, cross)
    count, labels, facts, _ = cv2.connectedComponentsWithStats(steady, connectivity=4)
    background = _edges(_backdrop(evidence, view))
    pictures = [_edges(picture) for picture in _crop(evidence, views.pictures, view)]
    for region in range(1, count):
        if facts[region, cv2.CC_STAT_AREA] < _LARGE * usual:
            continue
        inside = (labels == region).astype(np.uint8)
        rim = cv2.dilate(inside, cross, iterations=2) > cv2.erode(inside, cross)
        there = float(background[rim].mean())
        ratios = np.array([there / max(float(edges[rim].mean()), 1e-6) for edges in pictures])
        if significant(np.log(ratios), np.log(_STRONGER)):
            holds = "its background contains a person who is not in the pictures"
            if not evidence.sequence.footage.background:
                holds = (
                    "the background estimated from its pictures contains a person who stands still "
                    "in many"
                )
            return (
                f"{holds} (its edges are {np.median(ratios):.1f} times as strong there); film the "
                "scene empty, or take --background mog"
            )
    return ""


def find_flicker(evidence: Evidence) -> Iterator[Fault]:
    """Yield light that changes from frame to frame. Statistic: the change of the brightness outside
    the silhouettes, by a t test."""
    for view in evidence.sound:
        changes = np.abs(np.diff(evidence.views.gain[:, view]))
        typical = np.minimum(changes, 2 * np.median(changes))  # one lamp that is switched on
        if significant(typical, _FLICKER):
            name = evidence.names[view]
            text = (
                f"camera {name} flickers: its brightness changes by {typical.mean():.0%} from "
                "frame to frame; fix exposure and gain, match the shutter to the lamps"
            )
            yield Fault("flicker", (name,), text)


def find_cut(evidence: Evidence) -> Iterator[Fault]:
    """Yield a note on cameras beyond whose pictures the person reaches in most frames."""
    persons = find_person_in_views(evidence.rig, evidence.views.outlines, scale=1.0)
    views = [persons[view] for view in evidence.sound]
    cut = [view.camera for view in views if view.edge and view.whole < 0.5]
    if cut:
        text = (
            f"what is filmed reaches beyond the pictures of {join_names(cut)} in most frames; "
            "parts that too few cameras see are not reconstructed"
        )
        yield Fault("cut", tuple(cut), text, serious=False)
