"""The trackers of a method that know when they have lost the person."""

from __future__ import annotations

from typing import Any

import numpy as np

from apf.backend import device_tracker, shares_launches, tracker_for
from apf.filters.method import Method
from apf.initialisation import StartConfig, StartError, find_start
from apf.initialisation.config import AcceptanceConfig
from apf.initialisation.from_keypoints import pose_of_points
from apf.initialisation.kept_voxels import stored
from apf.likelihood.observations import parted
from apf.scene import Scene
from apf.tracking.config import RecoveryConfig
from apf.tracking.recovery import SeparateRuns, Watched, WatchedRuns

#: The search everywhere while a person is lost: it is tried again soon enough.
_ONE_ATTEMPT = StartConfig(acceptance=AcceptanceConfig(n_attempts=1))
#: 2^64 over the golden ratio.
_GOLDEN = 0x9E3779B97F4A7C15


def seeded(method: Method, seeds: list[int]) -> list[Method]:
    """Return `method` with each of `seeds`. Raises InputError for impossible ones."""
    return [method.replace(filter=method.filter.changed(seed=seed)) for seed in seeds]


def run_seeds(seed: int, n_runs: int) -> list[int]:
    """Return the seeds of the runs that make the track of `seed`, which is the first one's; those
    of others are far from each other's and from it, as a user's are not (Steele et al. 2014)."""
    return [(seed + run * _GOLDEN) % 2**64 for run in range(n_runs)]


def watched_runs(scene: Scene, method: Method, seeds: list[int]) -> WatchedRuns | SeparateRuns:
    """Make the watched trackers of `method` with each of `seeds`, as one where the method can."""
    methods = seeded(method, seeds)
    if len(seeds) == 1 or not shares_launches(scene.device, method):
        return SeparateRuns([watched(scene, of) for of in methods])

    def watch(run: int, restart: Any) -> Watched:
        return watched(scene, methods[run], restart)

    return WatchedRuns(device_tracker(scene, method, seeds), len(seeds), watch)


def watched(
    scene: Scene, method: Method, tracker: Any = None, config: RecoveryConfig | None = None
) -> Watched:
    """Make the tracker of `method` that knows when it has lost the person, see `recovery`; of
    `tracker`, if there is one, which searches by that method."""
    config = (config or RecoveryConfig()).for_body(scene.body)
    config = config.replace(on=config.on and method.recover)
    if method.objective == "keypoints":  # which say at once where somebody is
        config = config.replace(retry=1)
    search = method.filter.search
    longer = {} if method.search == "sir" else {"n_layers": config.longer * search.n_layers}
    wide = method.filter.changed(noise=config.wider * search.noise, **longer)
    wider = method.replace(filter=wide)

    def everywhere(observation: Any) -> list[np.ndarray]:
        shown, points = parted(observation)
        if points is not None and not points.few:
            by_points = pose_of_points(scene.body, scene.rig, points)
            if by_points is not None:
                return [by_points]
        if not method.uses_voxels:
            return []
        voxels = stored(scene.device, shown)
        try:
            found = find_start(
                scene, [voxels], search.noise, keep_shape=True,
                seed=search.seed, config=_ONE_ATTEMPT,
            )  # fmt: skip
        except StartError:
            return []  # nobody is there, or the body cannot be found by itself
        return [found.pose]

    def enough(observation: Any) -> bool:
        points = parted(observation).points
        return method.uses_voxels or points is None or not points.few

    return Watched(
        tracker or tracker_for(scene, method),
        lambda: tracker_for(scene, wider),
        everywhere if method.uses_voxels or method.uses_keypoints else None,
        config,
        enough,
    )
