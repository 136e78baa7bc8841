"""Faults that one camera's pictures show by themselves.

The background is another camera's or contains the person, the camera was knocked, the light
flickers, or the person is cut off by the picture's border.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import cv2
import numpy as np

from psfs.cameras.names import join_names
from psfs.diagnostics.fault import Fault
from psfs.diagnostics.frozen import find_frozen_cameras
from psfs.diagnostics.picture_config import PictureConfig
from psfs.diagnostics.small_views import SmallViews
from psfs.sequence import Sequence
from psfs.volume import describe_expected_person

#: Width, px, of the surroundings of a region that affect the edges on its rim.
_REACH = 8
_CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


def find_picture_faults(
    sequence: Sequence, views: SmallViews, config: PictureConfig | None = None
) -> list[Fault]:
    """Return the faults of the pictures of a sequence, the serious ones first."""
    config = config or PictureConfig()
    faults = [*_find_empty_pictures(sequence, views, config)]
    if any(not fault.cameras for fault in faults):
        return faults
    named = {name for fault in faults for name in fault.cameras}
    for check in (
        _find_identical,
        _find_foreign_backgrounds,
        _find_filled,
        find_frozen_cameras,
        _find_moved_cameras,
        _find_ghosts,
        _find_flicker,
    ):
        for fault in check(sequence, views, config):
            if not named & set(fault.cameras):
                faults.append(fault)
                named |= set(fault.cameras)
    return [*faults, *_find_cut(sequence, views, config)]


def _find_empty_pictures(
    sequence: Sequence, views: SmallViews, config: PictureConfig
) -> Iterator[Fault]:
    """Find footage without any person, and cameras whose pictures show nothing."""
    blank = list(_find_blank(sequence, views, config))
    yield from blank
    if not blank and not any(outline for row in views.outlines for outline in row):
        yield Fault(
            "nobody",
            (),
            f"nothing stands out from the background in {len(views.frames)} frames; expected "
            f"{describe_expected_person(sequence)}",
            serious=False,  # the reconstruction itself stops if no frame shows a person
        )


def _find_blank(sequence: Sequence, views: SmallViews, config: PictureConfig) -> Iterator[Fault]:
    """Find cameras whose pictures are of one brightness."""
    if views.pictures is None:
        return
    for camera, small, picture in zip(sequence.rig, views.rig, views.typical, strict=True):
        if picture[: small.size[1], : small.size[0]].std() < config.blank:
            yield Fault(
                "blank",
                (camera.name,),
                f"camera {camera.name}: its pictures are of one brightness and show nothing; was "
                "its lens covered, or its signal lost? Leave it out (--cameras)",
            )


def _find_identical(
    sequence: Sequence, views: SmallViews, config: PictureConfig
) -> Iterator[Fault]:
    """Find cameras that show identical pictures."""
    if views.pictures is None:
        return
    for a, b in combinations(range(len(views.rig)), 2):
        if (views.pictures[:, a] == views.pictures[:, b]).all():
            names = sequence.rig.names[a], sequence.rig.names[b]
            yield Fault(
                "same",
                names,
                f"cameras {names[0]} and {names[1]} show the very same pictures; one is a copy of "
                "the other's: leave it out (--cameras)",
            )


def _find_foreign_backgrounds(
    sequence: Sequence, views: SmallViews, config: PictureConfig
) -> Iterator[Fault]:
    """Find cameras whose pictures and background show different views; exchanged ones come in
    pairs."""
    if views.pictures is None or views.backgrounds is None or not sequence.footage.background:
        return
    names, sizes = sequence.rig.names, [camera.size for camera in views.rig]
    alike = np.full((len(names), len(names)), -1.0)
    for a, size in enumerate(sizes):
        for b, background in enumerate(views.backgrounds):
            if sizes[b] == size:
                area = np.s_[: size[1], : size[0]]
                alike[a, b] = _correlation(views.typical[a][area], background[area])
    own = np.diag(alike)
    over = {view: _find_flip(views, view, own[view], config) for view in range(len(names))}
    wrong = [view for view in range(len(names)) if own[view] < config.other_view and not over[view]]
    for view, way in over.items():
        if way:
            yield Fault(
                "background",
                (names[view],),
                f"camera {names[view]}: its pictures are {way} relative to its background; turn "
                "those that are wrong",
            )
    for view in wrong:
        fits = int(alike[view].argmax())
        if alike[view, fits] > config.same_view and fits != view:
            if alike[fits].argmax() == view and fits < view:
                continue  # reported with the first of the two
            both = names[view], names[fits]
            yield Fault(
                "exchange",
                both if alike[fits].argmax() == view else both[:1],
                f"cameras {both[0]} and {both[1]} look exchanged: the pictures of {both[0]} show "
                f"what the background of {both[1]} shows; exchange the files",
            )
        else:
            yield Fault(
                "background",
                (names[view],),
                f"camera {names[view]}: its pictures and its background show different views; "
                "film the empty scene again, or take --background frames",
            )


def _find_flip(views: SmallViews, view: int, own: float, config: PictureConfig) -> str:
    """Return the orientation in which a camera's pictures match its background, if they match only
    when turned over. own: correlation of the pictures as they are."""
    assert views.backgrounds is not None
    width, height = views.rig[view].size
    picture, background = (
        shown[view][:height, :width] for shown in (views.typical, views.backgrounds)
    )
    ways = {"mirrored": picture[:, ::-1], "upside down": picture[::-1, ::-1]}
    for way, turned in ways.items():
        alike = _correlation(turned, background)
        if alike > config.same_view and alike > own + config.gain:
            return way
    return ""


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    x, y = (image.astype(np.float32).ravel() - np.float32(image.mean()) for image in (a, b))
    aa, ab, bb = (np.einsum("i,i", *pair) for pair in ((x, x), (x, y), (y, y)))
    return float(ab / np.sqrt(aa * bb)) if aa and bb else 0.0


def _find_moved_cameras(
    sequence: Sequence, views: SmallViews, config: PictureConfig
) -> Iterator[Fault]:
    """Find cameras whose background is misaligned with the pictures in some of the frames."""
    if views.pictures is None or views.backgrounds is None:
        return
    factor = sequence.rig.width / views.rig.width
    for view, camera in enumerate(views.rig):
        area = np.s_[: camera.size[1], : camera.size[0]]
        window = cv2.createHanningWindow(camera.size, cv2.CV_32F)
        background = _edges(views.backgrounds[view][area])
        moves = []
        for picture, mask in zip(views.pictures[:, view], views.silhouettes[:, view], strict=True):
            people = cv2.morphologyEx(
                mask[area].astype(np.uint8), cv2.MORPH_OPEN, np.ones((7, 7), np.uint8)
            )
            shown = _edges(np.where(people > 0, views.backgrounds[view][area], picture[area]))
            moves.append(_measure_shift(background, shown, window, config))
        moved = np.array(moves)
        away = np.linalg.norm(moved, axis=1) > config.knocked
        typical = np.median(moved[away], axis=0) if away.any() else np.zeros(2)
        away &= np.linalg.norm(moved - typical, axis=1) < config.knocked  # noise has no direction
        if away.sum() > max(2, 0.1 * len(moved)):
            pixels = factor * float(np.linalg.norm(typical))
            first = int(views.samples[int(away.argmax())])
            since = "" if away.all() else f" from about frame {first} on"
            yield Fault(
                "knocked",
                (camera.name,),
                f"camera {camera.name}: its background is {pixels:.0f} px off its pictures"
                f"{since}; it was moved: leave it out (--cameras), or film and calibrate again",
            )


def _measure_shift(
    background: np.ndarray, shown: np.ndarray, window: np.ndarray, config: PictureConfig
) -> tuple[float, float]:
    """Return the shift (x, y), px, of the edges (h, w) in the picture, `shown`, from those of the
    background; (0, 0) if they do not correlate better when shifted back."""
    as_is = _correlation(background, shown)
    if as_is >= 1 - config.gain:  # a correlation is at most 1
        return 0.0, 0.0
    shift, _ = cv2.phaseCorrelate(background, shown, window)
    back = [-round(s) for s in shift[::-1]]
    if not any(back):
        return 0.0, 0.0
    laid_back = _correlation(background, np.roll(shown, back, axis=(0, 1)))
    return (shift[0], shift[1]) if laid_back > as_is + config.gain else (0.0, 0.0)


def _edges(picture: np.ndarray) -> np.ndarray:
    """Return the strength of the edges (h, w) float32."""
    grey = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 1.0)
    return cv2.magnitude(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))


def _find_filled(sequence: Sequence, views: SmallViews, config: PictureConfig) -> Iterator[Fault]:
    why = "noise, changed light, or a background that is not this camera's?"
    if sequence.background_kind == "masks" and sequence.subject == "person":
        why = "are its masks' black and white exchanged? Expected 255 where the person is"
    elif views.backgrounds is None:
        return
    for name, share in zip(sequence.rig.names, np.median(views.foreground, axis=0), strict=True):
        if share > config.filled:
            text = f"camera {name}: {share:.0%} of its picture looks like foreground; {why}"
            yield Fault("filled", (name,), text)


def _find_ghosts(sequence: Sequence, views: SmallViews, config: PictureConfig) -> Iterator[Fault]:
    """Find cameras whose background contains a person.

    Such foreground has edges around it in the background and none in the pictures. It is in one
    place in most frames, or apart from the person in some.
    """
    if views.pictures is None or views.backgrounds is None or len(views.samples) < 4:
        return
    estimated = not sequence.footage.background
    for view, camera in enumerate(views.rig):
        areas = [row[view].area for row in views.outlines if row[view] is not None]  # type: ignore[union-attr]
        background = views.backgrounds[view, : camera.size[1], : camera.size[0]]
        silhouettes = views.silhouettes[:, view, : camera.size[1], : camera.size[0]]
        pictures = views.pictures[:, view, : camera.size[1], : camera.size[0]]
        usual = float(np.median(areas)) if areas else np.inf
        typical = views.typical[view, : camera.size[1], : camera.size[0]]
        if _has_ghost(background, silhouettes, pictures, typical, usual, config):
            holds = (
                "the background estimated from its pictures contains a person who stands "
                "still in many"
                if estimated
                else "its background contains a person who is not in the pictures"
            )
            yield Fault(
                "ghost",
                (camera.name,),
                f"camera {camera.name}: {holds}; film the scene empty, or take --background mog",
            )


def _has_ghost(
    background: np.ndarray,
    silhouettes: np.ndarray,
    pictures: np.ndarray,
    typical: np.ndarray,
    usual: float,
    config: PictureConfig,
) -> bool:
    """Return whether a background (h, w) contains a person who is absent from the pictures (S, h,
    w).

    typical: median of the pictures. usual: median area of a silhouette, px.
    """
    steady = silhouettes.mean(axis=0) >= config.steady
    apart = np.abs(pictures[:, steady] - typical[steady])
    steady[steady] = np.median(apart, axis=0) < config.still
    there = _edges(background)
    if max(_rim_ratios(steady, there, typical, config.ghost_area * usual)) > config.ghost_edges:
        return True
    least = 2 * config.ghost_area * usual
    of_frames = [
        max(_rim_ratios(silhouette, there, picture, least))
        for silhouette, picture in zip(silhouettes, pictures, strict=True)
    ]
    clear, likely = np.max(of_frames), np.sum(np.array(of_frames) > config.ghost_seen)
    return bool(clear > config.ghost_edges or likely > 1)


def _rim_ratios(
    region: np.ndarray, there: np.ndarray, shown: np.ndarray, least: float
) -> list[float]:
    """Return, for each part of a region (h, w) bool with `least` pixels or more, how many times
    stronger the edges around it are in the background, `there` (h, w), than in the picture, `shown`
    (h, w); 0 without any part."""
    x, y, width, height = cv2.boundingRect(region.view(np.uint8))
    near = np.s_[max(0, y - _REACH) : y + height + _REACH, max(0, x - _REACH) : x + width + _REACH]
    region, there, shown = region[near], there[near], shown[near]
    opened = _dilate(_erode(region.astype(np.uint8)))
    count, labels, facts, _ = cv2.connectedComponentsWithStats(opened, connectivity=4)
    ratios, edges = [0.0], None
    for part in range(1, count):
        if facts[part, cv2.CC_STAT_AREA] >= least:
            inside = (labels == part).astype(np.uint8)
            edges = _edges(shown) if edges is None else edges
            rim = _dilate(inside, 2) > _erode(inside)
            ratios.append(float(there[rim].mean() / max(edges[rim].mean(), 1e-6)))
    return ratios


def _erode(region: np.ndarray) -> np.ndarray:
    """Return a region (h, w) uint8 without its outermost pixels; pixels beyond the picture count as
    outside."""
    return cv2.erode(region, _CROSS, borderType=cv2.BORDER_CONSTANT, borderValue=0)


def _dilate(region: np.ndarray, times: int = 1) -> np.ndarray:
    return cv2.dilate(region, _CROSS, iterations=times)


def _find_flicker(sequence: Sequence, views: SmallViews, config: PictureConfig) -> Iterator[Fault]:
    if len(views.gain) < 4 or np.isnan(views.gain).any():
        return
    changes = np.abs(np.diff(views.gain, axis=0))
    for name, change in zip(sequence.rig.names, np.median(changes, axis=0), strict=True):
        if change > config.flicker:
            yield Fault(
                "flicker",
                (name,),
                f"camera {name} flickers: its brightness changes by {change:.0%} from frame to "
                "frame; fix exposure and gain, match the shutter to the lamps",
            )


def _find_cut(sequence: Sequence, views: SmallViews, config: PictureConfig) -> Iterator[Fault]:
    cut = []
    for view, name in enumerate(sequence.rig.names):
        shown = [row[view].at_border.any() for row in views.outlines if row[view] is not None]  # type: ignore[union-attr]
        if shown and np.mean(shown) > config.cut:
            cut.append(name)
    if cut:
        yield Fault(
            "cut",
            tuple(cut),
            f"what is filmed reaches beyond the pictures of {join_names(cut)} in most frames; "
            "parts that too few cameras see are not reconstructed",
            serious=False,
        )
