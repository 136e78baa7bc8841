"""Outlines of the person in the pictures of cameras that are not yet calibrated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from cl import Device, NumpyDevice
from psfs.backend import make_evidence_function
from psfs.background.gaussian import Background, estimate_background, median_moments
from psfs.cameras.camera import CameraRig
from psfs.common.numbers import SAMPLES
from psfs.common.pictures import scale_picture
from psfs.common.regions import keep_large_regions
from psfs.diagnostics.small_views import (
    SILHOUETTES,
    Outline,
    Shrink,
    extract_outline,
    find_border_points,
)
from psfs.footage.layouts.common import Footage
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.room_edges import find_edges
from psfs.sequence import Frame

#: Gaps that are closed, and gaps between parts that belong together, as shares of the picture's
#: longest side; least area of such a part, as a share of the largest.
_CLOSED, _NEAR, _PART = 0.012, 0.05, 0.02


def extract_outlines(
    footage: Footage, view: int, empty: Background | None, factor: float,
    device: Device | NumpyDevice, config: PersonConfig,
) -> Iterator[Outline | None]:  # fmt: skip
    """Yield the outline of the person in each of a camera's first pictures. empty: its empty scene,
    see `estimate_empty_scene`. factor: by which the pictures are scaled, at most 1."""
    if footage.masks is not None:
        masks = footage.masks[view]
        for mask in masks.frames(range(min(config.most_frames, masks.count))):
            yield outline_person(scale_picture(mask.max(axis=-1), factor) > 127)
        return
    assert footage.images is not None
    media = footage.images[view]
    shrink = Shrink(CameraRig((footage.rig[view],)), factor)
    evidence_of = make_evidence_function(
        device, shrink.small, shrink.background(empty), SILHOUETTES
    )
    for index, picture in enumerate(media.frames(range(min(config.most_frames, media.count)))):
        yield outline_person(evidence_of(shrink.frame(Frame(index, picture[None], None)))[0] > 0)


def find_empty_edges(empty: Background | None, factor: float) -> np.ndarray:
    """Return the straight edges (N, 2, 2) px of a camera's empty scene, in pictures scaled by
    `factor`; none without it."""
    if empty is None:
        return np.zeros((0, 2, 2))
    picture = np.rint(empty.mean[0]).astype(np.uint8)
    return find_edges(scale_picture(picture, factor))


def estimate_empty_scene(footage: Footage, view: int) -> Background | None:
    """Return the empty scene of a camera: from its own film, else the median of the take; None if
    there are masks alone."""
    if footage.background is not None:
        return estimate_background(CameraRig((footage.rig[view],)), (footage.background[view],))
    if footage.images is None:
        return None
    media = footage.images[view]
    frames = np.stack(list(media.frames(media.spread(SAMPLES))))
    mean, std = median_moments(frames)
    return Background(mean[None], std[None])


def outline_person(mask: np.ndarray) -> Outline | None:
    """Return the outline of the largest silhouette (h, w) bool and of the parts near it.

    A belt or a collar in the colours of the room cuts silhouettes: small gaps are closed, and the
    hull is that of all parts; the contour is the largest part's.
    """
    longest = max(mask.shape)
    closed = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, _disc(_CLOSED * longest))
    whole = extract_outline(closed > 0)
    if whole is None:
        return None
    # Only the pixels that silhouettes reach when they are dilated.
    disc = _disc(_NEAR * longest)
    margin = disc.shape[0]
    x, y, width, height = cv2.boundingRect(closed)
    left, top = max(0, x - margin), max(0, y - margin)
    box = closed[top : y + height + margin, left : x + width + margin]
    groups = cv2.connectedComponents(cv2.dilate(box, disc))[1]
    large = keep_large_regions(box > 0, least=_PART * whole.area)
    x, y = whole.contour[0].astype(int) - (left, top)
    rows, columns = np.nonzero(large & (groups == groups[y, x]))
    pixels = np.stack([left + columns, top + rows], -1).astype(np.int32)
    hull = cv2.convexHull(pixels).reshape(-1, 2)
    points = hull.astype(float)
    return replace(whole, points=points, at_border=find_border_points(points, mask.shape))


def _disc(diameter: float) -> np.ndarray:
    size = 2 * int(diameter / 2) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
