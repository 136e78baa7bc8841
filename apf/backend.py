"""Trackers, likelihoods, features and pictures on either device: kernels on OpenCL, twins on NumPy.

The only module beside tests and benchmarks that imports `apf.reference`.
"""

from __future__ import annotations

from collections.abc import Callable
from pkgutil import resolve_name
from typing import Any, Protocol, TypeAlias

import numpy as np

from apf.body.mesh import BodyMesh
from apf.filters.annealed import AnnealedParticleFilter
from apf.filters.base import DeviceTracker, Tracker
from apf.filters.config import FilterConfig
from apf.filters.method import Method
from apf.filters.searches import OBJECTIVES, SEARCHES
from apf.image_objective.config import FeatureConfig
from apf.image_objective.features import Features
from apf.image_objective.opengl.context import egl_context
from apf.image_objective.renderer import draw_hypotheses
from apf.reference.filters.annealed import NumpyAnnealedParticleFilter
from apf.reference.filters.base import NumpyTracker
from apf.reference.image_objective import render
from apf.reference.image_objective.features import NumpyFeatures
from apf.scene import Scene
from cl import Device, InputError, NumpyDevice
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.sequence import Frame
from psfs.silhouettes.config import SilhouetteConfig

AnyFeatures: TypeAlias = Features | NumpyFeatures


class FrameSource(Protocol):
    """The properties of a `psfs.sequence.Sequence` that describe its frames."""

    @property
    def rig(self) -> CameraRig: ...

    @property
    def background(self) -> Background | None: ...

    @property
    def has_images(self) -> bool: ...


def make_filter(
    scene: Scene, config: FilterConfig
) -> AnnealedParticleFilter | NumpyAnnealedParticleFilter:
    """Return the annealed particle filter over voxels for the scene's device."""
    if isinstance(scene.device, NumpyDevice):
        return NumpyAnnealedParticleFilter(scene, config)
    return AnnealedParticleFilter(scene, config)


def make_tracker(scene: Scene, method: Method) -> Tracker:
    """Return the tracker of `method` for the scene's device."""
    if isinstance(scene.device, NumpyDevice):
        return _make_numpy_tracker(scene, method)
    return make_device_tracker(scene, method)


def make_device_tracker(scene: Scene, method: Method) -> DeviceTracker:
    """Return the tracker of `method` on OpenCL; only a tracker by voxels needs the scene's grid.

    Raises DeviceError on a NumpyDevice; InputError if the scene lacks a grid that is needed.
    """
    search, objective = SEARCHES[method.search], OBJECTIVES[method.objective]
    return _build_tracker(scene, method, search.tracker, objective.likelihood)


def check_renderer(device: Device | NumpyDevice, method: Method) -> None:
    """Raise InputError unless the renderer of `method` is available."""
    if method.uses_images and method.image.renderer == "opengl":
        if isinstance(device, NumpyDevice):
            raise InputError("OpenGL renders for an OpenCL device; the device is numpy")
        egl_context().release()


def _make_numpy_tracker(scene: Scene, method: Method) -> NumpyTracker:
    check_renderer(scene.device, method)
    search, objective = SEARCHES[method.search], OBJECTIVES[method.objective]
    return _build_tracker(scene, method, search.twin, objective.twin)


def _build_tracker(scene: Scene, method: Method, tracker: str, likelihood: str) -> Any:
    """Return a tracker with its likelihood, both by name, with the settings of its search."""
    more = {name: getattr(method, name) for name in SEARCHES[method.search].settings}
    scored = resolve_name(likelihood)(scene, method)
    return resolve_name(tracker)(scene, likelihood=scored, config=method.filter, **more)


def make_feature_extractor(
    device: Device | NumpyDevice,
    rig: CameraRig,
    background: Background | None,
    config: FeatureConfig | None = None,
    silhouette: SilhouetteConfig | None = None,
) -> AnyFeatures:
    """Return the extractor of image features on `device`, see `Features`."""
    if isinstance(device, NumpyDevice):
        return NumpyFeatures(device, rig, background, config, silhouette)
    return Features(device, rig, background, config, silhouette)


def make_feature_observer(
    device: Device | NumpyDevice,
    footage: FrameSource,
    config: FeatureConfig,
    silhouette: SilhouetteConfig | None = None,
) -> Callable[[Frame], AnyFeatures]:
    """Return a function that computes the image features of a frame of `footage`.

    Without pictures, edges are the outlines of the silhouettes.
    """
    if not footage.has_images:
        config = config.replace(edges="outline")
    features = make_feature_extractor(device, footage.rig, footage.background, config, silhouette)

    def observe(frame: Frame) -> AnyFeatures:
        features(frame)
        return features

    return observe


def draw_poses(
    scene: Scene, poses: np.ndarray, mesh: BodyMesh | None = None, round_ends: bool = False
) -> np.ndarray:
    """Draw `poses` (N, D) into pictures (N, V, H, W, 2) uint8 on the scene's device.

    Channel 0 is the number of the visible part, from 1 (0 is background); channel 1 is 255 on
    edges. mesh: drawn instead of the body's cones. round_ends: draw trapezoids with round ends.
    """
    if not isinstance(scene.device, NumpyDevice):
        return draw_hypotheses(scene, poses, mesh, round_ends)
    rig = scene.rig
    out = np.zeros((len(poses), len(rig), rig.height, rig.width, 2), np.uint8)
    by_camera = render.draw_hypotheses(scene.body, rig, poses, mesh, round_ends)
    for view, pictures in enumerate(by_camera):
        for pose, (parts, edges) in enumerate(pictures):
            height, width = parts.shape
            out[pose, view, :height, :width] = np.stack([parts, 255 * edges], -1)
    return out
