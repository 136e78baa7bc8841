"""Trackers that detect when they have lost the person, and search again."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import cast

import numpy as np

from apf.backend import make_tracker
from apf.body.kinematics import posed_joints
from apf.body.stature import has_head
from apf.filters.base import Estimate, Tracker
from apf.filters.method import Method
from apf.initialisation.automatic import find_start
from apf.initialisation.from_keypoints import fit_pose_to_points
from apf.initialisation.kept_voxels import shows_somebody, store_voxels
from apf.initialisation.start import StartError
from apf.likelihood.observations import AnyVoxels, Observation, split_observation
from apf.scene import Scene
from apf.tracking.config import RecoveryConfig
from apf.tracking.limb_confidence import SAME_PLACE

#: Values of `Estimate.restart`: tracked from the last frame, or found by a search near the last
#: good pose or by a global search.
TRACKED, LOCAL_RESTART, GLOBAL_RESTART = 0, 1, 2
#: Misfit at which hardly anything of the body is visible: the greatest limit, and the only one
#: before there are good frames, because poor silhouettes misfit the right pose, too.
WORST = 0.9
#: Number of good frames whose misfits are compared; of lost frames from one global search to the
#: next, because each takes seconds; of consecutive searches in a lost frame.
_WINDOW, RETRY, _N_STEPS = 60, 5, 2


class Judge:
    """Decides frame by frame whether the person is lost, from the misfits so far."""

    def __init__(self, config: RecoveryConfig | None = None) -> None:
        self.config = config or RecoveryConfig()
        self._good: deque[float] = deque(maxlen=_WINDOW)

    def forget(self) -> None:
        """Forget the good frames."""
        self._good.clear()

    @property
    def limit(self) -> float:
        """The misfit above which the track is lost now."""
        if not self._good:
            return WORST
        usual = self.config.ratio * np.median(self._good)
        return float(np.clip(usual, self.config.least, WORST))

    def judge(self, estimate: Estimate, restart: int = TRACKED) -> Estimate:
        """Return the estimate with its confidence: 1/2 at the limit, NaN without a misfit."""
        confidence = 1 / (1 + (estimate.misfit / self.limit) ** 4)
        lost = bool(confidence < 0.5)
        return replace(estimate, confidence=confidence, lost=lost, restart=restart)

    def accept(self, estimate: Estimate) -> None:
        """Add this estimate to the good frames, by which later frames are judged."""
        if np.isfinite(estimate.misfit):
            self._good.append(estimate.misfit)


class RecoveringTracker:
    """A tracker that adds a confidence to its estimates and recovers a lost person; same interface
    as the tracker.

    wide: makes the tracker that searches around the last good pose when the person is lost, with
    more noise and more layers. everywhere: returns start poses (D,) from an observation, for the
    case that this search fails; None if there is no such search. always_everywhere: whether that is
    searched even if a pose near the last one fits; for bodies without a head, because legs alone
    also fit arms and trunk. retry: number of lost frames from one search everywhere to the next.
    recovers: whether the body can be lost at all. enough: whether an observation shows enough of
    a person to search by it, else nobody is present; by default always. Estimates of lost frames
    hold the last good pose, unless the first of these searches confirms the tracker's: then the
    pictures are poor, and the pose goes on.
    """

    def __init__(
        self,
        tracker: Tracker,
        wide: Callable[[], Tracker],
        everywhere: Callable[[Observation], Iterable[np.ndarray]] | None = None,
        enough: Callable[[Observation], bool] = lambda observation: True,
        *,
        always_everywhere: bool = False,
        retry: int = RETRY,
        recovers: bool = True,
    ) -> None:
        self._judge, self._enough, self._recovers = Judge(), enough, recovers
        self._always_everywhere, self._retry = always_everywhere, retry
        self._tracker, self._make_wide, self._everywhere = tracker, wide, everywhere
        self._wide: Tracker | None = None

    def start(self, pose: np.ndarray) -> None:
        """Put all particles at `pose` (D,)."""
        self._tracker.start(pose)
        self._judge.forget()
        self._pose, self._n_lost = np.asarray(pose, np.float64), 0

    def step(self, observation: Observation) -> Estimate:
        """Track the next frame."""
        return self.recover_if_lost(self._tracker.step(observation), observation)

    def score_poses(self, poses: np.ndarray) -> np.ndarray:
        """Return the errors (N,) of poses (N, D), see `Tracker.score_poses`."""
        return self._tracker.score_poses(poses)

    def recover_if_lost(self, estimate: Estimate, observation: Observation) -> Estimate:
        """Return the result of `step`, given the tracker's own `estimate` for an observation."""
        judged = self._judge.judge(estimate)
        if not self._recovers:
            return replace(judged, lost=False)
        if judged.lost:
            judged = self._recover(observation, judged)
        if judged.lost:
            self._n_lost += 1
            return replace(judged, pose=self._pose.copy())
        self._n_lost = 0
        self._pose = judged.pose
        self._judge.accept(judged)
        return judged

    def _recover(self, observation: Observation, lost: Estimate) -> Estimate:
        """Return the estimate after a restart, or `lost` if no restart succeeds."""
        enough = self._enough(observation)
        recovered = self._reacquire(observation, lost) if enough else replace(lost, present=False)
        # In either case the next frame starts from the last pose in which the person was tracked.
        self._tracker.start(self._pose if recovered.lost else recovered.pose)
        return recovered

    def _agree(self, one: Estimate, other: Estimate) -> bool:
        """Return whether two estimates have their joints at nearly the same places, and both a
        misfit below `WORST`."""
        body = one.body
        places = posed_joints(body, np.stack([one.pose, other.pose]))
        apart = np.linalg.norm(places[0] - places[1], axis=-1).mean()
        return bool(max(one.misfit, other.misfit) < WORST and apart < SAME_PLACE)

    def _reacquire(self, observation: Observation, lost: Estimate) -> Estimate:
        local = best = self._search_around(self._pose, observation, LOCAL_RESTART)
        again = self._n_lost % self._retry == 0 and (best.lost or self._always_everywhere)
        if again and self._everywhere is not None:
            tried = [
                self._search_around(pose, observation, GLOBAL_RESTART)
                for pose in self._everywhere(observation)
            ]
            best = min([best, *tried], key=lambda estimate: estimate.misfit)
        if best.lost and self._agree(local, lost):
            self._pose = lost.pose
        return lost if best.lost else _match_layers(best, lost)

    def _search_around(self, pose: np.ndarray, observation: Observation, restart: int) -> Estimate:
        if self._wide is None:
            self._wide = self._make_wide()
        self._wide.start(pose)
        for _ in range(_N_STEPS):
            estimate = self._wide.step(observation)
        return self._judge.judge(estimate, restart)


def _match_layers(best: Estimate, usual: Estimate) -> Estimate:
    """Return `best` with only the last of its layers, as many as `usual` has."""
    last = slice(-len(usual.ess), None)
    return replace(
        best, ess=best.ess[last], beta=best.beta[last], least_error=best.least_error[last]
    )


#: Factor of the noise in the searches for a lost person.
_WIDER = 4.0


def with_seeds(method: Method, seeds: list[int]) -> list[Method]:
    """Return `method` with each of `seeds`. Raises InputError for a seed that is out of range."""
    return [method.replace(filter=method.filter.with_changes(seed=seed)) for seed in seeds]


def make_recovering_tracker(scene: Scene, method: Method) -> RecoveringTracker:
    """Make the recovering tracker of `method`, see `recovery`."""
    search = method.filter.search
    # The SIR filter has no layers.
    layers = {} if method.search == "sir" else {"n_layers": 2 * search.n_layers}
    wide = method.filter.with_changes(noise=_WIDER * search.noise, **layers)
    wider = method.replace(filter=wide)

    def everywhere(observation: Observation) -> list[np.ndarray]:
        shown, points = split_observation(observation)
        if points is not None and not points.few:
            by_points = fit_pose_to_points(scene.body, scene.rig, points)
            if by_points is not None:
                return [by_points]
        if not method.uses_voxels:
            return []
        voxels = store_voxels(scene.device, cast(AnyVoxels, shown))
        try:
            start = find_start(scene, [voxels], search.noise, keep_shape=True, seed=search.seed)
        except StartError:
            return []  # nobody is there, or this body has no automatic start
        return [start.pose]

    def enough(observation: Observation) -> bool:
        shown, points = split_observation(observation)
        if not method.uses_voxels:
            return points is None or not points.few
        return shown is None or shows_somebody(cast(AnyVoxels, shown))

    return RecoveringTracker(
        make_tracker(scene, method),
        lambda: make_tracker(scene, wider),
        everywhere if method.uses_voxels or method.uses_keypoints else None,
        enough=enough,
        recovers=method.recover,
        always_everywhere=not has_head(scene.body),
        # Keypoints show without a search whether somebody is there.
        retry=1 if method.objective == "keypoints" else RETRY,
    )
