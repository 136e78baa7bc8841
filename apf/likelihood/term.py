"""Base classes of the voxel likelihood's terms, on the device and in NumPy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pkgutil import resolve_name

import numpy as np

from apf.body.model import BodyModel
from apf.likelihood.terms import TERMS, TermSettings
from apf.scene import Scene
from cl import Array, Launch
from cl.device import Stage
from cl.signature import Argument
from psfs.voxels.device_voxels import CarvedVoxels
from psfs.voxels.host_voxels import HostVoxels


@dataclass(frozen=True, eq=False)
class Shared:
    """Data that the voxel likelihood shares with its terms.

    cameras: the packed rig. maps: (V, H, W, 2) uint8 of the frame that is being prepared. seen:
    pairs of arrays by name; the preparation of a frame writes the first, its search reads the
    second, see `Ahead`.
    """

    scene: Scene
    cameras: Array
    maps: Array
    seen: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)


class Term(Stage):
    """Term of the voxel likelihood on the device; constructed from `Shared` and its settings.

    A subclass implements `launcher`, or `score_arguments` if the kernel score_poses computes the
    term. The other methods do nothing by default.

    uses_pictures: whether the term observes pictures.
    """

    uses_pictures = False

    def observe(self, voxels: CarvedVoxels, pictures: Array | None) -> None:
        """Enqueue the term's preparation of a frame; its maps are made before.

        pictures: (V, H, W, 3) uint8 BGR; None if no term uses them or the frame has none."""

    def launcher(self, poses: Array, weight: float, errors: Array) -> list[Launch]:
        """Return the launches that add `weight` times the term's error to `errors` (n,) of `poses`
        (n, D)."""
        return []

    def learning_launcher(self, pose: Array) -> list[Launch]:
        """Return the launches that update the term's learned model after a frame, whose estimate is
        the first row of `pose` (.., D)."""
        return []

    def change_body(self, body: BodyModel) -> None:
        """Take `body`, which differs from the one before in numbers alone, from now on."""

    def forget(self) -> None:
        """Reset the learned model before a new track."""

    def score_arguments(self) -> dict[str, Argument]:
        """Return the term's arguments of score_poses, except its weight."""
        return {}

    def score_weights(self) -> dict[str, float]:
        """Return the weight of the term in score_poses for the frame observed last, by the name of
        the argument; 0 where nothing is known."""
        return {}


def make_terms(shared: Shared, settings: Mapping[str, TermSettings]) -> dict[str, Term]:
    """Return the registered terms of these `settings`, by name, on the device."""
    return {name: resolve_name(TERMS[name].launcher)(shared, c) for name, c in settings.items()}


@dataclass(frozen=True, eq=False)
class SharedTwin:
    """Data that the likelihood's twin shares with the terms' twins; rows: see
    `make_sample_rows`."""

    scene: Scene
    rows: np.ndarray


class TermTwin:
    """Term of the voxel likelihood in NumPy, float64. Twin of `Term`."""

    def observe(self, voxels: HostVoxels, maps: np.ndarray) -> None:
        """Take a frame: its voxels, and their maps (V, H, W, 2)."""

    def errors(self, poses: np.ndarray) -> np.ndarray:
        """Return the term's errors (N,) of poses (N, D), without its weight."""
        return np.zeros(len(poses))

    def view_errors(self, view: int, cones: np.ndarray) -> np.ndarray | None:
        """Return the weighted errors (N,) of posed cones (N, C, 16) in a camera that sees them, for
        a term that score_poses computes; None for other terms and without data."""
        return None

    def learn(self, pose: np.ndarray) -> None:
        """Update the learned model after a frame whose estimate is `pose` (D,)."""

    def forget(self) -> None:
        """Reset the learned model before a new track."""
