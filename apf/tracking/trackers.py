"""Trackers of a method that detect when they have lost the person."""

from __future__ import annotations

from typing import cast

import numpy as np

from apf.backend import make_tracker
from apf.body.stature import has_head
from apf.filters.method import Method
from apf.initialisation.automatic import find_start
from apf.initialisation.from_keypoints import fit_pose_to_points
from apf.initialisation.kept_voxels import shows_somebody, store_voxels
from apf.initialisation.start import StartError
from apf.likelihood.observations import AnyVoxels, Observation, split_observation
from apf.scene import Scene
from apf.tracking.recovery import RETRY, RecoveringTracker

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
