"""A range of frames in small pictures: outlines of the silhouettes, and what the diagnostics
measure in the pictures themselves."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from cl import Device, NumpyDevice
from psfs.backend import make_evidence_pipeline
from psfs.background.chroma_key import ChromaKey
from psfs.background.gaussian import Background, stack_median
from psfs.cameras.camera import CameraRig
from psfs.common.numbers import pick_evenly
from psfs.common.pictures import scale_picture
from psfs.footage.threads import prefetch
from psfs.output.preview import tile_pictures
from psfs.sequence import Frame, Sequence
from psfs.silhouettes.config import AppearanceConfig, FloorConfig, SilhouetteConfig

#: No appearance model is fitted. Shadows on the floor are not searched: in small pictures the
#: floor's cells are too coarse for feet, and of new cameras the floor is not yet known.
SILHOUETTES = SilhouetteConfig(
    appearance=AppearanceConfig(learn=False), floor=FloorConfig(height=-1000.0)
)
#: Least and most consecutive frames that are examined, and most pixels of these.
_FRAMES, _PIXELS = (60, 200), 1.5e9
#: Longest sides of the small pictures, and of the larger ones in which corrections and furniture
#: are found, px.
SMALL_SIDE, LARGE_SIDE = 320, 640
#: Largest change of a grey level by a codec; least area of a silhouette, px.
_CODEC, _LEAST_AREA = 8, 40


@dataclass(frozen=True, eq=False)
class Outline:
    """The convex hull and the contour of a silhouette's largest part.

    points: (N, 2) px. at_border: (N,) bool, whether a point is on the picture's border, beyond
    which the silhouette may go on. area: of the part, px. contour, contour_at_border: the same of
    all points of the part's outer contour, in their order.
    """

    points: np.ndarray
    at_border: np.ndarray
    area: int
    contour: np.ndarray
    contour_at_border: np.ndarray


@dataclass(frozen=True, eq=False)
class SmallViews:
    """Silhouettes and pictures of F consecutive `frames` by the V cameras of `rig`, the sequence's
    rig scaled to small pictures.

    outlines: [frame][view], None without a silhouette. foreground: (F, V) share of the picture.
    gain: (F, V) brightness of the rest of the picture relative to the background's; NaN without a
    background. changes: (F, V) number of pixels that changed since the frame before. backgrounds:
    (V, h, w) uint8 grey background images, or None. samples: numbers of
    the frames (S,) whose silhouettes (S, V, h, w) bool and grey pictures (S, V, h, w) uint8, or
    None, were kept.
    """

    rig: CameraRig
    frames: range
    outlines: list[list[Outline | None]]
    foreground: np.ndarray
    gain: np.ndarray
    changes: np.ndarray
    backgrounds: np.ndarray | None
    samples: np.ndarray
    silhouettes: np.ndarray
    pictures: np.ndarray | None

    @cached_property
    def typical(self) -> np.ndarray:
        """Median (V, h, w) of the samples' pictures; these must not be None."""
        assert self.pictures is not None
        return stack_median(self.pictures)


def compute_ahead(
    frames: Iterable[Frame], begin: Callable[[Frame], Callable[[], np.ndarray]]
) -> Iterator[tuple[Frame, np.ndarray]]:
    """Yield frames with their evidence, while that of the next frame is computed."""
    before: tuple[Frame, Callable[[], np.ndarray]] | None = None
    for frame in frames:
        begun = frame, begin(frame)
        if before is not None:
            yield before[0], before[1]()
        before = begun
    if before is not None:
        yield before[0], before[1]()


def small_views(
    sequence: Sequence, device: Device | NumpyDevice, longest_side: int = SMALL_SIDE,
    frames: range | None = None,
) -> SmallViews:  # fmt: skip
    """Compute the views, in pictures of a longest side, px, of `frames`, by default of some hundred
    in the middle of `sequence`."""
    shrink = Shrink(sequence.rig, sequence.rig.factor_within(longest_side))
    background = shrink.background(sequence.background)
    begin = make_evidence_pipeline(device, shrink.small, background, SILHOUETTES)
    frames = frames or _select_frames(sequence)
    kept_frames = pick_evenly(len(frames))
    backgrounds = None if background is None else _grey(background.mean.astype(np.uint8))

    def measure(view: tuple[np.ndarray | None, np.ndarray]) -> tuple[Any, ...]:
        images, silhouettes = view
        pairs = list(zip(shrink.small, silhouettes, strict=True))
        outlines = [extract_outline(mask[: c.size[1], : c.size[0]]) for c, mask in pairs]
        foreground = [np.count_nonzero(mask) / np.prod(c.size) for c, mask in pairs]
        grey = None if images is None else _grey(images)
        return outlines, foreground, _gains(grey, backgrounds, silhouettes), silhouettes, grey

    rows, changes, masks, pictures = list[list[Any]](), [], [], []
    before: np.ndarray | None = None
    small_frames = shrink.frames(sequence.frames(slice(frames.start, frames.stop)))
    views = ((small.images, counts > 0) for small, counts in compute_ahead(small_frames, begin))
    for number, measured in enumerate(map(measure, views)):
        *row, silhouettes, grey = measured
        rows.append(row)
        now = silhouettes.view(np.uint8) * np.uint8(255) if grey is None else grey
        moved = zip(now, now if before is None else before, strict=True)
        changes.append([np.count_nonzero(cv2.absdiff(*pair) > _CODEC) for pair in moved])
        before = now
        if number in kept_frames:
            masks.append(silhouettes)
            pictures.append(grey)
    outlines, foreground, gains = map(list, zip(*rows, strict=True))
    return SmallViews(
        shrink.small, frames, outlines, np.array(foreground), np.array(gains), np.array(changes),
        backgrounds, kept_frames + frames.start, np.stack(masks),
        None if pictures[0] is None else np.stack(pictures),
    )  # fmt: skip


def draw_contact_sheet(views: SmallViews) -> np.ndarray:
    """Draw a picture (h, w, 3) uint8 BGR: a row per camera with some of its frames, silhouettes in
    green."""
    chosen = pick_evenly(len(views.samples), 6)
    rows = []
    for view in range(len(views.rig)):
        cells = []
        for index in chosen:
            mask = views.silhouettes[index, view]
            grey = np.zeros(mask.shape, np.uint8)
            if views.pictures is not None:
                grey = views.pictures[index, view]
            cell = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
            cell[mask] = cell[mask] // 2 + np.array([0, 127, 0], np.uint8)
            cells.append(cv2.copyMakeBorder(cell, 0, 2, 0, 2, cv2.BORDER_CONSTANT))
        rows.append(cells)
    return tile_pictures(rows)


def _select_frames(sequence: Sequence) -> range:
    """Return the frames in the middle of `sequence`, as many as `_PIXELS` allow."""
    pixels = sum(camera.size[0] * camera.size[1] for camera in sequence.rig)
    count = int(np.clip(_PIXELS / pixels, *_FRAMES))
    first = max(0, (len(sequence) - count) // 2)
    return range(first, min(first + count, len(sequence)))


def extract_outline(mask: np.ndarray) -> Outline | None:
    """Return the outline of a silhouette (h, w) bool after a 3x3 median; None if its largest part
    has fewer than 40 pixels."""
    smooth = cv2.medianBlur(mask.astype(np.uint8), 3)
    x, y, width, height = cv2.boundingRect(smooth)
    if not width:
        return None
    count, labels, facts, _ = cv2.connectedComponentsWithStats(
        smooth[y : y + height, x : x + width], connectivity=8
    )
    areas = facts[1:count, cv2.CC_STAT_AREA]
    if not len(areas) or areas.max() < _LEAST_AREA:
        return None
    largest = 1 + int(areas.argmax())
    region = (labels == largest).view(np.uint8)
    parts, _ = cv2.findContours(region, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(x, y))
    contour = np.asarray(max(parts, key=len))
    corners = cv2.convexHull(contour).reshape(-1, 2).astype(float)
    points = contour.reshape(-1, 2).astype(float)
    borders = [find_border_points(corner_points, mask.shape) for corner_points in (corners, points)]
    return Outline(corners, borders[0], int(areas.max()), points, borders[1])


def mark_hidden_points(
    outlines: list[list[Outline | None]], rig: CameraRig, small: CameraRig
) -> list[list[Outline | None]]:
    """Return the outlines [frame][view] in the pictures of `small` with the points within 4 px
    of the hidden pixels of `rig` marked as points on the picture's border, since the person goes on
    behind furniture."""
    if rig.hidden is None:
        return outlines
    square, wide = np.ones((9, 9), np.uint8), []
    for hidden, camera, other in zip(rig.hidden, rig, small, strict=True):
        whole = hidden[: camera.size[1], : camera.size[0]].view(np.uint8)  # padded, if smaller
        wide.append(cv2.dilate(cv2.resize(whole, other.size), square) > 0)

    def cut(outline: Outline | None, where: np.ndarray) -> Outline | None:
        if outline is None:
            return None
        (x, y), (u, v) = outline.points.astype(int).T, outline.contour.astype(int).T
        return replace(
            outline,
            at_border=outline.at_border | where[y, x],
            contour_at_border=outline.contour_at_border | where[v, u],
        )

    return [[cut(*pair) for pair in zip(row, wide, strict=True)] for row in outlines]


def find_border_points(points: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return which points (N, 2) px are at the border of a picture of `shape`."""
    return np.asarray(find_reached_edges(points, shape[::-1]).any(axis=1))


def find_reached_edges(points: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """Return which edges (N, 4) of a picture of `size` points (N, 2) px are at: left, top, right,
    bottom."""
    return np.concatenate([points <= 1, points >= np.array(size) - 2], axis=1)


class Shrink:
    """Scaling of a sequence's pictures, rig and background by a factor, at most 1."""

    def __init__(self, rig: CameraRig, factor: float) -> None:
        self.rig, self._factor = rig, factor
        self.small = rig.scaled(factor) if factor < 1 else rig

    def __call__(self, pictures: np.ndarray) -> np.ndarray:
        """Return small pictures (V, h, w, ...) of pictures (V, H, W, ...): means over areas; zeros
        beside those that are smaller than others."""
        if self._factor == 1:
            return pictures
        size = self.small.height, self.small.width
        out = np.zeros((len(self.rig), *size, *pictures.shape[3:]), pictures.dtype)
        for picture, small in zip(self.rig.crop(pictures), self.small.crop(out), strict=True):
            small[...] = scale_picture(picture, self._factor)
        return out

    def frame(self, frame: Frame) -> Frame:
        images = None if frame.images is None else self(frame.images)
        masks = None if frame.masks is None else self(frame.masks)
        return replace(frame, images=images, masks=masks)

    def frames(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """Yield small frames, which another thread scales ahead of the caller."""
        return prefetch((self.frame(frame) for frame in frames), depth=4)

    def background(self, background: Background | None) -> Background | None:
        """Return the small background. Its noise is assumed as large as in the full pictures, since
        much of it comes from the compression and spans many pixels."""
        if background is None or self._factor == 1:
            return background
        mean, std = (
            self(np.ascontiguousarray(background.mean)),
            self(np.ascontiguousarray(background.std)),
        )
        if isinstance(background, ChromaKey):
            of_screen = background.key, background.spread, background.light
            return ChromaKey(mean, std, *of_screen, (self(background.screen) > 0).astype(np.uint8))
        return Background(mean, np.maximum(std, background.std.min()))


def _grey(pictures: np.ndarray) -> np.ndarray:
    """Return grey pictures (V, h, w) uint8 of pictures (V, h, w, 3)."""
    grey = np.empty(pictures.shape[:3], np.uint8)
    for picture, into in zip(pictures, grey, strict=True):
        cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY, into)
    return grey


def _gains(
    grey: np.ndarray | None, backgrounds: np.ndarray | None, silhouettes: np.ndarray
) -> list[float]:
    """Return the brightness of each view relative to its background, outside the silhouettes."""
    if grey is None or backgrounds is None:
        return [float("nan")] * len(silhouettes)
    rest = silhouettes.view(np.uint8) - np.uint8(1)  # 255 outside the silhouettes
    sums = [
        [cv2.sumElems(cv2.bitwise_and(image, there))[0] for image in (picture, background)]
        for picture, background, there in zip(grey, backgrounds, rest, strict=True)
    ]
    return [image / there if there else float("nan") for image, there in sums]
