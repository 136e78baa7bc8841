"""Counter-based random numbers: Philox 4x32-10 (Salmon et al. 2011). Twin of philox.h.

The counter is (frame, layer, particle, dimension) and the key the seed, so that a run repeats on
every device and the twins draw the numbers that the kernels draw.
"""

from __future__ import annotations

import numpy as np

#: Stands where the particle's number would: a draw for the whole set.
WHOLE_SET = np.iinfo(np.uint32).max

_MASK = np.uint64(WHOLE_SET)
_SHIFT = np.uint64(np.iinfo(np.uint32).bits)


def philox4x32(counter: np.ndarray, seed: int) -> np.ndarray:
    """Return random words (..., 4) uint32 for counters (..., 4) and a 64-bit seed."""
    c0, c1, c2, c3 = np.moveaxis(np.asarray(counter, np.uint64), -1, 0)
    k0, k1 = np.uint64(seed & 0xFFFFFFFF), np.uint64(seed >> 32 & 0xFFFFFFFF)
    for _ in range(10):
        product0, product1 = np.uint64(0xD2511F53) * c0, np.uint64(0xCD9E8D57) * c2
        c0, c1, c2, c3 = (
            (product1 >> _SHIFT) ^ c1 ^ k0,
            product1 & _MASK,
            (product0 >> _SHIFT) ^ c3 ^ k1,
            product0 & _MASK,
        )
        k0 = (k0 + np.uint64(0x9E3779B9)) & _MASK
        k1 = (k1 + np.uint64(0xBB67AE85)) & _MASK
    return np.stack([c0, c1, c2, c3], -1).astype(np.uint32)


def uniform01(words: np.ndarray) -> np.ndarray:
    """Return numbers in the open interval (0, 1) of words: 23 bits each, as many as float holds
    exactly with the half that keeps them off the ends."""
    return ((np.asarray(words) >> 9) + 0.5) * 2.0**-23


def normals(seed: int, frame: int, layer: int, n_particles: int, n_dof: int) -> np.ndarray:
    """Draw (n_particles, n_dof) standard normal numbers (Box-Muller)."""
    words = draw_words(seed, frame, layer, n_particles, n_dof)
    radius = np.sqrt(-2 * np.log(uniform01(words[..., 0])))
    return radius * np.cos(2 * np.pi * uniform01(words[..., 1]))


def uniforms(seed: int, frame: int, layer: int, n_particles: int, n_dof: int) -> np.ndarray:
    """Draw (n_particles, n_dof) numbers in (0, 1)."""
    return uniform01(draw_words(seed, frame, layer, n_particles, n_dof)[..., 0])


def draw_words(seed: int, frame: int, layer: int, n_particles: int, n_dof: int) -> np.ndarray:
    """Return (n_particles, n_dof, 4) uint32 random words."""
    counter = np.zeros((n_particles, n_dof, 4), np.uint64)
    counter[..., 0], counter[..., 1] = frame, layer
    counter[..., 2] = np.arange(n_particles)[:, None]
    counter[..., 3] = np.arange(n_dof)
    return philox4x32(counter, seed)


def uniform(seed: int, frame: int, layer: int) -> float:
    """Draw one number in (0, 1) for the whole set: the offset of systematic resampling."""
    return float(uniform01(philox4x32(np.array([frame, layer, WHOLE_SET, 0]), seed)[0]))
