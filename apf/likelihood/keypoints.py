"""Likelihood of keypoints and other observed points of the body (kernel: keypoints.cl)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from apf.body.model import BodyModel
from apf.body.posing import CONE_DEFINES, body_defines, pack_body
from apf.likelihood.base import Likelihood
from apf.likelihood.config import EXCHANGE_COST, KeypointConfig
from apf.likelihood.observations import (
    POINT_REACH,
    Observation,
    ObservedPoints,
    make_empty_observations,
    split_observation,
)
from apf.likelihood.voxel import posture_prior
from apf.scene import Scene
from cl import Array, Launch, Step
from cl.workgroups import GROUP, pack_defines, pack_size
from psfs.cameras.camera import CAMERA_FLOATS


class KeypointLikelihood(Likelihood):
    """Sum of the likelihood `base` and the term of observed points. Without `base`: sum of that
    term and the posture prior.

    Observations are of type `Observed`. Estimates are also refined on the points, unless `base`
    does not refine estimates. Twin: reference/likelihood/keypoints.py.
    """

    def __init__(
        self,
        scene: Scene,
        config: KeypointConfig,
        posture_prior_weight: float,
        n_particles: int,
        base: Likelihood | None = None,
    ) -> None:
        self.device, self.config, self.base = scene.opencl, config, base
        self.body = scene.body
        self.unit = base.unit if base is not None else float(len(scene.rig))
        self._posture_weight = 0.0
        if base is None:
            self._posture_weight = self.unit * posture_prior_weight
        self._table = self.device.to_device(pack_body(scene.body), "the body model")
        self._posture = self.device.to_device(posture_prior(scene.body), "the posture prior")
        self._seen = ObservedPoints(scene, config.room)
        self.observed = self._seen if base is None or base.refines else None
        if base is not None:
            self.errors, self.points, self.misfits = base.errors, base.points, base.misfits
            self.misfits_of_all = base.misfits_of_all
        else:
            self.errors = self.device.empty((n_particles,), np.float32, "the errors")
            self.misfits = self.device.zeros((1,), np.float32)
        # If `base` adds the term in its own launches, this likelihood launches nothing itself.
        self._is_taken = base is not None and base.take_points(self._seen, config)

    def observe(self, observation: Observation) -> None:
        self.prepare(observation)()

    def prepare(self, observation: Observation) -> Callable[[], None]:
        """Enqueue `base`'s preparation of a frame; return a function that enqueues the rest."""
        shown, points = split_observation(observation)
        rest = self.base.prepare(shown) if self.base is not None else None

        def finished() -> None:
            if rest is not None:
                rest()
            self._seen.set(points or make_empty_observations())

        return finished

    def launcher(self, poses: Array) -> list[Step]:
        launches = self.base.launcher(poses) if self.base is not None else []
        return [*launches, *self._score(poses, self.errors)]

    def rescoring_launcher(
        self,
        poses: Array,
        errors: Array,
        stride: int = 1,
        least_recall: float = 0.0,
        misfits: Array | None = None,
    ) -> list[Launch]:
        launches = []
        if self.base is not None:
            launches = self.base.rescoring_launcher(poses, errors, stride, least_recall, misfits)
        return [*launches, *self._score(poses, errors)]

    def misfit_launcher(self, poses: Array) -> list[Launch]:
        """Return the launches that write the misfit of the first of `poses`: that of
        `base`, or without it the mean share by which the observed points are missed."""
        if self.base is not None:
            return self.base.misfit_launcher(poses)
        assert self.misfits is not None
        return [self._launch(1, poses, self.misfits, adds=False, per_seen=True, weight=1.0)]

    def learning_launcher(self, pose: Array) -> list[Launch]:
        return self.base.learning_launcher(pose) if self.base is not None else []

    def change_body(self, body: BodyModel) -> None:
        self.body = body
        self._table.set(pack_body(body))
        self._posture.set(posture_prior(body))
        if self.base is not None:
            self.base.change_body(body)

    def forget(self) -> None:
        if self.base is not None:
            self.base.forget()

    def _score(self, poses: Array, errors: Array) -> list[Launch]:
        if self._is_taken:
            return []
        launch = self._launch(
            poses.shape[0], poses, errors, adds=self.base is not None, per_seen=False,
            weight=self.unit * self.config.weight, posture_weight=self._posture_weight,
        )  # fmt: skip
        return [launch]

    def _launch(
        self,
        n: int,
        poses: Array,
        errors: Array,
        *,
        adds: bool,
        per_seen: bool,
        weight: float,
        posture_weight: float = 0.0,
    ) -> Launch:
        defines = body_defines(self.body) | pack_defines(self.device, GROUP)
        kernel = self.device.kernel(
            "tracking/keypoints", "score_points", **defines, **CONE_DEFINES,
            CAMERA_FLOATS=CAMERA_FLOATS,
        )  # fmt: skip
        return self.device.launch(
            kernel,
            pack_size(n, defines),
            (defines["GROUP"],),
            n_particles=n,
            adds=adds,
            per_seen=per_seen,
            weight=weight,
            reach=POINT_REACH,
            exchange=EXCHANGE_COST,
            posture_weight=posture_weight,
            posture=self._posture,
            poses=poses,
            table=self._table,
            cameras=self._seen.cameras,
            observed=self._seen.table,
            errors=errors,
        )
