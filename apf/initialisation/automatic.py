"""Estimate the person's body size and first pose from the stored voxels of the first frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from apf.body.model import BodyModel
from apf.body.stature import HIP_SHARE, has_feet, has_head, is_whole, stature
from apf.filters.config import FilterConfig
from apf.initialisation.config import StartConfig
from apf.initialisation.hypotheses import Hypothesis, select_close
from apf.initialisation.kept_voxels import cut_by_height, select_person_points
from apf.initialisation.pose_search import PoseSearch, SearchTask
from apf.initialisation.shape_fit import Cloud, fit_shape
from apf.initialisation.shape_model import ShapeModel
from apf.initialisation.start import Start, StartError, check_startable
from apf.likelihood.observations import AnyVoxels
from apf.scene import Scene
from psfs.common.progress import one_blas_thread


def find_start(
    scene: Scene,
    voxels: Sequence[AnyVoxels],
    noise: float,
    *,
    height: float | None = None,
    keep_shape: bool = False,
    seed: int = 0,
    progress: Callable[[], object] | None = None,
    every: int = 1,
    config: StartConfig | None = None,
) -> Start:
    """Fit the template, the scene's body, to the person in the `voxels` (see `store_voxels`) of the
    first frames.

    Every `every`-th frame is fitted; the frames between them only lead from one to the next. In the
    first, the last and some middle ones of the fitted frames, search over all headings. From the
    frame with the best fit, track the body to both ends, and fit its shape to all frames. Repeat
    once from the frame that now fits best, with that shape. Repeat everything with other random
    numbers while the fit is poor.

    noise: of a tracker from one of `voxels` to the next, see `SearchConfig`. height: known stature,
    m. keep_shape: the template is the person's own body. progress: called every now and then.

    A body without head or feet is fitted to the part of the voxels that it models. Frames after the
    person has left are ignored. Raises StartError if the first frame shows nobody or the body has
    no automatic start.
    """
    config = config or StartConfig()
    check_startable(scene.body)
    shown, clouds = _select_observations(scene, voxels, every, config)
    way = (np.median(clouds[-1].points, 0) - np.median(clouds[0].points, 0))[:2]
    found: list[Attempt] = []
    good, n_attempts = config.acceptance.good, config.acceptance.n_attempts
    while not found or (len(found) < n_attempts and found[-1].registration_error > good):
        other = (seed + (len(found) << 32)) % 2**64
        task = SearchTask(height, keep_shape, other, way)
        search = PoseSearch(scene, task, config)
        tracking = config.filter.with_changes(noise=noise, seed=other)
        fitting = _Fitting(search, shown, every, clouds, tracking, progress)
        # the products are small: BLAS threads would only wait for each other
        with one_blas_thread():
            found.append(run_attempt(fitting))
    limit = config.acceptance.hopeless
    best = min(found, key=lambda one: (one.registration_error > limit, one.fit.cost))
    if best.registration_error > limit:
        raise StartError(
            "no standing or walking person was found in the first frames (registration error "
            f"{best.registration_error:.2f}; expected less than {limit})"
        )
    return _build_start(best, scene.body, clouds, config)


def _build_start(
    best: Attempt, template: BodyModel, clouds: Sequence[Cloud], config: StartConfig
) -> Start:
    seen = float(np.median([np.ptp(cloud.heights) for cloud in clouds]))
    shape, poses = best.fit.found[0].shape, best.fit.poses
    girth = float(np.exp(shape[:2].sum())) * stature(template) / seen
    model = ShapeModel(template, config.shape.prior)
    body = model.body(shape)
    return Start(body, poses[0], poses, best.registration_error, best.rival, seen, girth, config)


def _select_observations(
    scene: Scene, voxels: Sequence[AnyVoxels], every: int, config: StartConfig
) -> tuple[Sequence[AnyVoxels], list[Cloud]]:
    """Return the voxels for the trackers, up to the frame in which the person leaves, and the
    person's points in every `every`-th of them; both restricted to the part of the person that the
    scene's body models."""
    people = _find_people(voxels[::every], config)
    voxels = voxels[: (len(people) - 1) * every + 1]
    margin = config.search.part_margin
    part = (
        -np.inf if has_feet(scene.body) else HIP_SHARE - margin,
        np.inf if has_head(scene.body) else HIP_SHARE + margin,
    )
    clouds = [Cloud(points, config.shape, part) for points in people]
    if is_whole(scene.body):
        return voxels, clouds
    low, high = np.median([cloud.heights for cloud in clouds], 0)
    ends = [low + share * (high - low) for share in part]
    return [cut_by_height(scene.device, frame, *ends) for frame in voxels], clouds


@dataclass(frozen=True, eq=False)
class Fit:
    """Hypotheses of one shape in all fitted frames. cost: their mean, higher if the person does not
    look in the direction of motion."""

    found: list[Hypothesis]
    cost: float

    @property
    def poses(self) -> np.ndarray:
        """Poses (M, D) of the hypotheses."""
        return np.array([h.pose for h in self.found])


class _Fitting:
    """`fitting(hypothesis, anchor)`: tracks the body from a hypothesis in the fitted frame `anchor`
    to both ends, and fits its shape to all frames."""

    def __init__(
        self,
        search: PoseSearch,
        voxels: Sequence[AnyVoxels],
        every: int,
        clouds: Sequence[Cloud],
        tracking: FilterConfig,
        progress: Callable[[], object] | None,
    ) -> None:
        self.search, self.clouds, self.fitted = search, clouds, voxels[::every]
        self._voxels, self._every, self._tracking = voxels, every, tracking
        self._progress = progress or (lambda: None)

    def limbs(self, hypothesis: Hypothesis, anchor: int) -> Hypothesis:
        """Return the hypothesis with its limbs searched for in frame `anchor`."""
        self._progress()
        return self.search.search_limbs(self.fitted[anchor], self.clouds[anchor], hypothesis)

    def __call__(self, found: Hypothesis, anchor: int) -> Fit:
        search = self.search
        poses = self._track_both_ways(search.model.body(found.shape), found.pose, anchor)
        fitted = fit_shape(
            search.template, self.clouds, found.shape, poses, search.task.height,
            config=search.config.shape, free=None if search.free else (),
        )  # fmt: skip
        return self._search_near(*fitted)

    def _search_near(self, shape: np.ndarray, poses: np.ndarray) -> Fit:
        """Return poses near these, and their costs."""
        search, found = self.search, []
        for pose, voxels, cloud in zip(poses, self.fitted, self.clouds, strict=True):
            self._progress()
            found.append(search.search_near(voxels, cloud, shape, pose))
        found_poses = np.array([h.pose for h in found])
        ahead = search.walking_factor(search.model.body(shape), found_poses)
        return Fit(found, float(np.mean([h.cost for h in found])) * ahead)

    def _track_both_ways(self, body: BodyModel, pose: np.ndarray, anchor: int) -> np.ndarray:
        """Return poses (M, D), tracked from the one in frame `anchor` to both ends."""
        search, every = self.search, self._every
        poses = np.tile(pose, (len(self._voxels), 1))
        for order in (range(anchor * every, len(poses)), range(anchor * every, -1, -1)):
            tracker = search.trackers(body, self._tracking)
            tracker.start(pose)
            for k in order:
                self._progress()
                poses[k] = tracker.step(self._voxels[k]).pose
        return poses[::every]


@dataclass(frozen=True, eq=False)
class Attempt:
    """The result of one attempt; rival: see `Start`."""

    fit: Fit
    rival: float

    @property
    def registration_error(self) -> float:
        return float(np.mean([h.registration_error for h in self.fit.found]))


def run_attempt(fitting: _Fitting) -> Attempt:
    search, headings = fitting.search, fitting.search.config.headings
    anchor, hypotheses = _find_best_frame(search, fitting.fitted, fitting.clouds)
    likely = select_close(hypotheses, headings.max_first_ratio)
    found = search.distinct([fitting.limbs(h, anchor) for h in likely], headings.n_kept)
    fits = sorted((fitting(h, anchor) for h in search.close(found)), key=lambda fit: fit.cost)
    costs = [h.cost for h in fits[0].found]
    best = int(np.argmin(costs))
    again = fitting(fitting.limbs(fits[0].found[best], best), best)  # the body is known better now
    if len(fits) > 1:  # some may have reached the same heading
        found = search.distinct([replace(fit.found[0], cost=fit.cost) for fit in fits], 2)
    rival = found[1].cost / found[0].cost if len(found) > 1 else np.inf
    return Attempt(min(again, fits[0], key=lambda fit: fit.cost), rival)


def _find_people(voxels: Sequence[AnyVoxels], config: StartConfig) -> list[np.ndarray]:
    """Return the person's points (N, 3) m in each frame, up to the first frame without a person.
    Raises StartError if that is the first one."""
    least = config.frames.min_voxels
    people = [select_person_points(v.grid, v.cloud().indices, config.frames) for v in voxels]
    shown = [len(points) >= least for points in people]
    if not shown[0]:
        later = "; a person appears later" if any(shown) else ""
        raise StartError(
            f"no person is in the first frame: {len(people[0])} surface voxels of "
            f"{voxels[0].grid.voxel_size:g} m; expected at least {least} of a person{later}"
        )
    return people[: [*shown, False].index(False)]


def _find_best_frame(
    search: PoseSearch, voxels: Sequence[AnyVoxels], clouds: Sequence[Cloud]
) -> tuple[int, list[Hypothesis]]:
    """Return the frame in which the search fits best, and its hypotheses."""
    n_searched = search.config.frames.n_searched
    tried = sorted({round(k) for k in np.linspace(0, len(clouds) - 1, n_searched)})
    found = {k: search(voxels[k], clouds[k]) for k in tried}
    best = min(tried, key=lambda k: found[k][0].cost)
    return best, found[best]
