"""Detection of a person in a background that was estimated from frames, by GrabCut where something
moved."""

from __future__ import annotations

import cv2
import numpy as np

from psfs.background.estimation_config import TakeConfig


def moving_region(frames: np.ndarray, config: TakeConfig) -> np.ndarray:
    """Return (h, w) bool: the pixels where frames (n, h, w, 3) uint8 of a static camera change,
    with holes filled. A person who moves a little at times is inside the region."""
    smooth = np.stack([cv2.GaussianBlur(frame, (0, 0), 1.0) for frame in frames])
    ordered = np.sort(smooth, axis=0)
    outliers = 1 if len(frames) > 3 else 0  # at either end
    change = (ordered[-1 - outliers] - ordered[outliers]).max(-1).astype(np.float32)
    noise = float(np.median(change))
    moving = (change > max(config.moving, 3 * noise)).astype(np.uint8)
    moving = cv2.morphologyEx(moving, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    gap = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (config.gap, config.gap))
    closed = cv2.morphologyEx(moving, cv2.MORPH_CLOSE, gap)
    outlines, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = np.zeros(moving.shape, np.uint8)
    large = [outline for outline in outlines if cv2.contourArea(outline) > config.least_area]
    cv2.drawContours(filled, large, -1, 1, cv2.FILLED)
    return cv2.dilate(filled, np.ones((3, 3), np.uint8)) > 0


def find_ghost(background: np.ndarray, region: np.ndarray, config: TakeConfig) -> np.ndarray:
    """Return (h, w) bool: the pixels of a person in a background (h, w, 3) uint8, within `region`
    (h, w) bool.

    GrabCut (Rother, Kolmogorov, Blake 2004) segments the region. It is initialised with the pixels
    that differ from the surrounding background, extrapolated into the region.
    """
    ghost = np.zeros(region.shape, bool)
    x, y, width, height = cv2.boundingRect(region.astype(np.uint8))
    if not width:
        return ghost
    around = config.around
    near = np.s_[max(0, y - around) : y + height + around, max(0, x - around) : x + width + around]
    picture, within = np.ascontiguousarray(background[near]), region[near]
    continued = cv2.inpaint(picture, within.astype(np.uint8), 3, cv2.INPAINT_TELEA)
    unlike = cv2.absdiff(picture, continued).max(-1) >= config.unlike
    labels = np.where(unlike & within, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    labels[~within] = cv2.GC_BGD
    if not (labels == cv2.GC_PR_FGD).any() or not (labels == cv2.GC_BGD).any():
        return ghost
    cv2.setRNGSeed(0)  # for its k-means: the same take gives the same background
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(picture, labels, (0, 0, 0, 0), *models, config.cuts, cv2.GC_INIT_WITH_MASK)
    ghost[near] = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    return ghost
