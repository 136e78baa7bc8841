"""Objective functions over image features on the device (kernels: render.cl, objective.cl)."""

from __future__ import annotations

import numpy as np

from apf.body.mesh import BodyMesh
from apf.image_objective.config import OBJECTIVE_KINDS, ObjectiveConfig
from apf.image_objective.renderer import make_renderer, silhouette_shape
from apf.likelihood.base import Likelihood
from apf.likelihood.observations import FeatureMaps
from apf.scene import Scene
from cl import Array, Launch
from cl.launch import Kernel
from cl.workgroups import GROUP, row_group, size_defines


class ImageObjective(Likelihood):
    """Objective that scores poses by the silhouettes and edges in the pictures.

    mesh: mesh to draw, by default `config.mesh(body)`.
    errors: (N,) float32, 1 - f with f in [0, 1] of Rymut 2016 eq. (4.46)-(4.50): 0 is a perfect
    match. Twin: reference/image_objective/objective.py.
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
        shape = (len(rig), rig.height, rig.width)
        self._silhouettes = device.empty(silhouette_shape(rig), np.uint32, "the silhouettes")
        self._proximity = device.empty(shape, np.uint8, "the edge proximity")
        self._roi = device.empty((len(rig), 4), np.int32, "the regions of interest")
        self._areas = device.empty((len(rig),), np.int32, "the silhouettes' areas")
        self.errors = device.empty((n_hypotheses,), np.float32, "the errors")
        mesh = mesh or config.mesh(body)
        self._renderer = make_renderer(scene, n_hypotheses, mesh, config.round_ends)
        self._observed: tuple[Array, ...] = ()
        self._preparation: list[Launch] = []

    @property
    def counts(self) -> Array:
        """(V, N, 4) int32 pixels of the poses that were scored last, see `Renderer`."""
        return self._renderer.counts

    def observe(self, observation: FeatureMaps[Array]) -> None:
        arrays = (observation.maps, observation.roi)
        if not self._observed or any(
            new is not old for new, old in zip(arrays, self._observed, strict=True)
        ):
            self._observed = arrays
            self._preparation = self._prepare(*arrays)
        for launch in self._preparation:
            launch()

    def launcher(self, poses: Array) -> list[Launch]:
        config, n = self.config, self.n_hypotheses
        weights = (config.balance, config.silhouette_weight, config.edge_weight, 0.0)
        score = self.device.launch(
            self._kernel("score_counts"),
            (n,),
            (GROUP,),
            kind=OBJECTIVE_KINDS.index(config.kind),
            n_particles=n,
            n_views=len(self.rig),
            weights=weights,
            areas=self._areas,
            counts=self._renderer.counts,
            errors=self.errors,
        )
        arrays = (self._roi, self._silhouettes, self._proximity)
        return [*self._renderer.launcher(poses, *arrays), score]

    def _prepare(self, maps: Array, roi: Array) -> list[Launch]:
        """Return the launches that pack a frame's features and count their pixels."""
        views, words, pitch = self._silhouettes.shape
        return [
            self.device.launch(
                self._kernel("pack_maps"),
                (pitch, words, views),
                row_group(self.device),
                picture=self.rig.picture,
                pitch=pitch,
                maps=maps,
                roi=roi,
                regions=self._roi,
                silhouettes=self._silhouettes,
                proximity=self._proximity,
            ),
            self.device.launch(
                self._kernel("silhouette_areas"),
                (views * GROUP,),
                (GROUP,),
                n_words=words * pitch,
                silhouettes=self._silhouettes,
                areas=self._areas,
            ),
        ]

    def _kernel(self, name: str) -> Kernel:
        return self.device.kernel(
            "image/objective",
            name,
            **size_defines(self.device, self.rig.picture),
            GROUP=GROUP,
        )
