"""A take of somebody who walks about, as the calibration uses it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.names import join_names
from psfs.diagnostics.small_views import Outline
from psfs.self_calibration.adjustment import PersonPoints
from psfs.self_calibration.config import PersonConfig
from psfs.self_calibration.upright import FEWEST, UprightView, fit_upright

Outlines = Sequence[Sequence[Outline | None]]
#: What to film if the cameras cannot be found.
FILM = (
    "film one person who walks about for ten seconds or more, towards and past all cameras, wholly "
    "seen by all of them, with a second of the empty room in background/"
)
#: Frames per second at which lags are searched first.
TABLE_RATE = 15.0
#: Least standard deviation of a silhouette's edge, as a share of its height: three quarters of a
#: second's walk away from one place.
_LEAST_MOTION = 0.03


class PersonTake:
    """Outlines of V cameras at `rate` per second, and what each camera tells by itself.

    cameras: small, with the intrinsics that are kept. points: the silhouettes' tangent points.
    views: of every camera its tilt and height, by every `step`-th frame. edges: (N, 2, 2) px each,
    the straight edges of the empty room. most: the greatest lag in steps. Raises InputError if a
    camera seldom sees the whole person.
    """

    def __init__(
        self, cameras: Sequence[Camera], outlines: Outlines, edges: Sequence[np.ndarray],
        rate: float, config: PersonConfig,
    ) -> None:  # fmt: skip
        check_seen(cameras, outlines)
        self.cameras, self.edges = cameras, edges
        self.points = PersonPoints(cameras, outlines, config)
        self.step = max(1, round(rate / TABLE_RATE))
        self.views = _fit_views(cameras, [of_view[:: self.step] for of_view in outlines])
        self.most = int(np.ceil(config.longest_lag * rate / self.step))

    def find_up(self, rig: CameraRig) -> np.ndarray:
        """Return the mean of what the cameras of a rig tell of up (3,)."""
        pairs = zip(rig, self.views, strict=True)
        return np.mean([camera.R.T @ view.axes[2] for camera, view in pairs], axis=0)


def check_seen(cameras: Sequence[Camera], outlines: Outlines) -> None:
    """Raise InputError if the person is seldom seen wholly, or hardly moves."""
    motions = []
    for camera, view_outlines in zip(cameras, outlines, strict=True):
        within = [o for o in view_outlines if o is not None and not o.at_border.any()]
        whole = [outline.points for outline in within]
        if len(whole) < FEWEST:
            raise InputError(
                f"{camera.name}: the whole person is in {len(whole)} of {len(view_outlines)} "
                f"pictures; expected {FEWEST} or more; {FILM}"
            )
        edges = np.array([[*line.min(axis=0), *line.max(axis=0)] for line in whole])
        motions.append(edges.std(axis=0).max() / np.median(edges[:, 3] - edges[:, 1]))
    usual = float(np.median(motions))
    if usual < _LEAST_MOTION:
        raise InputError(
            f"the person hardly moves: the silhouettes' edges by {100 * usual:.1f} % of the "
            f"height, expected {100 * _LEAST_MOTION:g} % or more; {FILM}"
        )


def _fit_views(cameras: Sequence[Camera], outlines: Outlines) -> list[UprightView]:
    """Return what each camera tells of its tilt and height."""
    views = [fit_upright(*pair) for pair in zip(cameras, outlines, strict=True)]
    unseen = [camera.name for camera, view in zip(cameras, views, strict=True) if view is None]
    if unseen:
        raise InputError(f"{join_names(unseen)}: the person is seldom seen wholly; {FILM}")
    return [view for view in views if view is not None]
