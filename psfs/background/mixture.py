"""Silhouettes by a mixture of Gaussians per pixel (Rymut 2016, 2.1, eq. 2.1-2.6), by OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Lock

import cv2
import numpy as np

from psfs.footage.media import Media

#: What OpenCV gives pixels of the person; shadows get 127.
_PERSON = 255
#: Frames that the mixtures are learnt from where the scene is never empty.
_SAMPLES = 50


class Mixture:
    """`mixture(view, image)`: (h, w) uint8 mask, 255 = person.

    Learnt once, from all frames of empty plates or from frames spread over the sequence, and kept:
    so a frame's mask does not depend on which frames were read before it.
    """

    def __init__(self, media: Sequence[Media], empty: bool) -> None:
        self._models = [_learnt(view, empty) for view in media]
        self._locks = [Lock() for _ in media]  # OpenCV's models are not safe across threads

    def __call__(self, view: int, image: np.ndarray) -> np.ndarray:
        with self._locks[view]:
            labels = np.asarray(self._models[view].apply(image, learningRate=0))
        return np.where(labels == _PERSON, np.uint8(255), np.uint8(0))


def _learnt(view: Media, empty: bool) -> cv2.BackgroundSubtractorMOG2:
    indices = range(view.count) if empty else view.spread(_SAMPLES)
    model = cv2.createBackgroundSubtractorMOG2(history=len(indices), detectShadows=True)
    for frame in view.frames(indices):
        model.apply(frame)
    return model
