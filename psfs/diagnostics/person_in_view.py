"""What each camera sees of the person: how often, whether wholly, and how large."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.diagnostics.small_views import Outline, find_reached_edges

#: Share of the frames in which a camera should see somebody, and of these wholly; height of a
#: person whose forearms are 4 px wide, px.
_USUALLY, _HEIGHT = 0.75, 100.0
_EDGES = ("left", "top", "right", "bottom")


class PersonInView:
    """One camera's view of the person in the examined frames.

    outlines, scale: see `find_person_in_views`. n_frames: number of frames in which two cameras see
    somebody.

    seen: share of the frames in which two cameras see somebody. whole: share of those in which the
    silhouette ends within the picture. height: median, px of the sequence's own pictures; NaN if it
    is never seen. edge: of the picture, beyond which the person goes most often; empty if it never
    does.
    """

    def __init__(
        self, camera: Camera, outlines: Sequence[Outline | None], n_frames: int, scale: float
    ) -> None:
        self.camera = camera.name
        traced = [outline for outline in outlines if outline is not None]
        reached = [find_reached_edges(line.contour, camera.size).any(axis=0) for line in traced]
        beyond = np.array(reached).reshape(-1, 4)
        self.seen = len(traced) / max(1, n_frames)
        self.whole = float((~beyond.any(axis=1)).mean()) if len(traced) else 0.0
        heights = [float(np.ptp(outline.points[:, 1])) + 1 for outline in traced]
        self.height = scale * float(np.median(heights)) if heights else float("nan")
        self.edge = _EDGES[int(beyond.sum(axis=0).argmax())] if beyond.any() else ""

    def describe(self) -> str:
        """Return what to do about the camera; empty if nothing."""
        if self.seen < _USUALLY:
            return (
                f"{self.camera} sees somebody in {self.seen:.0%} of the frames: turn it to where "
                "the person moves"
            )
        if self.whole < _USUALLY:
            return (
                f"{self.camera} sees the whole person in {self.whole:.0%} of the frames; the rest "
                f"is beyond the picture's {self.edge}: turn it, or move it back"
            )
        if self.height < _HEIGHT:
            return (
                f"{self.camera} sees a person of {self.height:.0f} px, expected {_HEIGHT:g} or "
                "more: move it nearer"
            )
        return ""


def find_person_in_views(
    rig: CameraRig, outlines: Sequence[Sequence[Outline | None]], scale: float
) -> list[PersonInView]:
    """Return what each camera of `rig` sees. outlines: by frame and view, None where nobody is.
    scale: size of the sequence's own pictures relative to those of the rig."""
    least = min(2, len(rig))
    there = [row for row in outlines if sum(one is not None for one in row) >= least]
    return [
        PersonInView(camera, [row[view] for row in outlines], len(there), scale)
        for view, camera in enumerate(rig)
    ]
