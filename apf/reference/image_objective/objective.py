"""Objective functions over image features. Twin of objective.cl."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from apf.body.mesh import BodyMesh
from apf.image_objective.config import ObjectiveConfig
from apf.image_objective.objective import FeatureMaps, segments
from apf.reference.image_objective.render import Picture, draw_hypotheses
from apf.reference.likelihood.base import NumpyLikelihood
from apf.scene import Scene


def count_pixels(
    pictures: Sequence[Sequence[Picture]],
    maps: np.ndarray,
    roi: np.ndarray,
    segments: np.ndarray,
    labels: np.ndarray,
) -> np.ndarray:
    """Return (V, N, 2 + 2 L) of pictures by view and hypothesis, each the parts and edges (h, w).

    Edge pixels, the sum of the edge proximity 0..255 there, then per label area and overlap (Rymut
    2016 eq. 4.30-4.34, 4.37-4.40), within `roi`.

    segments: (V, H, W) label of each pixel of the silhouettes, from 1. labels: (P,) from 0.
    """
    n_labels = int(labels.max()) + 1
    counts = np.zeros((len(pictures), len(pictures[0]), 2 + 2 * n_labels))
    segment_of = np.concatenate([[0], labels + 1])
    for v, (x0, y0, x1, y1) in enumerate(roi):
        region = np.s_[y0:y1, x0:x1]
        near_edge, image = maps[v, ..., 1][region].astype(np.float64), segments[v][region]
        for i, (parts, edges) in enumerate(pictures[v]):
            model, edge = segment_of[parts[region]], edges[region]
            counts[v, i, :2] = edge.sum(), near_edge[edge].sum()
            for label in range(1, n_labels + 1):
                area = model == label
                counts[v, i, 2 * label] = area.sum()
                counts[v, i, 2 * label + 1] = (area & (image == label)).sum()
    return counts


def objective_values(counts: np.ndarray, areas: np.ndarray, config: ObjectiveConfig) -> np.ndarray:
    """Return (N,) f in [0, 1], Rymut 2016 eq. (4.41)-(4.50).

    Of `counts` (V, N, 2 + 2 L) and the image's areas (V, L). A ratio with nothing to divide by is
    0.
    """
    w1, w2 = config.silhouette_weight, config.edge_weight
    if config.kind in ("ws", "sp"):
        counts, areas = counts.sum(0, keepdims=True), areas.sum(0, keepdims=True)
    f2 = _ratio(counts[..., 1] / 255, counts[..., 0])
    model, overlap = counts[..., 2::2], counts[..., 3::2]
    image = np.broadcast_to(areas[:, None], overlap.shape)
    share = config.balance
    by_label = share * _ratio(overlap, image) + (1 - share) * _ratio(overlap, model)
    f1 = by_label @ config.shares
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
        mesh: BodyMesh | None = None,
    ) -> None:
        self.body, self.rig, self.config = scene.body, scene.rig, config or ObjectiveConfig()
        self.mesh = mesh or self.config.mesh(self.body)
        n_parts = self.mesh.n_parts if self.mesh else len(self.body.cones)
        self._labels = self.config.part_labels(n_parts)

    def observe(self, observation: FeatureMaps[np.ndarray]) -> None:
        """Take the features of a frame. Raises InputError where segments are missing that the
        config has labels for."""
        self._maps, self._roi = observation.maps, observation.roi
        if self.config.labels:
            self._segments = segments(observation)
        else:
            self._segments = (self._maps[..., 0] > 127).astype(np.uint8)

    def __call__(self, poses: np.ndarray) -> np.ndarray:
        """Return the errors (N,) of poses (N, D): 1 - f, 0 for a perfect match."""
        pictures = draw_hypotheses(self.body, self.rig, poses, self.mesh, self.config.round_ends)
        counts = count_pixels(pictures, self._maps, self._roi, self._segments, self._labels)
        return 1 - objective_values(counts, self._image_areas(), self.config)

    def _image_areas(self) -> np.ndarray:
        """Return (V, L) the pixels of each segment in the region of interest, eq. (4.29)."""
        areas = np.zeros((len(self.rig), self.config.n_labels))
        for v, (x0, y0, x1, y1) in enumerate(self._roi):
            numbers = np.bincount(
                self._segments[v, y0:y1, x0:x1].ravel(), minlength=self.config.n_labels + 1
            )
            areas[v] = numbers[1 : self.config.n_labels + 1]
        return areas
