"""From stored voxels of the first frames to a body of the person's size and its first pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from apf.body import BodyModel
from apf.config import FilterConfig
from apf.start.search import Hypothesis, PoseSearch, misfit, sideways
from apf.start.shape import GIRTH, Cloud, fit_shape, stature
from apf.start.stored import person_points
from apf.tracker import tracker_for
from cl import Device, NumpyDevice, UserError
from psfs.camera import CameraRig
from psfs.grid import VoxelGrid

#: Fewest surface voxels that can be a person.
_FEWEST = 200
#: Frames that are searched, the first and the last among them.
_SEARCHED = 5
#: Misfit above which no body was found.
_HOPELESS = 0.55
#: Doubtful is a start with a rival that fits but this factor worse, and a body whose girth is so
#: many deviations of the prior above the template's: hardly anybody who stands has one.
_RIVALS, _STOUT = 1.1, 3.0


@dataclass(frozen=True, eq=False)
class Start:
    """body: the template in the person's size. pose: (D,) in the first frame. poses: (M, D) in all
    frames used. misfit: of `pose`, 0 is perfect. rival: how much worse the best hypothesis that
    looks elsewhere is, as a factor of the misfit; infinite where there is none. seen: m, how high
    what is seen of the person is. girth: how thick the body is for that height, the template
    standing upright being 1."""

    body: BodyModel
    pose: np.ndarray
    poses: np.ndarray
    misfit: float
    rival: float
    seen: float
    girth: float

    @property
    def doubts(self) -> list[str]:
        """What speaks against this start, a sentence each."""
        found = []
        if self.rival < _RIVALS:
            found.append(
                "it is not sure which way the person looks: another fits the voxels nearly as well"
            )
        if np.log(self.girth) > _STOUT * GIRTH:
            found.append(
                f"the start fits badly: what is seen is {self.seen:.2f} m high and "
                f"{self.girth:.1f} times as thick as people of that height who stand or walk, as "
                "whom it is tracked; look at the overlay, or give --init"
            )
        return found

    @property
    def height(self) -> float:
        """Stature, m."""
        return stature(self.body)


def find_start(
    device: Device | NumpyDevice,
    voxels: Sequence[Any],
    rig: CameraRig,
    grid: VoxelGrid,
    template: BodyModel,
    noise: float,
    height: float | None = None,
    keep_shape: bool = False,
    seed: int = 0,
    progress: Callable[[], object] | None = None,
) -> Start:
    """Find a person in the `voxels` (see `stored`) of the first frames, some time apart.

    In the first, the last and frames in between a search over all headings; from the frame where it
    fits best the body is tracked to both ends, and its shape fitted to all frames. Then once more
    from the frame that fits best, with that shape. noise: of a tracker from one of the frames to
    the next, see `FilterConfig`. height: known stature, m. keep_shape: the template is the person's
    own body. progress: called every now and then. Raises UserError if no frame shows a person.
    """
    clouds = [Cloud(points) for points in _people(voxels)]
    way = (np.median(clouds[-1].points, 0) - np.median(clouds[0].points, 0))[:2]
    search = PoseSearch(device, rig, grid, template, height, keep_shape, seed, way)
    config = FilterConfig(noise=noise, seed=seed)
    fitting = _Fitting(search, voxels, clouds, config, progress or (lambda: None))
    anchor, hypotheses = _best_frame(search, voxels, clouds)
    fits = sorted((fitting(found, anchor) for found in hypotheses), key=lambda fit: fit.score)
    best = int(np.argmin(fits[0].misfits))
    known = Hypothesis(fits[0].shape, fits[0].poses[best], float(fits[0].misfits[best]))
    again = fitting(known, best)  # the body is known better now
    final = min(again, fits[0], key=lambda fit: fit.score)
    misfits = float(final.misfits.mean())
    if misfits > _HOPELESS:
        raise UserError(
            f"no standing or walking person was found in the first frames (misfit {misfits:.2f}; "
            f"expected less than {_HOPELESS}); give --init"
        )
    rival = fits[1].score / fits[0].score if len(fits) > 1 else np.inf
    seen = float(np.median([np.ptp(cloud.heights) for cloud in clouds]))
    girth = float(np.exp(final.shape[:2].sum())) * stature(template) / seen
    return Start(final.body, final.poses[0], final.poses, misfits, rival, seen, girth)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A body of scales `shape` (S,), poses (M, D) and misfits (M,) in all frames; score: their
    mean, more if the person does not look where he goes."""

    body: BodyModel
    shape: np.ndarray
    poses: np.ndarray
    misfits: np.ndarray
    score: float


class _Fitting:
    """`fitting(hypothesis, anchor)`: what becomes of a hypothesis in frame `anchor` when its limbs
    are searched for, the body is tracked to both ends and its shape fitted to all frames."""

    def __init__(
        self,
        search: PoseSearch,
        voxels: Sequence[Any],
        clouds: Sequence[Cloud],
        config: FilterConfig,
        tell: Callable[[], object],
    ) -> None:
        self._search, self._config, self._tell = search, config, tell
        self._voxels, self._clouds = voxels, clouds

    def __call__(self, hypothesis: Hypothesis, anchor: int) -> _Fit:
        search, clouds = self._search, self._clouds
        found = search.with_limbs(self._voxels[anchor], clouds[anchor], hypothesis)
        poses = self._followed(search.model.body(found.shape), found.pose, anchor)
        self._tell()
        free = None if search.free else ()
        shape, poses = fit_shape(
            search.template, clouds, found.shape, poses, search.height, free=free
        )
        body = search.model.body(shape)
        misfits = [misfit(body, pose, cloud) for pose, cloud in zip(poses, clouds, strict=True)]
        score = float(np.mean(misfits)) * sideways(body, poses, search.way)
        return _Fit(body, shape, poses, np.array(misfits), score)

    def _followed(self, body: BodyModel, pose: np.ndarray, anchor: int) -> np.ndarray:
        """Poses (M, D) from the one in frame `anchor` to both ends."""
        search, poses = self._search, np.tile(pose, (len(self._voxels), 1))
        for order in (range(anchor, len(poses)), range(anchor, -1, -1)):
            tracker = tracker_for(search.device, body, search.rig, search.grid, self._config)
            tracker.start(pose)
            for k in order:
                self._tell()
                poses[k] = tracker.step(self._voxels[k]).pose
        return poses


def _people(voxels: Sequence[Any]) -> list[np.ndarray]:
    people = [person_points(frame.grid, frame.cloud().indices) for frame in voxels]
    if not people or min(map(len, people)) < _FEWEST:
        raise UserError(
            f"one of the first frames has {min(map(len, people), default=0)} surface voxels; "
            f"expected at least {_FEWEST} of a person: choose --frames where somebody is in view"
        )
    return people


def _best_frame(
    search: PoseSearch, voxels: Sequence[Any], clouds: Sequence[Cloud]
) -> tuple[int, list[Hypothesis]]:
    """The frame in which the search fits best, and its hypotheses."""
    tried = sorted({round(k) for k in np.linspace(0, len(clouds) - 1, _SEARCHED)})
    found = {k: search(voxels[k], clouds[k]) for k in tried}
    best = min(tried, key=lambda k: found[k][0].misfit)
    return best, found[best]
