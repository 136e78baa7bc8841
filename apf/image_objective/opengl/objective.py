"""Objective functions over image features by OpenGL: drawn and counted there, scores come back."""

from __future__ import annotations

import numpy as np

from apf.body.posing import Kinematics
from apf.image_objective.config import OBJECTIVE_KINDS, ObjectiveConfig
from apf.image_objective.opengl.context import Compute
from apf.image_objective.opengl.renderer import OpenGLRenderer
from apf.likelihood.base import Likelihood
from apf.likelihood.observations import FeatureMaps
from apf.scene import Scene
from cl import Array, Step

#: Columns and rows of pixels that a work-group counts at a time.
_GROUP = (32, 8)
_SCORED = 64


class OpenGLObjective(Likelihood):
    """Scores poses as `ImageObjective` does, with OpenGL's rasteriser and depth test.

    OpenCL poses the body; its cones cross to OpenGL by the host, as drivers share buffers of the
    two without a window rarely. There all hypotheses are drawn as tiles of a frame buffer, counted
    and scored, and only `errors` (N,) come back. Once a frame its features cross, too.

    Raises what `OpenGLRenderer` does.
    """

    def __init__(
        self,
        scene: Scene,
        n_hypotheses: int,
        config: ObjectiveConfig | None = None,
    ) -> None:
        device, body, rig = scene.opencl, scene.body, scene.rig
        self.device, self.rig, self.n_hypotheses = device, rig, n_hypotheses
        self.config = config = config or ObjectiveConfig()
        self.renderer = OpenGLRenderer(body, rig, n_hypotheses, config.mesh(body))
        self.kinematics = Kinematics(device, self.renderer.shape.body, n_hypotheses)
        self.errors = device.empty((n_hypotheses,), np.float32, "the errors")
        context = self.renderer.context
        size = (rig.width, rig.height, len(rig))
        with self.renderer:
            self._maps = context.texture_array(size, 2, dtype="u1")
            self._counts = self.renderer.shape.reserve(4)
            self._areas = context.buffer(reserve=4 * len(rig))
            self._errors = context.buffer(reserve=4 * n_hypotheses)
            self._count = Compute(
                context, "count_pixels.comp", GROUP_X=_GROUP[0], GROUP_Y=_GROUP[1]
            )
            kind = OBJECTIVE_KINDS.index(config.kind)
            self._score = Compute(context, "score_counts.comp", KIND=kind)

    @property
    def counts(self) -> np.ndarray:
        """(V, N, 4) int32 pixels of the poses that were scored last, see `Renderer`."""
        with self.renderer:
            counts = np.frombuffer(self._counts.read(), np.int32)
        return counts.reshape(len(self.rig), self.n_hypotheses, -1)

    def observe(self, observation: FeatureMaps[Array]) -> None:
        """Take a frame's features over to OpenGL."""
        maps, regions = observation.maps.get(), observation.roi.get()
        inside = [maps[view, y0:y1, x0:x1, 0] for view, (x0, y0, x1, y1) in enumerate(regions)]
        areas = np.array([np.count_nonzero(region > 127) for region in inside], np.int32)
        with self.renderer:
            self.renderer.select_regions(regions)
            self._maps.write(np.ascontiguousarray(maps).tobytes())
            self._areas.write(areas.tobytes())

    def launcher(self, poses: Array) -> list[Step]:
        """Return what scores `poses` (N, D) float32 into `errors`; the last of it waits."""
        return [*self.kinematics.launcher(poses), self._score_hypotheses]

    def _score_hypotheses(self) -> None:
        """Draw and count the posed bodies, batch by batch, score them, and wait."""
        renderer, config, n = self.renderer, self.config, self.n_hypotheses
        cones = self.kinematics.cones.get()
        with renderer:
            renderer.upload(cones)
            renderer.project()
            for first, count in renderer.batches():
                renderer.render(first, count)
                renderer.drawn.use(0)
                self._maps.use(1)
                buffers = {0: renderer.regions, 1: self._counts}
                self._count((count,), buffers, **renderer.tiles(first))
            self._score(
                (-(-n // _SCORED),),
                {0: self._counts, 1: self._areas, 2: self._errors},
                n_particles=n,
                n_views=len(self.rig),
                weights=(config.balance, config.silhouette_weight, config.edge_weight),
            )
            errors = np.frombuffer(self._errors.read(), np.float32)
        self.errors.set(errors)
