"""The search for limbs elsewhere than the particles' mean has them (kernels: limb_search.cl)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from apf.body.limbs import limb_masks
from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.filters.particle_set import seed_words
from apf.filters.refinement import Refinement
from apf.likelihood.base import Likelihood
from cl import Array, Device, Launch, Stage
from cl.workgroups import stated_group

#: Items that choose, and move the poses chosen from.
_GPU_GROUP, _CPU_GROUP = 256, 64


def limb_ranges(body: BodyModel) -> np.ndarray:
    """Return (D, 2) lowest and highest value of a degree of freedom that may be anywhere."""
    return np.clip(body.limits, -np.pi, np.pi)


def n_near(n: int) -> int:
    """Return how many of `n` poses, the mean among them, have their limb near where it was."""
    return (n + 1) // 2


class LimbSearch(Stage):
    """Ends the search of a frame: refines the particles' mean and, for every limb, the best of many
    poses that differ from the mean in that limb, one of which has it where observed points are, and
    the best of many that have it anywhere within its limits, both found in rounds, each about the
    best of the round before; the one of these that scores best is the estimate. Does nothing with a
    likelihood that has neither surface points nor observed ones.

    A limb that the search has lost, an arm taken for the torso's side say, would stay lost:
    particles near the estimate do not reach where it is, and those that are spread widely are
    wrong in the rest of the body. Twin: reference/filters/limb_search.py, kernels: limb_search.cl.

    Each of R runs, with a seed each, by default that of the config, is searched by itself.
    `shift` is the device array (R, D) of how far the estimates moved from the means; `information`
    (R, D (D + 1) / 2) is that of `Refinement` for the poses taken. Zero where nothing is refined.
    `candidates` (R K, D) and `errors` (R K,) are what each run's estimate was chosen from, and how
    badly it fits: the refined mean, then what each limb's two searches found; with K = 1 no limb is
    looked for. tells_misfits: whether the search fills in the likelihood's `misfits`.
    """

    kernels = "tracking/limb_search"

    def __init__(
        self,
        device: Device,
        body: BodyModel,
        likelihood: Likelihood,
        config: FilterConfig,
        seeds: Sequence[int] | None = None,
    ) -> None:
        self.config, self.likelihood = config, likelihood
        self.n_dof = n = body.n_dof
        self._n_particles = config.search.n_particles
        limbs = limb_masks(body)
        looked_for = config.searches_limbs and likelihood.refines
        self._n_limbs = len(limbs) if looked_for else 0
        self._per_run = 1 + 2 * self._n_limbs
        self._group = _GPU_GROUP if device.is_gpu else _CPU_GROUP
        super().__init__(
            device, N_DOF=n, N_LIMBS=max(1, self._n_limbs), CANDIDATES=self._per_run,
            GROUP=self._group,
        )  # fmt: skip
        seeds = tuple(seeds or [config.search.seed])
        self._n_runs = n_runs = len(seeds)
        n_candidates = n_runs * self._per_run
        self._refinement = Refinement(
            device, body, config, n_candidates, voxels=likelihood.points is not None,
            observed=likelihood.observed,
        )  # fmt: skip
        self._by_points: Refinement | None = None
        if likelihood.observed is not None and self._n_limbs:
            self._by_points = Refinement(
                device, body, config.by_points, n_runs, voxels=False, observed=likelihood.observed
            )
        self.candidates = device.zeros((n_candidates, n), np.float32)
        self.errors = device.zeros((n_candidates,), np.float32)
        self.tells_misfits = self._n_limbs > 0 and likelihood.misfits_of_all
        self._all_misfits = None
        if self.tells_misfits:
            self._all_misfits = device.zeros((n_candidates,), np.float32)
        self._limbs = device.to_device(np.array([*limbs, np.zeros(n, bool)], np.uint8))
        n_poses = n_runs * self._n_particles if self._n_limbs else 1
        self._poses = device.empty((n_poses, n), np.float32, "the limbs' poses")
        self._sigma = device.to_device(body.sigma.astype(np.float32))
        self._limits = device.to_device(body.limits)
        self._ranges = device.to_device(limb_ranges(body).astype(np.float32))
        self._seeds = device.to_device(seed_words(seeds))
        self.shift = device.zeros((n_runs, n), np.float32)
        self.information = device.zeros((n_runs, n * (n + 1) // 2), np.float32)

    def change_body(self, body: BodyModel) -> None:
        """Search for the limbs of `body`, which differs from the one before in numbers alone."""
        self._refinement.change_body(body)
        if self._by_points is not None:
            self._by_points.change_body(body)
        self._sigma.set(body.sigma.astype(np.float32))
        self._limits.set(body.limits)
        self._ranges.set(limb_ranges(body).astype(np.float32))

    def launcher(self, frame: Array, result: Array) -> list[Launch]:
        """Return the launches that search: they move the means in `result`, its first R D values.

        frame: (R,) uint32, the number of the frame that the random numbers are drawn for.
        """
        likelihood, candidates = self.likelihood, self.candidates
        if self.config.refinement.steps == 0 or not likelihood.refines:
            return []
        if self._n_limbs:
            stride = self.config.likelihood.samples.point_turns
            errors = likelihood.errors
            launches = []
            if self._by_points is not None:
                launches = self._by_points.shift_launcher(None, result)
            launches.append(self._propose(frame, result, self._poses))
            for round in range(1 + self.config.limb_search.rounds):
                launches += [
                    *likelihood.rescoring_launcher(self._poses, errors, stride),
                    self._choose(frame, round),
                ]
        else:
            launches = [self._propose(frame, result, candidates)]
        launches += self._refinement.launcher(likelihood.points, candidates)
        if self._n_limbs:
            least_recall = self.config.limb_search.least_recall
            launches += likelihood.rescoring_launcher(
                candidates, self.errors, 1, least_recall, self._all_misfits
            )
        return [*launches, self._accept(result)]

    def _propose(self, frame: Array, result: Array, poses: Array) -> Launch:
        n = poses.shape[0] // self._n_runs
        return self.launch(
            "propose",
            (self.n_dof, n, self._n_runs),
            stated_group(self.device, 32, 8, 1),
            n=n,
            n_near=n_near(n),
            layer=self.config.search.n_layers,
            reach=self.config.limb_search.reaches[0],
            seeds=self._seeds,
            frames=frame,
            sigma=self._sigma,
            limits=self._limits,
            ranges=self._ranges,
            limbs=self._limbs,
            result=result,
            seen=self._by_points.shift if self._by_points is not None else None,
            poses=poses,
        )

    def _choose(self, frame: Array, round: int) -> Launch:
        """Return what ends a round, and moves the poses on to the next one, if there is one."""
        reaches, following = self.config.limb_search.reaches, round + 1
        return self.launch(
            "choose",
            (self._group * self._per_run, self._n_runs),
            (self._group, 1),
            n=self._n_particles,
            n_near=n_near(self._n_particles),
            layer=self.config.search.n_layers + following,
            reach=reaches[following] if following < len(reaches) else 0.0,
            seeds=self._seeds,
            frames=frame,
            sigma=self._sigma,
            limits=self._limits,
            limbs=self._limbs,
            errors=self.likelihood.errors,
            poses=self._poses,
            candidates=self.candidates,
        )

    def _accept(self, result: Array) -> Launch:
        return self.launch(
            "accept",
            (max(self.n_dof, self.information.shape[1]), self._n_runs),
            stated_group(self.device, 64, 1),
            margins=(self.config.limb_search.near_margin, self.config.limb_search.far_margin),
            errors=self.errors,
            candidates=self.candidates,
            informations=self._refinement.information,
            all_misfits=self._all_misfits,
            misfits=self.likelihood.misfits if self.tells_misfits else None,
            result=result,
            shift=self.shift,
            information=self.information,
        )
