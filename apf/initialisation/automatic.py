"""From stored voxels of the first frames to a body of the person's size and its first pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from apf.backend import filter_for
from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.initialisation.kept_voxels import person_points
from apf.initialisation.pose_search import LIKELIHOOD, Hypothesis, PoseSearch, close, sideways
from apf.initialisation.shape_fit import GIRTH, Cloud, Shape, fit_shape, stature
from apf.scene import Scene
from cl import Device, InputError, NumpyDevice
from psfs.cameras.camera import CameraRig
from psfs.voxels.grid import VoxelGrid

#: Fewest surface voxels that can be a person.
_FEWEST = 200
#: Frames that are searched, the first and the last among them.
_SEARCHED = 5
#: Misfit above which no body was found.
_HOPELESS = 0.55
#: A start whose misfit is above this is looked for again with other random numbers, so many times
#: in all: what chance decides, several attempts decide better, and the score tells which.
_GOOD, _ATTEMPTS = 0.3, 3
#: Doubtful is a start with a rival that fits but this factor worse, and a body whose girth is so
#: many deviations of the prior above the template's: hardly anybody who stands has one.
_RIVALS, _STOUT = 1.1, 3.0


@dataclass(frozen=True, eq=False)
class Start:
    """body: the template in the person's size. pose: (D,) in the first frame. poses: (M, D) in all
    frames fitted. misfit: of these, 0 is perfect. rival: how much worse the best hypothesis that
    looks elsewhere is, as a factor of the error; infinite where there is none. seen: m, how high
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
    every: int = 1,
    attempts: int = _ATTEMPTS,
) -> Start:
    """Find a person in the `voxels` (see `stored`) of the first frames.

    Every `every`-th frame is fitted; those between only lead from one to the next. In the first of
    these, the last and some in between a search over all headings; from the frame where it fits
    best the body is tracked to both ends, and its shape fitted to all. Then once more from the
    frame that fits best, with that shape. All that up to so many `attempts`, while it does not fit
    well. noise: of a tracker from one of `voxels` to the next, see `FilterConfig`. height: known
    stature, m. keep_shape: the template is the person's own body. progress: called every now and
    then. Raises InputError if no frame shows a person.
    """
    clouds = [Cloud(points) for points in _people(voxels[::every])]
    way = (np.median(clouds[-1].points, 0) - np.median(clouds[0].points, 0))[:2]
    found: list[_Attempt] = []
    while not found or (len(found) < attempts and found[-1].misfit > _GOOD):
        other = (seed + (len(found) << 32)) % 2**64
        search = PoseSearch(device, rig, grid, template, height, keep_shape, other, way)
        config = replace(LIKELIHOOD, noise=noise, seed=other)
        found.append(_attempt(_Fitting(search, voxels, every, clouds, config, progress)))
    best = min(found, key=lambda attempt: attempt.fit.score)
    if best.misfit > _HOPELESS:
        raise InputError(
            f"no standing or walking person was found in the first frames (misfit "
            f"{best.misfit:.2f}; expected less than {_HOPELESS}); give --init"
        )
    seen = float(np.median([np.ptp(cloud.heights) for cloud in clouds]))
    shape, poses = best.fit.found[0].shape, best.fit.poses
    girth = float(np.exp(shape[:2].sum())) * stature(template) / seen
    body = Shape(template).body(shape)
    return Start(body, poses[0], poses, best.misfit, best.rival, seen, girth)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Hypotheses of one shape in all frames fitted; score: their mean cost, more if the person does
    not look where he goes."""

    found: list[Hypothesis]
    score: float

    @property
    def poses(self) -> np.ndarray:
        """(M, D)"""
        return np.array([h.pose for h in self.found])


class _Fitting:
    """`fitting(hypothesis, anchor)`: what becomes of a hypothesis in frame `anchor` of those fitted
    when the body is tracked to both ends and its shape fitted to all frames."""

    def __init__(
        self,
        search: PoseSearch,
        voxels: Sequence[Any],
        every: int,
        clouds: Sequence[Cloud],
        config: FilterConfig,
        tell: Callable[[], object] | None,
    ) -> None:
        self.search, self.clouds, self.fitted = search, clouds, voxels[::every]
        self._voxels, self._every, self._config = voxels, every, config
        self._tell = tell or (lambda: None)

    def limbs(self, hypothesis: Hypothesis, anchor: int) -> Hypothesis:
        """Its limbs searched for in frame `anchor`."""
        self._tell()
        return self.search.with_limbs(self.fitted[anchor], self.clouds[anchor], hypothesis)

    def __call__(self, found: Hypothesis, anchor: int) -> _Fit:
        search = self.search
        poses = self._followed(search.model.body(found.shape), found.pose, anchor)
        fitted = fit_shape(
            search.template, self.clouds, found.shape, poses, search.height,
            free=None if search.free else (),
        )  # fmt: skip
        tried = [self._judged(found.shape, poses), self._judged(*fitted)]
        return min(tried, key=lambda fit: fit.score)

    def _judged(self, shape: np.ndarray, poses: np.ndarray) -> _Fit:
        """Poses near these, and what they cost: hulls, that shapes are fitted to, are too thick."""
        search, found = self.search, []
        for pose, voxels, cloud in zip(poses, self.fitted, self.clouds, strict=True):
            self._tell()
            found.append(search.near(voxels, cloud, shape, pose))
        ahead = sideways(search.model.body(shape), np.array([h.pose for h in found]), search.way)
        return _Fit(found, float(np.mean([h.cost for h in found])) * ahead)

    def _followed(self, body: BodyModel, pose: np.ndarray, anchor: int) -> np.ndarray:
        """Poses (M, D) from the one in frame `anchor` to both ends."""
        search, every = self.search, self._every
        scene = Scene(search.device, search.rig, search.grid, body)
        poses = np.tile(pose, (len(self._voxels), 1))
        for order in (range(anchor * every, len(poses)), range(anchor * every, -1, -1)):
            tracker = filter_for(scene, self._config)
            tracker.start(pose)
            for k in order:
                self._tell()
                poses[k] = tracker.step(self._voxels[k]).pose
        return poses[::every]


@dataclass(frozen=True, eq=False)
class _Attempt:
    """What a search led to; rival: see `Start`."""

    fit: _Fit
    rival: float

    @property
    def misfit(self) -> float:
        return float(np.mean([h.misfit for h in self.fit.found]))


def _attempt(fitting: _Fitting) -> _Attempt:
    anchor, hypotheses = _best_frame(fitting.search, fitting.fitted, fitting.clouds)
    found = sorted((fitting.limbs(h, anchor) for h in hypotheses), key=lambda h: h.cost)
    fits = sorted((fitting(h, anchor) for h in close(found)), key=lambda fit: fit.score)
    costs = [h.cost for h in fits[0].found]
    best = int(np.argmin(costs))
    again = fitting(fitting.limbs(fits[0].found[best], best), best)  # the body is known better now
    scores = [fit.score for fit in fits] if len(fits) > 1 else [h.cost for h in found]
    rival = scores[1] / scores[0] if len(scores) > 1 else np.inf
    return _Attempt(min(again, fits[0], key=lambda fit: fit.score), rival)


def _people(voxels: Sequence[Any]) -> list[np.ndarray]:
    people = [person_points(frame.grid, frame.cloud().indices) for frame in voxels]
    if not people or min(map(len, people)) < _FEWEST:
        raise InputError(
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
    best = min(tried, key=lambda k: found[k][0].cost)
    return best, found[best]
