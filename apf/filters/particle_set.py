"""The particle set on the device: diffusion, exponent, resampling, mean (kernel: annealing.cl)."""

from __future__ import annotations

import math

import numpy as np

from apf.body.limbs import root_mask, trunk_mask
from apf.body.model import BodyModel
from apf.filters.config import SearchConfig
from cl import Array, Device, Launch, Stage
from cl.signature import Argument
from cl.workgroups import pack_defines

#: Work-items that anneal all particles: a work-group size that devices support.
_LARGEST_GROUP = 1024
#: Particles that a CPU's work-group diffuses: PoCL alone would make one group, on one core.
_CHILDREN = 8
#: Packs of a CPU's work-item are a multiple of this in the kernels: one program serves all usual
#: numbers of particles.
_MANY_PACKS = 64
#: Bits to which the exponent's logarithm is computed: more than single precision resolves.
_BITS = 18
#: The exponent's logarithm to base 2 lies between -20 and 20: errors in float need no larger range.
LOG2_BETA_LIMIT = 20.0


class ParticleSet(Stage):
    """N particles on the device, with their weights and parents.

    `sets`: two pose arrays (N, D); each layer diffuses one into the other. `result`: what the host
    reads after a frame: mean (D,), deviation (D,), then effective sample size, beta and least error
    per layer. `parents` (N,): parents of the next layer. `motion` (D, 4): see end_frame.h. `frame`
    (1,): number of the frame.
    """

    kernels = "tracking/annealing"

    def __init__(
        self,
        device: Device,
        body: BodyModel,
        config: SearchConfig,
    ) -> None:
        defines = _defines(device, config.n_particles, body.n_dof)
        super().__init__(device, **defines, LOG2_BETA_LIMIT=LOG2_BETA_LIMIT)
        self.config = config
        self.n_dof = body.n_dof
        n = config.n_particles
        self._group, self._pack = defines["GROUP"], defines["PACK"]
        self.sets = [device.empty((n, body.n_dof), np.float32, "the particles") for _ in range(2)]
        self.weights = device.empty((n,), np.float32, "the weights")
        self.result = device.zeros((2 * body.n_dof + 3 * config.n_layers,), np.float32)
        self.parents = device.empty((n,), np.int32, "the parents")
        self._at_rest = np.zeros((body.n_dof, 4), np.float32)
        self._at_rest[:, 3] = velocity_memory(body, config)
        self.motion = device.to_device(self._at_rest)
        self.frame = device.zeros((1,), np.uint32)
        self._sigmas = device.to_device(layer_sigmas(body, config).astype(np.float32))
        self._limits = device.to_device(body.limits)
        self._diffusions: list[tuple[int, Launch]] = []
        self._seed = device.to_device(seed_words(config.seed))

    def change_body(self, body: BodyModel) -> None:
        """Use the sigmas and limits of `body` from now on."""
        self._sigmas.set(layer_sigmas(body, self.config).astype(np.float32))
        self._limits.set(body.limits)

    def start(self, pose: np.ndarray) -> None:
        """Put all particles at `pose` (D,), frame number 0."""
        for poses in self.sets:
            poses.set(np.tile(pose.astype(np.float32), (poses.shape[0], 1)))
        self.parents.set(np.arange(self.config.n_particles, dtype=np.int32))
        self.frame.fill(0)
        self.motion.set(self._at_rest)

    def renew(self, layer: int, errors: Array, source: int) -> list[Launch]:
        """Return the launches that end a layer and, unless it is the last, diffuse the next.

        errors: (N,) of the particles in set `source`; the other set gets the next layer's."""
        last = layer == self.config.n_layers - 1
        if self.device.is_gpu and not last:
            return [self.anneal_diffuse(layer, errors, source)]
        following = self.estimate(source) if last else self.diffuse(layer + 1, source)
        return [self.anneal(layer, errors), following]

    def push(self, offset: np.ndarray) -> None:
        """Add `offset` (D,) to the shift of the next frame's particles; wait for the device."""
        motion = self.motion.get()
        motion[..., 1] += offset
        self.motion.set(motion)

    def diffuse(self, layer: int, source: int) -> Launch:
        """Return the launch that copies the parents in set `source`, adds the layer's noise and
        writes them to the other set (Song et al. eq. 11)."""
        n_packs = -(-self.n_dof // self._pack)
        launch = self.launch(
            "diffuse",
            (n_packs, self.config.n_particles),
            (32, 8) if self.device.is_gpu else (n_packs, _CHILDREN),
            n=self.config.n_particles,
            layer=layer,
            noise=self.config.layer_noise[layer],
            seed=self._seed,
            frame=self.frame,
            sigmas=self._sigmas,
            limits=self._limits,
            motion=self.motion,
            parents=self.parents,
            poses=self.sets[source],
            children=self.sets[1 - source],
        )
        self._diffusions.append((layer, launch))
        return launch

    def widen(self, factor: float) -> None:
        """Multiply the noise of the config by `factor` from now on."""
        for layer, launch in self._diffusions:
            launch.set(noise=factor * self.config.layer_noise[layer])

    def anneal(self, layer: int, errors: Array, beta: float = 0.0) -> Launch:
        """Return the launch that computes weights from `errors` (N,) at the layer's survival rate
        (Song et al. eq. 10; Deutscher & Reid 2005) and draws the next parents.

        A positive `beta` is used as the exponent instead of the one found from the survival rate.
        """
        return self.launch(
            "anneal",
            (self._group,),
            (self._group,),
            n=self.config.n_particles,
            layer=layer,
            last=layer == self.config.n_layers - 1,
            survival_rate=self.config.survival_rates[layer],
            given_beta=beta,
            seed=self._seed,
            frame=self.frame,
            errors=errors,
            weights=self.weights,
            parents=self.parents,
            result=self.result,
        )

    def anneal_diffuse(self, layer: int, errors: Array, source: int) -> Launch:
        """Return one launch that does `anneal` of a layer and `diffuse` of the next.

        On a GPU it is faster to repeat the annealing in every work-group than to launch twice."""
        config, n = self.config, self.config.n_particles
        n_packs = -(-self.n_dof // self._pack)
        n_groups = min(n * n_packs // self._group, self.device.info.compute_units)
        share = -(-n // max(1, n_groups))
        launch = self.launch(
            "anneal_diffuse",
            (-(-n // share) * self._group,),
            (self._group,),
            n=n,
            layer=layer,
            noise=config.layer_noise[layer + 1],
            share=share,
            survival_rate=config.survival_rates[layer],
            seed=self._seed,
            frame=self.frame,
            sigmas=self._sigmas,
            limits=self._limits,
            errors=errors,
            poses=self.sets[source],
            weights=self.weights,
            parents=self.parents,
            result=self.result,
            children=self.sets[1 - source],
        )
        self._diffusions.append((layer + 1, launch))
        return launch

    def estimate(self, source: int) -> Launch:
        """Return the launch that computes the weighted mean and deviation of set `source` (Song et
        al. eq. 12)."""
        return self.launch(
            "estimate",
            (self.n_dof * self._group,),
            (self._group,),
            n=self.config.n_particles,
            weights=self.weights,
            poses=self.sets[source],
            result=self.result,
        )

    def frame_end(self, report: Array) -> dict[str, Argument]:
        """Return what the kernel `accept` needs to do the same as `end_frame`."""
        return {
            "velocity": self.config.velocity,
            "n_result": self.result.size,
            "n_report": report.size,
            "frame": self.frame,
            "motion": self.motion,
            "report": report,
        }

    def end_frame(
        self,
        shift: Array,
        information: Array,
        candidates: Array,
        errors: Array,
        misfit: Array,
        report: Array,
    ) -> Launch:
        """Return the launch that ends the frame.

        It adds `shift` (D,) and the motion to the next frame's particles and writes all that the
        host reads to `report` (n,): `result`, `information`, the limb search's `candidates` (K, D),
        their `errors` (K,), `misfit` (1,)."""
        return self.launch(
            "end_frame",
            (report.size,),
            (64,),
            velocity=self.config.velocity,
            n_result=self.result.size,
            n_information=information.size,
            n_candidates=candidates.size,
            n_errors=errors.size,
            frame=self.frame,
            result=self.result,
            shift=shift,
            information=information,
            candidates=candidates,
            errors=errors,
            misfit=misfit,
            motion=self.motion,
            report=report,
        )


def _defines(device: Device, n: int, n_dof: int) -> dict[str, int]:
    """Return the defines of annealing.cl for `n` particles."""
    n_betas, largest = (4, _LARGEST_GROUP) if device.is_gpu else (1, 1)
    defines = pack_defines(device, min(largest, max(64, 1 << (n - 1).bit_length() >> 1)))
    rounds = math.ceil(_BITS / math.log2(n_betas + 1))
    run = -(-n // (defines["GROUP"] * defines["PACK"]))
    if not device.is_gpu:
        run = _MANY_PACKS * -(-run // _MANY_PACKS)
    return defines | {"N_DOF": n_dof, "N_BETAS": n_betas, "ROUNDS": rounds, "RUN": run}


def layer_sigmas(body: BodyModel, config: SearchConfig) -> np.ndarray:
    """Return (n_layers, D) deviation of each degree of freedom, before `SearchConfig.layer_noise`.

    The first `SearchConfig.trunk_layers` layers move only the trunk; the noise of the limbs shrinks
    from the layer after them on (partitioned sampling, MacCormick & Isard 2000).
    """
    sigmas = np.tile(body.sigma, (config.n_layers, 1))
    first = min(config.trunk_layers, config.n_layers - 1)
    limbs = ~trunk_mask(body)
    sigmas[:first, limbs] = 0.0
    sigmas[first:, limbs] *= config.noise_decay**-first
    return sigmas


def velocity_memory(body: BodyModel, config: SearchConfig) -> np.ndarray:
    """Return (D,) the share of each degree of freedom's velocity that stays from frame to frame.

    A heavy body moves and turns steadily: the velocity of its root is an average over frames, in
    which the last change has the weight `SearchConfig.velocity`. The other parts turn back and
    forth.
    """
    return np.where(root_mask(body), max(0.0, 1.0 - config.velocity), 0.0)


def seed_words(seed: int) -> np.ndarray:
    """Return (2,) uint32: lower and upper half of a seed."""
    return np.array([seed & 0xFFFFFFFF, seed >> 32], np.uint32)
