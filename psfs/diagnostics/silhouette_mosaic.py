"""Mosaics of each camera's picture, silhouette likelihood and silhouette."""

from __future__ import annotations

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.common.regions import bounding_box
from psfs.diagnostics.silhouette_scores import Silhouettes
from psfs.output.preview import crop_view

#: Width and height of a panel, and of the title above it, px.
_PANEL, _TITLE = (480, 480), 24
_DARKENED = 0.35  # brightness of the picture below the differences
_MISSED, _EXTRA = (40, 40, 255), (40, 255, 40)  # BGR
_GAP = 4  # px between panels
_GROUND = 60  # grey level between and behind the panels

_Part = tuple[slice, slice]


def draw_mosaic(rig: CameraRig, shown: Silhouettes) -> np.ndarray:
    """Draw (h, w, 3) uint8 BGR: a row per camera with the picture, the likelihood (black 0, white
    1), the silhouette and, if a true mask is known, the differences between the two."""
    parts = [_part(camera, view, shown) for view, camera in enumerate(rig)]
    widest = max(_size(part)[0] for part in parts)
    rows = [_row(camera, view, shown, parts[view], widest) for view, camera in enumerate(rig)]
    width = max(row.shape[1] for row in rows)
    padded = [np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0))) for row in rows]
    return np.vstack(padded)


def draw_differences(picture: np.ndarray, mask: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return the darkened `picture` (h, w, 3): pixels of `truth` that `mask` (h, w) bool misses are
    red, pixels of `mask` outside `truth` are green."""
    drawn: np.ndarray = (picture * _DARKENED).astype(np.uint8)
    drawn[truth & mask] = picture[truth & mask]
    drawn[truth & ~mask] = _MISSED
    drawn[mask & ~truth] = _EXTRA
    return drawn


def _row(camera: Camera, view: int, shown: Silhouettes, part: _Part, width: int) -> np.ndarray:
    """Draw one view's panels, `width` px wide each."""
    truth, score = shown.truth[view], shown.scores[view, 0]
    picture = crop_view(shown.frame, view, camera)[part]
    likelihood, mask = shown.likelihood[view][part], shown.masks[view][part]
    panels = [picture, _grey(255 * likelihood), _grey(255 * mask)]
    texts = [f"{camera.name}, frame {shown.frame.index}", "likelihood", "silhouette"]
    if truth is not None:
        panels.append(draw_differences(picture, mask, truth[part]))
        known = "true mask empty" if np.isnan(score) else f"IoU {score:.3f}"
        texts.append(f"{known}: missed red, too much green")
    sized = [_fit(panel, _size(part)) for panel in panels]
    return np.hstack([_add_label(*of, width) for of in zip(sized, texts, strict=True)])


def _part(camera: Camera, view: int, shown: Silhouettes) -> _Part:
    """Return rows and columns of the picture that look into the volume or belong to the true mask;
    all if there are none."""
    region, truth = shown.region[view], shown.truth[view]
    if truth is not None:
        region = region | truth
    width, height = camera.size
    return bounding_box(region) or (slice(0, height), slice(0, width))


def _size(part: _Part) -> tuple[int, int]:
    """Return width and height of a part enlarged or reduced to fit into `_PANEL`."""
    height, width = (of.stop - of.start for of in part)
    scale = min(_PANEL[0] / width, _PANEL[1] / height)
    return max(1, round(width * scale)), max(1, round(height * scale))


def _fit(panel: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    # Enlarged pixels stay square, so that each can be seen.
    how = cv2.INTER_AREA if size[0] < panel.shape[1] else cv2.INTER_NEAREST
    return cv2.resize(panel, size, interpolation=how)


def _grey(values: np.ndarray) -> np.ndarray:
    """Return values (h, w) of 0..255 as a picture (h, w, 3) uint8."""
    grey = np.clip(np.rint(values), 0, 255).astype(np.uint8)
    return cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)


def _add_label(panel: np.ndarray, text: str, width: int) -> np.ndarray:
    """Return the panel on a ground of `width` px, with `text` above it."""
    height = panel.shape[0]
    drawn = np.full((height + _TITLE + _GAP, width + _GAP, 3), _GROUND, np.uint8)
    drawn[_TITLE : _TITLE + height, : panel.shape[1]] = panel
    at, font = (6, _TITLE - 7), cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(drawn, text, at, font, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return drawn
