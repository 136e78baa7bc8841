"""The particle set on the device: diffusion, exponent, resampling, mean (kernel: annealing.cl)."""

from __future__ import annotations

import math

import numpy as np

from apf.body import BodyModel
from apf.config import FilterConfig
from apf.proposal import layer_sigmas
from cl import Array, Device, Launch
from psfs.launching import pack_defines

#: Items that work on all particles.
_LARGEST_GROUP = 1024
#: Place of the noise among the arguments of `diffuse`.
_NOISE_PLACE = 2
#: To how many bits the exponent's logarithm is found.
_BITS = 18


class ParticleSet:
    """Particles, their weights and parents, all on the device.

    `sets` are two pose arrays (N, D): each layer diffuses one into the other. `result` holds what
    the host reads after a frame: mean (D), deviation (D), then per layer effective sample size,
    beta and least error. `frame` (1,) counts the frames.
    """

    def __init__(self, device: Device, body: BodyModel, config: FilterConfig) -> None:
        self.device = device
        self.config = config
        self.n_dof = body.n_dof
        n = config.n_particles
        self._defines = _defines(device, n, body.n_dof)
        self._group, self._pack = self._defines["GROUP"], self._defines["PACK"]
        self.sets = [device.empty((n, body.n_dof), np.float32, "the particles") for _ in range(2)]
        self.weights = device.empty((n,), np.float32, "the weights")
        self.result = device.zeros((2 * body.n_dof + 3 * config.n_layers,), np.float32)
        self._parents = device.empty((n,), np.int32, "the parents")
        self._motion = device.zeros((body.n_dof, 2), np.float32)
        self.frame = device.zeros((1,), np.uint32)
        self._sigmas = device.to_device(layer_sigmas(body, config).astype(np.float32))
        limits = np.stack([body.lower, body.upper], -1).astype(np.float32)
        self._limits = device.to_device(limits)
        self._diffusions: list[tuple[int, Launch]] = []
        self._seed = np.array([config.seed & 0xFFFFFFFF, config.seed >> 32], np.uint32)

    def start(self, pose: np.ndarray) -> None:
        """All particles at `pose` (D,), frame number 0."""
        n = self.config.n_particles
        for poses in self.sets:
            poses.set(np.tile(pose.astype(np.float32), (n, 1)))
        self._parents.set(np.arange(n, dtype=np.int32))
        self.frame.fill(0)
        self._motion.fill(0)

    def diffuse(self, layer: int, source: int) -> Launch:
        """Draw the parents of set `source` and spread them by the layer's noise into the other."""
        launch = self.device.launch(
            self._kernel("diffuse"),
            (-(-self.n_dof // self._pack), self.config.n_particles),
            None,
            np.int32(self.config.n_particles),
            np.int32(layer),
            np.float32(self.config.layer_noise[layer]),
            np.float32(self.config.spread if layer > 0 else 0.0),
            self._seed,
            self.frame,
            self._sigmas,
            self._limits,
            self.result,
            self._motion,
            self._parents,
            self.sets[source],
            self.sets[1 - source],
        )
        self._diffusions.append((layer, launch))
        return launch

    def widen(self, factor: float) -> None:
        """Spread by `factor` times the noise of the config from now on."""
        for layer, launch in self._diffusions:
            noise = np.float32(factor * self.config.layer_noise[layer])
            launch.set_arg(_NOISE_PLACE, noise)

    def anneal(self, layer: int, errors: Array, beta: float = 0.0) -> Launch:
        """Weights from `errors` (N,) at the layer's survival rate, and the next parents.

        A positive `beta` is the exponent whatever the survival."""
        return self.device.launch(
            self._kernel("anneal"),
            (self._group,),
            (self._group,),
            np.int32(self.config.n_particles),
            np.int32(layer),
            np.int32(layer == self.config.n_layers - 1),
            np.float32(self.config.survival_rates[layer]),
            np.float32(beta),
            self._seed,
            self.frame,
            errors,
            self.weights,
            self._parents,
            self.result,
        )

    def estimate(self, source: int) -> Launch:
        """Weighted mean and deviation of set `source`."""
        return self.device.launch(
            self._kernel("estimate"),
            (self.n_dof * self._group,),
            (self._group,),
            np.int32(self.config.n_particles),
            self.weights,
            self.sets[source],
            self.result,
        )

    def settle(self, shift: Array) -> Launch:
        """End the frame: the next one's particles move by `shift` (D,) and the motion."""
        return self.device.launch(
            self._kernel("settle"),
            (self.n_dof,),
            None,
            np.float32(self.config.velocity),
            self.frame,
            self.result,
            shift,
            self._motion,
        )

    def _kernel(self, name: str) -> object:
        return self.device.kernel("annealing", name, **self._defines)


def _defines(device: Device, n: int, n_dof: int) -> dict[str, int]:
    """The defines of annealing.cl for `n` particles."""
    n_betas, largest = (4, _LARGEST_GROUP) if device.is_gpu else (1, 1)
    defines = pack_defines(device, min(largest, max(64, 1 << (n - 1).bit_length() >> 1)))
    rounds = math.ceil(_BITS / math.log2(n_betas + 1))
    run = -(-n // (defines["GROUP"] * defines["PACK"]))
    return defines | {"N_DOF": n_dof, "N_BETAS": n_betas, "ROUNDS": rounds, "RUN": run}
