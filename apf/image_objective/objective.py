"""Objective functions over image features on the device (kernels: render.cl, objective.cl)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from apf.body.mesh import FRUSTUM_VERTICES, BodyMesh, cone_mesh
from apf.body.model import BodyModel
from apf.image_objective.renderer import renderer_for, silhouette_shape
from apf.scene import Scene
from cl import Array, InputError, Launch
from cl.workgroups import row_group
from psfs.cameras.names import listed
from psfs.common.ranges import check_range

#: Rymut 2016 eq. (4.46)-(4.50): weighted sum, smoothed product, per-camera averages of either,
#: and the product over cameras.
KINDS = ("ws", "sp", "aows", "aosp", "posp")
_GROUP = 256


@dataclass(frozen=True)
class ObjectiveConfig:
    """What an image objective is made of.

    kind: one of KINDS. silhouette_weight, edge_weight: w1 and w2 of Rymut 2016 eq. (4.46)-(4.50),
    factors that add up to 1 for the weighted kinds, exponents for the others. balance: beta of
    eq. (4.41), share of the image's silhouette against the model's. labels: segment of each of the
    shape's parts (the body's cones), from 1 on, for silhouettes segmented alike (eq. 4.43); none
    for plain ones. label_weights: of the segments, equal by default; divided by their sum.
    vertices_per_part: shape model, table 6.5: 4 draws cones as trapezoids, more as frusta.
    round_ends: of the trapezoids, as the cones have in the voxels' likelihood; Rymut's have none.
    """

    kind: str = "sp"
    silhouette_weight: float = 0.5
    edge_weight: float = 0.5
    balance: float = 0.5
    labels: tuple[int, ...] = ()
    label_weights: tuple[float, ...] = ()
    vertices_per_part: int = 4
    round_ends: bool = False

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"the objective is {self.kind!r}; expected {listed(KINDS)}")
        w1, w2 = self.silhouette_weight, self.edge_weight
        if not (w1 >= 0 and w2 >= 0 and 0 < w1 + w2 < np.inf):
            raise InputError(f"the objective's weights are {w1} and {w2}; expected numbers from 0")
        if self.kind in ("ws", "aows") and abs(w1 + w2 - 1) > 1e-6:
            raise InputError(f"the weights of {self.kind} are {w1} and {w2}; expected a sum of 1")
        check_range("the balance", self.balance, 0, 1, ends=True)
        known = (4, *FRUSTUM_VERTICES)
        if self.vertices_per_part not in known:
            raise InputError(
                f"{self.vertices_per_part} vertices per part; expected {listed(map(str, known))}"
            )
        self._check_labels()

    def _check_labels(self) -> None:
        known = set(range(1, self.n_labels + 1))
        if self.labels and set(self.labels) != known:
            raise InputError(f"the labels are {self.labels}; expected all of 1 to {self.n_labels}")
        weights = self.label_weights
        if weights and (
            len(weights) != self.n_labels or not min(weights) >= 0 or not 0 < sum(weights) < np.inf
        ):
            raise InputError(
                f"the labels' weights are {weights}; expected {self.n_labels} numbers from 0"
            )

    @property
    def n_labels(self) -> int:
        return max(self.labels, default=1)

    @property
    def shares(self) -> np.ndarray:
        """(n_labels,) weights of the labels with sum 1."""
        weights = np.array(self.label_weights or (1.0,) * self.n_labels)
        return weights / weights.sum()

    def part_labels(self, n_parts: int) -> np.ndarray:
        """(P,) int32 label of each part, from 0. Raises InputError for another number of parts."""
        labels = self.labels or (1,) * n_parts
        if len(labels) != n_parts:
            raise InputError(f"{len(labels)} labels for {n_parts} parts; expected one for each")
        return np.array(labels, np.int32) - 1

    def mesh(self, body: BodyModel) -> BodyMesh | None:
        """The shape of `body`; None stands for the flat model."""
        return cone_mesh(body, self.vertices_per_part) if self.vertices_per_part > 4 else None


class FeatureMaps(Protocol):
    """What an image objective observes, on the device or, for the twin, as NumPy arrays.

    maps: (V, H, W, 2) uint8 silhouette 0 or 255 and edge proximity 0..255. roi: (V, 4) int32 first
    column and row and, excluded, the last; what lies outside counts nowhere. With labels also
    `labels` (V, H, W) uint8, 0 where no segment is.
    """

    maps: Any
    roi: Any


class ImageObjective:
    """A `Scorer` of poses of a scene's body by the silhouettes and edges that its cameras see.

    mesh: what is drawn, by default what `config` makes of the body's cones.
    errors: (N,) float32, 1 - f with f in [0, 1] of Rymut 2016 eq. (4.46)-(4.50): 0 is a perfect
    match. Twin: reference/objective.py.
    """

    def __init__(
        self,
        scene: Scene,
        n_hypotheses: int,
        config: ObjectiveConfig | None = None,
        mesh: BodyMesh | None = None,
    ) -> None:
        device, body, rig = scene.opencl, scene.body, scene.rig
        self.device, self.rig = device, rig
        self.config = config = config or ObjectiveConfig()
        self.n_hypotheses = n_hypotheses
        shape, n_labels = (len(rig), rig.height, rig.width), config.n_labels
        bits = silhouette_shape(rig, n_labels)
        self._silhouettes = device.empty(bits, np.uint32, "the silhouettes")
        self._proximity = device.empty(shape, np.uint8, "the edge proximity")
        self._roi = device.empty((len(rig), 4), np.int32, "the regions of interest")
        self._areas = device.empty((len(rig), n_labels), np.int32, "the silhouettes' areas")
        self._shares = device.to_device(config.shares.astype(np.float32), "the labels' weights")
        self.errors = device.empty((n_hypotheses,), np.float32, "the errors")
        mesh = mesh or config.mesh(body)
        labels = config.part_labels(mesh.n_parts if mesh else len(body.cones))
        self._renderer = renderer_for(scene, n_hypotheses, labels, mesh, config.round_ends)
        self._observed: tuple[Array | None, ...] = ()
        self._preparation: list[Launch] = []

    def observe(self, observation: FeatureMaps) -> None:
        """Enqueue the preparation of a frame's features."""
        labels = observation.labels if self.config.labels else None  # type: ignore[attr-defined]
        arrays = (observation.maps, observation.roi, labels)
        if not self._observed or any(
            new is not old for new, old in zip(arrays, self._observed, strict=True)
        ):
            self._observed = arrays
            self._preparation = self._prepare(*arrays)
        for launch in self._preparation:
            launch()

    def launcher(self, poses: Array) -> list[Launch]:
        """The launches that score `poses` (N, D) float32 into `errors`, arguments set."""
        config, n = self.config, self.n_hypotheses
        weights = (config.balance, config.silhouette_weight, config.edge_weight, 0.0)
        score = self.device.launch(
            self._kernel("score_counts"),
            (n,),
            (_GROUP,),
            np.int32(n),
            np.int32(len(self.rig)),
            np.array(weights, np.float32),
            self._shares,
            self._areas,
            self._renderer.counts,
            self.errors,
        )
        arrays = (self._roi, self._silhouettes, self._proximity)
        return [*self._renderer.launcher(poses, *arrays), score]

    def _prepare(self, maps: Array, roi: Array, labels: Array | None) -> list[Launch]:
        views, n_labels, words, pitch = self._silhouettes.shape
        return [
            self.device.launch(
                self._kernel("pack_maps"),
                (pitch, words, views),
                row_group(self.device, pitch),
                np.int32(self.rig.height),
                np.int32(pitch),
                maps,
                labels,
                roi,
                self._roi,
                self._silhouettes,
                self._proximity,
            ),
            self.device.launch(
                self._kernel("silhouette_areas"),
                (views * n_labels * _GROUP,),
                (_GROUP,),
                np.int32(words * pitch),
                self._silhouettes,
                self._areas,
            ),
        ]

    def _kernel(self, name: str) -> Any:
        return self.device.kernel(
            "image/objective",
            name,
            WIDTH=self.rig.width,
            N_LABELS=self.config.n_labels,
            KIND=KINDS.index(self.config.kind),
            GROUP=_GROUP,
        )
