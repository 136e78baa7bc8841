"""What colour each part of the body has, and whether poses go with it (kernels: part_colour.cl)."""

from __future__ import annotations

from typing import Any

import numpy as np

from apf.body.model import BodyModel
from apf.body.posing import CONE_DEFINES, body_defines
from apf.likelihood.base import PointSubset
from apf.likelihood.config import LikelihoodConfig
from cl import Array, Device, InputError, Launch
from cl.workgroups import pack_defines, pack_size
from psfs.voxels.device_voxels import Voxels

_GROUP = 128


class PartColours:
    """The colours of surface samples `points` (K, 4) against those of the parts they lie on.

    Colours are compared by chromaticity, (R, G, B) / (R + G + B + dark) less its grey share: two
    numbers, in which the shading of a limb that turns, a shadow and the gains of the cameras
    cancel, all of which change RGB more than another garment does. The price: black, grey and
    white are one colour.

    `parts` (C, 4) float32 is what was learnt of each cone: chromaticity, 1 where it is known, 0.
    What is not known yet costs nothing, nor do samples that no camera sees. Twin:
    reference/likelihood/part_colour.py.
    """

    def __init__(
        self,
        device: Device,
        body: BodyModel,
        table: Array,
        points: Array,
        config: LikelihoodConfig,
    ) -> None:
        self.device, self.config = device, config.part_colour
        self._table, self._points, self._surface_scale = table, points, config.surface_scale
        self._n_points, self._n_cones = points.shape[0], len(body.cones)
        self._pack = pack_defines(device, _GROUP)
        constants = {"DARK": self.config.dark, "LEAST_SAMPLES": self.config.least_samples}
        self._defines: dict[str, float] = {**body_defines(body), **self._pack, **constants}
        self.parts = device.zeros((self._n_cones, 4), np.float32, "the parts' colours")
        self._samples = device.zeros((self._n_points, 4), np.float32, "the samples' colours")
        self._nearest = device.empty((self._n_points, 2), np.float32, "the samples' parts")
        shape = (self._n_points, self._n_cones)
        self._costs = device.empty(shape, np.float32, "the samples' costs")
        self._colours: Array | None = None
        self._compare = device.launch(
            self._kernel("compare_colours"),
            (self._n_cones, self._n_points),
            None,
            n_points=self._n_points,
            scale=self.config.scale,
            samples=self._samples,
            parts=self.parts,
            costs=self._costs,
        )

    def forget(self) -> None:
        """Forget every part's colour: a new track begins."""
        self.parts.fill(0)

    def observe(self, voxels: Voxels) -> None:
        """Enqueue the samples' colours. Raises InputError if the frame has no pictures."""
        try:
            colours = voxels.colours()
        except InputError as error:
            raise InputError(f"the likelihood's term part_colour: {error}") from None
        if colours is not self._colours:
            self._colours = colours
            self._sample = self.device.launch(
                self._kernel("sample_colours"),
                (self._n_points,),
                None,
                n_points=self._n_points,
                count=voxels.count,
                colours=colours,
                samples=self._samples,
            )
        self._sample()
        self._compare()

    def launcher(
        self, poses: Array, subset: PointSubset, weight: float, errors: Array
    ) -> list[Launch]:
        """Return the launches that add to `errors` (n,) of `poses` (n, D) `weight` times the mean
        of d^2 / (d^2 + scale^2) over the samples in `subset` that a camera sees, d from a sample's
        colour to that of the part nearest to it."""
        return [
            self.device.launch(
                self._kernel("add_colour_errors"),
                pack_size(poses.shape[0], self._pack),
                (self._pack["GROUP"],),
                n_particles=poses.shape[0],
                poses=poses,
                table=self._table,
                n_points=self._n_points,
                first_point=subset.first,
                stride=subset.stride,
                weight=weight,
                points=self._points,
                samples=self._samples,
                costs=self._costs,
                errors=errors,
            )
        ]

    def learning_launcher(self, pose: Array) -> list[Launch]:
        """Return the launches that learn from the frame whose estimate is the first of `pose`
        (.., D)."""
        group = self._pack["GROUP"]
        return [
            self.device.launch(
                self._kernel("find_nearest_parts"),
                (group,),
                (group,),
                pose=pose,
                table=self._table,
                n_points=self._n_points,
                scale=self._surface_scale,
                points=self._points,
                samples=self._samples,
                nearest_parts=self._nearest,
            ),
            self.device.launch(
                self._kernel("learn_colours"),
                (self._n_cones * group,),
                (group,),
                n_points=self._n_points,
                rate=self.config.rate,
                samples=self._samples,
                nearest_parts=self._nearest,
                parts=self.parts,
            ),
        ]

    def _kernel(self, name: str) -> Any:
        return self.device.kernel("tracking/part_colour", name, **self._defines, **CONE_DEFINES)
