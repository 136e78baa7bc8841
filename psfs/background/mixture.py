"""Silhouettes by a mixture of Gaussians per pixel (Rymut 2016, 2.1, eq. 2.1-2.6), by OpenCV."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Lock

import cv2
import numpy as np

from psfs.footage.media import Media

#: OpenCV's label of foreground; its label of shadows is 127.
_PERSON = 255

#: Number of frames that are fitted without a film of the empty scene.
_SAMPLES = 50
#: Learning rate of an adaptive mixture, alpha of Rymut 2016 eq. (2.5), who does not state his.
#: OpenCV counts a component as background once it is a tenth of the mixture, so a person may stand
#: still for 210 frames.
_RATE = 0.0005


class Mixture:
    """`mixture(view, image)`: (h, w) uint8 mask, 255 = person.

    It is fitted once, to all frames of the empty scene or to frames spread over the sequence. So a
    frame's mask does not depend on the frames that were read before it. An `adaptive` mixture is
    updated by every picture that it masks, like Rymut's (eq. 2.5-2.6). shadows: whether a darker
    shade of the scene's colour counts as its shadow; a person in dark clothes has such shades, too.
    """

    def __init__(
        self,
        media: Sequence[Media],
        empty: bool,
        adaptive: bool = False,
        *,
        shadows: bool = True,
    ) -> None:
        samples = None if empty else _SAMPLES
        self._models = [_fit_model(view, samples, shadows) for view in media]
        self._rate = _RATE if adaptive else 0.0
        self._locks = [Lock() for _ in media]  # OpenCV's models are not safe across threads

    def __call__(self, view: int, image: np.ndarray) -> np.ndarray:
        with self._locks[view]:
            labels = np.asarray(self._models[view].apply(image, learningRate=self._rate))
        return np.where(labels == _PERSON, np.uint8(255), np.uint8(0))


def _fit_model(view: Media, samples: int | None, shadows: bool) -> cv2.BackgroundSubtractorMOG2:
    """Fit the model to `samples` frames spread over the view, or to all. A pixel matches a
    component within 4 deviations, OpenCV's default."""
    indices = range(view.count) if samples is None else view.spread(samples)
    model = cv2.createBackgroundSubtractorMOG2(history=len(indices), detectShadows=shadows)
    for frame in view.frames(indices):
        model.apply(frame)
    return model
