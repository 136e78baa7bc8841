"""Trackers that know when they have lost the person, and look for them again."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from apf.filters.base import Estimate
from cl import InputError

#: How a frame's estimate was come by.
TRACKED, LOCAL_RESTART, GLOBAL_RESTART = 0, 1, 2
#: Steepness of the confidence around the misfit at which a track is lost.
_STEEPNESS = 4
#: Steps that a restarted search takes on the frame in which the person was lost.
_LOCAL_STEPS = 2


@dataclass(frozen=True)
class RecoveryConfig:
    """When a track is lost: where the misfit (see `VoxelLikelihood.misfit_launcher`) exceeds
    `ratio` times the median of the last `window` good frames, though never below `least` and
    always beyond `worst`; beyond `unknown` as long as there are no good frames. retry: while lost,
    search everywhere in every so many frames. Raises InputError where a value makes no sense."""

    ratio: float = 2.0
    window: int = 60
    least: float = 0.4
    worst: float = 0.9
    unknown: float = 0.45
    retry: int = 5

    def __post_init__(self) -> None:
        if not (self.ratio > 1 and 0 < self.least <= self.unknown <= self.worst):
            raise InputError(
                f"recovery: ratio {self.ratio:g}, limits {self.least:g}, {self.unknown:g}, "
                f"{self.worst:g}; expected a ratio above 1 and ascending positive limits"
            )
        if self.window < 1 or self.retry < 1:
            raise InputError(
                f"recovery: window {self.window}, retry {self.retry}; expected 1 or more"
            )


class Judge:
    """Says of one frame after the other whether the person is lost, by the misfits so far."""

    def __init__(self, config: RecoveryConfig | None = None) -> None:
        self.config = config or RecoveryConfig()
        self._good: deque[float] = deque(maxlen=self.config.window)

    def forget(self) -> None:
        """There are no good frames yet."""
        self._good.clear()

    @property
    def limit(self) -> float:
        """The misfit beyond which a track is lost now."""
        config = self.config
        if not self._good:
            return config.unknown
        return float(np.clip(config.ratio * np.median(self._good), config.least, config.worst))

    def judged(self, estimate: Estimate, restart: int = TRACKED) -> Estimate:
        """With confidence, which is 1/2 at the limit and NaN where there is no misfit."""
        confidence = 1 / (1 + (estimate.misfit / self.limit) ** _STEEPNESS)
        return replace(
            estimate, confidence=confidence, lost=bool(confidence < 0.5), restart=restart
        )

    def accept(self, estimate: Estimate) -> None:
        """Later frames are judged by this one, too."""
        if np.isfinite(estimate.misfit):
            self._good.append(estimate.misfit)


class Watched:
    """A tracker whose estimates say how far they can be trusted; same use as the tracker's.

    wide: makes the tracker that looks around the last good pose when the person is lost, with
    wider noise and more layers. everywhere: poses (D,) to look from when that fails, given what is
    observed; None where there is no way to tell. Estimates of lost frames hold the last good pose.
    """

    def __init__(
        self,
        tracker: Any,
        wide: Callable[[], Any],
        everywhere: Callable[[Any], Iterable[np.ndarray]] | None = None,
        config: RecoveryConfig | None = None,
    ) -> None:
        self._judge = Judge(config)
        self._tracker, self._make_wide, self._everywhere = tracker, wide, everywhere
        self._wide: Any = None

    def start(self, pose: np.ndarray) -> None:
        """Put all particles at `pose` (D,)."""
        self._tracker.start(pose)
        self._judge.forget()
        self._pose, self._n_lost = np.asarray(pose, np.float64), 0

    def step(self, observation: Any) -> Estimate:
        """Track one frame further."""
        return self.watched(self._tracker.step(observation), observation)

    def watched(self, estimate: Estimate, observation: Any) -> Estimate:
        """What `step` makes of the tracker's own `estimate` of an observation."""
        found = self._judge.judged(estimate)
        if found.lost:
            found = self._recovered(observation, found)
        if found.lost:
            self._n_lost += 1
            return replace(found, pose=self._pose.copy())
        self._n_lost = 0
        self._pose = found.pose
        self._judge.accept(found)
        return found

    def _recovered(self, observation: Any, lost: Estimate) -> Estimate:
        """The estimate from a new start, or `lost` if none is good."""
        if self._wide is None:
            self._wide = self._make_wide()
        found = self._looked_from(self._pose, observation, LOCAL_RESTART)
        again = self._n_lost % self._judge.config.retry == 0
        if found.lost and again and self._everywhere is not None:
            tried = [
                self._looked_from(pose, observation, GLOBAL_RESTART)
                for pose in self._everywhere(observation)
            ]
            found = min([found, *tried], key=lambda estimate: estimate.misfit)
        found = lost if found.lost else _as_long(found, lost)
        # In either case the next frame starts from where the person was last seen.
        self._tracker.start(self._pose if found.lost else found.pose)
        return found

    def _looked_from(self, pose: np.ndarray, observation: Any, restart: int) -> Estimate:
        self._wide.start(pose)
        for _ in range(_LOCAL_STEPS):
            estimate = self._wide.step(observation)
        return self._judge.judged(estimate, restart)


class WatchedRuns:
    """The runs that one tracker makes at once, each watched by itself: a run that has lost the
    person looks for him alone, by a tracker of its own, and only then pays for it.

    watch: makes of a run's number and what starts that run anew, `start(pose)`, its `Watched`.
    Until a run loses the person it is, bit by bit, the same as alone.
    """

    def __init__(self, tracker: Any, n_runs: int, watch: Callable[[int, Any], Watched]) -> None:
        self._tracker = tracker
        self._runs = [watch(run, _Restart(tracker, run)) for run in range(n_runs)]

    def start(self, pose: np.ndarray) -> None:
        """Put all particles of all runs at `pose` (D,)."""
        for run in self._runs:
            run.start(pose)
        self._tracker.start(pose)

    def step(self, observation: Any) -> list[Estimate]:
        """Track one frame further; the estimate of each run."""
        estimates = self._tracker.step_runs(observation)
        return [
            run.watched(estimate, observation)
            for run, estimate in zip(self._runs, estimates, strict=True)
        ]


class SeparateRuns:
    """Trackers that are shown the same, one after the other; same use as `WatchedRuns`."""

    def __init__(self, trackers: Sequence[Any]) -> None:
        self._trackers = trackers

    def start(self, pose: np.ndarray) -> None:
        """Put all particles of all runs at `pose` (D,)."""
        for tracker in self._trackers:
            tracker.start(pose)

    def step(self, observation: Any) -> list[Estimate]:
        """Track one frame further; the estimate of each run."""
        return [tracker.step(observation) for tracker in self._trackers]


class _Restart:
    """One of a tracker's runs, as far as it can be started by itself."""

    def __init__(self, tracker: Any, run: int) -> None:
        self._tracker, self._run = tracker, run

    def start(self, pose: np.ndarray) -> None:
        self._tracker.restart(self._run, pose)


def _as_long(found: Estimate, usual: Estimate) -> Estimate:
    """`found` with the last of its layers, as many as `usual` has."""
    last = slice(-len(usual.ess), None)
    return replace(
        found, ess=found.ess[last], beta=found.beta[last], least_error=found.least_error[last]
    )
