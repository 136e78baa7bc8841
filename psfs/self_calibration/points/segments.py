"""Segments of a body, whose lengths stay the same in all frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Width of the robust weights, in standard deviations.
_REACH = 3.0


@dataclass(frozen=True, eq=False)
class Segments:
    """Segments between the K points of a frame.

    pairs: (S, 2) int, the points at both ends. n_points: K. spread: standard deviation of a length,
    as a share of it.
    """

    pairs: np.ndarray
    n_points: int
    spread: float

    def linearise(self, points: np.ndarray) -> SegmentTerms:
        """Return the squares of the deviations of points (F K, 3) from the median lengths."""
        places = points.reshape(-1, self.n_points, 3)
        with np.errstate(invalid="ignore"):
            apart, lengths = self._measure(places)
            never = ~np.isfinite(lengths).any(axis=0)
            usual = np.nanmedian(np.where(never, 1.0, lengths), axis=0)
            sigmas = self.spread * usual
            weights = 1 / (sigmas * (1 + ((lengths - usual) / (_REACH * sigmas)) ** 2)) ** 2
            along = apart / lengths[..., None]
        known = np.isfinite(weights)
        weights = np.where(known, weights, 0.0)
        return SegmentTerms(
            self, usual, weights, np.where(known[..., None], along, 0.0),
            np.where(known, lengths - usual, 0.0),
        )  # fmt: skip

    def _measure(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        apart = places[:, self.pairs[:, 0]] - places[:, self.pairs[:, 1]]
        return apart, np.linalg.norm(apart, axis=-1)


@dataclass(frozen=True, eq=False)
class SegmentTerms:
    """Squares of deviations from usual lengths. usual: (S,). weights, deviations: (F, S). along:
    (F, S, 3) unit vectors."""

    segments: Segments
    usual: np.ndarray
    weights: np.ndarray
    along: np.ndarray
    deviations: np.ndarray

    def cost(self, points: np.ndarray) -> float:
        """Return the weighted sum of squares at other points (F K, 3)."""
        places = points.reshape(-1, self.segments.n_points, 3)
        with np.errstate(invalid="ignore"):
            off = self.segments._measure(places)[1] - self.usual
        return float((self.weights * np.nan_to_num(off) ** 2).sum())

    def add(self, normal: np.ndarray, gradient: np.ndarray) -> None:
        """Add the terms to the normal matrices (F, K, 3, K, 3) and the gradient (F, K, 3)."""
        pulls = (self.weights * self.deviations)[..., None] * self.along
        blocks = self.weights[..., None, None] * self.along[..., None] * self.along[..., None, :]
        for number, (a, b) in enumerate(self.segments.pairs):
            gradient[:, a] += pulls[:, number]
            gradient[:, b] -= pulls[:, number]
            for first, second, sign in ((a, a, 1), (b, b, 1), (a, b, -1), (b, a, -1)):
                normal[:, first, :, second] += sign * blocks[:, number]
