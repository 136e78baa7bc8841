"""Objective functions over image features. Twin of objective.cl."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from apf.image_objective.config import ObjectiveConfig
from apf.likelihood.observations import FeatureMaps
from apf.reference.image_objective.render import Picture, draw_hypotheses
from apf.reference.likelihood.base import NumpyLikelihood
from apf.scene import Scene


def count_pixels(
    pictures: Sequence[Sequence[Picture]], maps: np.ndarray, roi: np.ndarray
) -> np.ndarray:
    """Return (V, N, 4) of pictures by view and hypothesis, each the parts and edges (h, w).

    Edge pixels, the sum of the edge proximity 0..255 there, area and overlap (Rymut 2016 eq.
    4.36-4.40), within `roi`.
    """
    counts = np.zeros((len(pictures), len(pictures[0]), 4))
    for v, (x0, y0, x1, y1) in enumerate(roi):
        region = np.s_[y0:y1, x0:x1]
        image, near_edge = maps[v, ..., 0][region] > 127, maps[v, ..., 1][region].astype(float)
        for i, (parts, edges) in enumerate(pictures[v]):
            model, edge = parts[region] > 0, edges[region]
            sums = edge.sum(), near_edge[edge].sum(), model.sum(), (model & image).sum()
            counts[v, i] = sums
    return counts


def image_areas(maps: np.ndarray, roi: np.ndarray) -> np.ndarray:
    """Return (V,) the pixels of the silhouette in the region of interest, eq. (4.29)."""
    regions = [maps[v, y0:y1, x0:x1, 0] for v, (x0, y0, x1, y1) in enumerate(roi)]
    return np.array([(region > 127).sum() for region in regions], float)


def objective_values(counts: np.ndarray, areas: np.ndarray, config: ObjectiveConfig) -> np.ndarray:
    """Return (N,) f in [0, 1], Rymut 2016 eq. (4.41)-(4.50), but for (4.43).

    Of `counts` (V, N, 4) and the image's areas (V,). A ratio with nothing to divide by is 0.
    """
    w1, w2 = config.silhouette_weight, config.edge_weight
    if config.kind in ("ws", "sp"):
        counts, areas = counts.sum(0, keepdims=True), areas.sum(0, keepdims=True)
    f2 = _ratio(counts[..., 1] / 255, counts[..., 0])
    model, overlap = counts[..., 2], counts[..., 3]
    image = np.broadcast_to(areas[:, None], overlap.shape)
    share = config.balance
    f1 = share * _ratio(overlap, image) + (1 - share) * _ratio(overlap, model)
    if config.kind in ("ws", "aows"):
        return np.mean(w1 * f1 + w2 * f2, axis=0)
    if config.kind == "posp":
        return np.prod(f1**w1 * f2**w2, axis=0)
    return np.mean(f1**w1 * f2**w2, axis=0)


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.where(whole > 0, part / np.maximum(whole, 1), 0.0)


class NumpyImageObjective(NumpyLikelihood):
    """The same as `ImageObjective`, in float64: `observe(features)`, then `objective(poses)`."""

    def __init__(
        self,
        scene: Scene,
        n_hypotheses: int,
        config: ObjectiveConfig | None = None,
    ) -> None:
        self.body, self.rig, self.config = scene.body, scene.rig, config or ObjectiveConfig()
        self.mesh = self.config.mesh(self.body)

    def observe(self, observation: FeatureMaps[np.ndarray]) -> None:
        self._maps, self._roi = observation.maps, observation.roi

    def __call__(self, poses: np.ndarray) -> np.ndarray:
        """Return the errors (N,) of poses (N, D): 1 - f, 0 for a perfect match."""
        pictures = draw_hypotheses(self.body, self.rig, poses, self.mesh, self.config.round_ends)
        counts = count_pixels(pictures, self._maps, self._roi)
        return 1 - objective_values(counts, image_areas(self._maps, self._roi), self.config)
