"""Search for limbs that the particles' mean places wrongly (kernels: limb_search.cl)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from apf.body.limbs import limb_masks
from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.filters.particle_set import seed_words
from apf.filters.refinement import Refinement
from apf.likelihood.base import Likelihood
from cl import Array, Device, Launch, Stage
from cl.signature import Argument
from cl.workgroups import ALONG, GROUP

#: Least relative decrease of the error for a limb to be moved near where it was, and anywhere: with
#: 0.03 limbs were moved that had been right.
MARGINS = (0.01, 0.05)


def limb_ranges(body: BodyModel) -> np.ndarray:
    """Return (D, 2) range of each degree of freedom from which limb poses are drawn: its limits,
    clipped to [-pi, pi]."""
    return np.clip(body.limits, -np.pi, np.pi)


def count_near(n: int) -> int:
    """Return how many of `n` poses, the mean included, are drawn with their limb near the mean."""
    return (n + 1) // 2


class LimbSearch(Stage):
    """Last step of a frame: recovers lost limbs and refines the estimate.

    For each limb, two searches draw many poses that differ from the particles' mean in that limb
    only. The first draws it near the mean, with one pose moved to the observed points; the second
    draws it anywhere within its limits. Each search takes several rounds, each around the best pose
    of the previous round. The mean and the best pose of every search are refined, and the one that
    scores best is the estimate; to replace the mean, a pose must lower its error by the share
    of `MARGINS`. Without surface points and observed points nothing is done.

    Without this step a lost limb, for example an arm mistaken for the side of the torso, would stay
    lost: particles near the estimate do not reach the limb, and widely spread particles are wrong
    in the rest of the body. Twin: reference/filters/limb_search.py.

    `shift`: device array (D,), estimate minus mean. `information`: (D (D + 1) / 2,) of `Refinement`
    for the accepted pose. Both are zero without refinement. `candidates` (K, D): the refined mean,
    then the results of each limb's two searches; K = 1 without limb search. `errors` (K,): errors
    of the candidates. writes_misfit: whether the limb search writes the likelihood's `misfits`.
    """

    kernels = "tracking/limb_search"

    def __init__(
        self,
        device: Device,
        body: BodyModel,
        likelihood: Likelihood,
        config: FilterConfig,
    ) -> None:
        self.config, self.likelihood = config, likelihood
        self.n_dof = n = body.n_dof
        self._n_particles = config.search.n_particles
        limbs = limb_masks(body)
        is_used = config.searches_limbs and likelihood.refines
        self._n_limbs = len(limbs) if is_used else 0
        self._n_candidates = n_candidates = 1 + 2 * self._n_limbs
        self._group = GROUP if device.is_gpu else ALONG
        n_limbs = max(1, self._n_limbs)
        known = {"N_LIMBS": n_limbs, "CANDIDATES": n_candidates} if device.is_gpu else {}
        super().__init__(device, N_DOF=n, GROUP=self._group, **known)
        self._sizes = {"n_limbs": n_limbs, "n_candidates": n_candidates}
        self._refinement = Refinement(
            device, body, config, n_candidates, voxels=likelihood.points is not None,
            observed=likelihood.observed,
        )  # fmt: skip
        self._by_points: Refinement | None = None
        if likelihood.observed is not None and self._n_limbs:
            self._by_points = Refinement(
                device, body, config, 1, voxels=False, observed=likelihood.observed,
                fit=config.point_fit,
            )  # fmt: skip
        self.candidates = device.zeros((n_candidates, n), np.float32)
        self.errors = device.zeros((n_candidates,), np.float32)
        self.writes_misfit = self._n_limbs > 0 and likelihood.misfits_of_all
        self._all_misfits: Array | None = None
        if self.writes_misfit:
            self._all_misfits = device.zeros((n_candidates,), np.float32)
        self._limbs = device.to_device(np.array([*limbs, np.zeros(n, bool)], np.uint8))
        n_poses = self._n_particles if self._n_limbs else 1
        self._poses = device.empty((n_poses, n), np.float32, "the limbs' poses")
        self._sigma = device.to_device(body.sigma.astype(np.float32))
        self._limits = device.to_device(body.limits)
        self._ranges = device.to_device(limb_ranges(body).astype(np.float32))
        self._seed = device.to_device(seed_words(config.search.seed))
        self.shift = device.zeros((n,), np.float32)
        self.information = device.zeros((n * (n + 1) // 2,), np.float32)

    def change_body(self, body: BodyModel) -> None:
        """Search for the limbs of `body`, which differs from the one before in numbers alone."""
        self._refinement.change_body(body)
        if self._by_points is not None:
            self._by_points.change_body(body)
        self._sigma.set(body.sigma.astype(np.float32))
        self._limits.set(body.limits)
        self._ranges.set(limb_ranges(body).astype(np.float32))

    def launcher(
        self, frame: Array, result: Array, end: Mapping[str, Argument] | None = None
    ) -> list[Launch]:
        """Return the launches of the search, which overwrite the mean, `result[:D]`.

        frame: (1,) uint32 frame number, part of the random numbers' counters. end: see
        `ParticleSet.frame_end`, if the last launch ends the frame; this needs `writes_misfit`.
        """
        likelihood, candidates = self.likelihood, self.candidates
        if self.config.refinement.steps == 0 or not likelihood.refines:
            return []
        if self._n_limbs:
            stride = self.config.likelihood.point_turns
            errors = likelihood.errors
            launches = []
            if self._by_points is not None:
                launches = self._by_points.shift_launcher(None, result)
            launches.append(self._propose(frame, result, self._poses))
            for round in range(len(self.config.limb_search.reaches)):
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
        return [*launches, self._accept(result, end or {})]

    def _propose(self, frame: Array, result: Array, poses: Array) -> Launch:
        n = poses.shape[0]
        return self.launch(
            "propose",
            (self.n_dof, n),
            (32, 8),
            n_limbs=self._sizes["n_limbs"],
            n=n,
            n_near=count_near(n),
            layer=self.config.search.n_layers,
            reach=self.config.limb_search.reaches[0],
            seed=self._seed,
            frame=frame,
            sigma=self._sigma,
            limits=self._limits,
            ranges=self._ranges,
            limbs=self._limbs,
            result=result,
            seen=self._by_points.shift if self._by_points is not None else None,
            poses=poses,
        )

    def _choose(self, frame: Array, round: int) -> Launch:
        """Return the launch that ends a round and draws the next round's poses, if there is one."""
        reaches, following = self.config.limb_search.reaches, round + 1
        return self.launch(
            "choose",
            (self._group * self._n_candidates,),
            (self._group,),
            **self._sizes,
            n=self._n_particles,
            n_near=count_near(self._n_particles),
            layer=self.config.search.n_layers + following,
            reach=reaches[following] if following < len(reaches) else 0.0,
            seed=self._seed,
            frame=frame,
            sigma=self._sigma,
            limits=self._limits,
            limbs=self._limbs,
            errors=self.likelihood.errors,
            poses=self._poses,
            candidates=self.candidates,
        )

    def _accept(self, result: Array, end: Mapping[str, Argument]) -> Launch:
        without: dict[str, Argument] = {"velocity": 0.0, "n_result": 0, "n_report": 0}
        without |= {"frame": None, "motion": None, "report": None}
        return self.launch(
            "accept",
            (self._group,),
            (self._group,),
            **self._sizes,
            **without | dict(end),
            margins=MARGINS,
            errors=self.errors,
            candidates=self.candidates,
            informations=self._refinement.information,
            all_misfits=self._all_misfits,
            misfit=self.likelihood.misfits if self.writes_misfit else None,
            result=result,
            shift=self.shift,
            information=self.information,
        )
