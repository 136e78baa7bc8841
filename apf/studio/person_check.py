"""What live cameras see of somebody who walks into an empty room."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from cl import Device, NumpyDevice
from psfs.backend import make_evidence_function
from psfs.background.gaussian import Background, clipped_moments
from psfs.cameras.camera import CameraRig
from psfs.diagnostics.config import FaultConfig, InViewConfig
from psfs.diagnostics.person_in_view import PersonInView, find_person_in_views
from psfs.diagnostics.small_views import SILHOUETTES, Outline, Shrink, extract_outline
from psfs.page.words import make_lines, make_table
from psfs.sequence import Frame

#: Frames that the words are about: the last seconds.
_WINDOW = 30


class PersonCheck:
    """Silhouettes of live frames before the empty room, and what they say about each camera.

    empty: pictures (V, H, W, 3) uint8 of the empty room, some.
    """

    def __init__(
        self, device: Device | NumpyDevice, rig: CameraRig, empty: Sequence[np.ndarray]
    ) -> None:
        moments = [clipped_moments([images[view] for images in empty]) for view in range(len(rig))]
        mean, std = (np.stack(parts) for parts in zip(*moments, strict=True))
        self._shrink = Shrink(rig, rig.factor_within(FaultConfig().longest_side))
        small = self._shrink.small
        self._evidence_of = make_evidence_function(
            device, small, self._shrink.background(Background(mean, std)), SILHOUETTES
        )
        self._scale = rig[0].size[0] / small[0].size[0]
        self._outlines: deque[list[Outline | None]] = deque(maxlen=_WINDOW)

    def examine_frame(self, frame: Frame) -> list[np.ndarray]:
        """Return each camera's silhouette (h, w) bool of a frame, in small pictures."""
        evidence, small = self._evidence_of(self._shrink.frame(frame)), self._shrink.small
        masks = [
            of[: camera.size[1], : camera.size[0]] > 0
            for of, camera in zip(evidence, small, strict=True)
        ]
        self._outlines.append([extract_outline(mask) for mask in masks])
        return masks

    @property
    def views(self) -> list[PersonInView]:
        """The cameras' views of the person in the last frames."""
        return find_person_in_views(self._shrink.small, list(self._outlines), self._scale)

    def describe(self) -> str:
        """Return what each camera sees and what to do, HTML."""
        config = InViewConfig()
        if not any(one.seen for one in self.views):
            return make_lines([("note", "nobody is seen yet")])
        rows = [
            (one.camera, f"{one.seen:.0%}", f"{one.seen * one.whole:.0%}", f"{one.height:.0f}")
            for one in self.views
        ]
        advice: list[tuple[str, object]] = [
            ("warning", text) for one in self.views if (text := one.describe(config))
        ]
        lines = advice or [("good", "every camera sees the whole person")]
        return make_table(rows, ("camera", "seen", "whole", "px high")) + make_lines(lines)
