"""Silhouettes by a mixture of Gaussians per pixel (Rymut 2016, 2.1, eq. 2.1-2.6), by OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Lock

import cv2
import numpy as np

from psfs.background.config import PlateConfig
from psfs.footage.media import Media

#: What OpenCV gives pixels of the person; shadows get 127.
_PERSON = 255


class Mixture:
    """`mixture(view, image)`: (h, w) uint8 mask, 255 = person.

    Learnt from all frames of empty plates or from frames spread over the sequence, and kept: so a
    frame's mask does not depend on which frames were read before it. An `adaptive` one goes on
    learning from every picture that it is shown, as Rymut's does (eq. 2.5-2.6).
    """

    def __init__(
        self,
        media: Sequence[Media],
        empty: bool,
        adaptive: bool = False,
        config: PlateConfig | None = None,
    ) -> None:
        config = config or PlateConfig()
        samples = None if empty else config.mixture_samples
        self._models = [_learnt(view, samples) for view in media]
        self._rate = config.mixture_rate if adaptive else 0.0
        self._locks = [Lock() for _ in media]  # OpenCV's models are not safe across threads

    def __call__(self, view: int, image: np.ndarray) -> np.ndarray:
        with self._locks[view]:
            labels = np.asarray(self._models[view].apply(image, learningRate=self._rate))
        return np.where(labels == _PERSON, np.uint8(255), np.uint8(0))


def _learnt(view: Media, samples: int | None) -> cv2.BackgroundSubtractorMOG2:
    """Return the model of so many frames spread over the view, or of all."""
    indices = range(view.count) if samples is None else view.spread(samples)
    model = cv2.createBackgroundSubtractorMOG2(history=len(indices), detectShadows=True)
    for frame in view.frames(indices):
        model.apply(frame)
    return model
