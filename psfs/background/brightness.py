"""Masks of what is brighter than a threshold."""

from __future__ import annotations

import cv2
import numpy as np

from psfs.footage.settings import SequenceSettings


def find_bright(image: np.ndarray, settings: SequenceSettings) -> np.ndarray:
    """Return the mask (h, w) uint8 of pixels brighter than the threshold, closed with a square
    (dilated, then eroded)."""
    assert settings.threshold is not None
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    mask: np.ndarray = np.where(grey > settings.threshold * 255, np.uint8(255), np.uint8(0))
    for radius, operation in ((settings.dilate, cv2.dilate), (settings.erode, cv2.erode)):
        if radius:
            mask = operation(mask, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))
    return mask
