"""What the terms of the voxels' likelihood have in common, on the device and in NumPy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pkgutil import resolve_name

import numpy as np

from apf.body.model import BodyModel
from apf.likelihood.terms import TERMS, TermSettings
from apf.scene import Scene
from cl import Array, Launch
from cl.signature import Argument
from cl.stage import Stage
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.host_voxels import HostVoxels


@dataclass(frozen=True, eq=False)
class Shared:
    """What the voxels' likelihood shares with its terms.

    n_runs: of the tracker, one after the other in each array of poses. velocity: share of the last
    change that is expected again. cameras: the packed rig. maps: (V, H, W, 2) uint8 of the frame
    that is prepared. seen: by name the two arrays, of which the first is written while a frame is
    prepared and the second read while it is searched; see `Ahead`.
    """

    scene: Scene
    n_runs: int
    velocity: float
    cameras: Array
    maps: Array
    seen: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)


class Term(Stage):
    """A term on the device. Its constructor takes `Shared` and the term's settings.

    A subclass has `launcher`, or `score_arguments` where the kernel score_poses adds the term up
    itself. What else it does not override does nothing.

    uses_pictures: whether it observes pictures.
    """

    uses_pictures = False

    def observe(self, voxels: Voxels, pictures: Array | None) -> None:
        """Enqueue what the term makes of a frame, whose maps are made: of its voxels and, where the
        term uses them and the frame has them, pictures (V, H, W, 3) uint8 BGR."""

    def launcher(self, poses: Array, weight: float, errors: Array) -> list[Launch]:
        """Return the launches that add `weight` times the term's error to `errors` (n,) of `poses`
        (n, D)."""
        return []

    def learning_launcher(self, pose: Array) -> list[Launch]:
        """Return the launches that learn from a frame whose runs' estimates are the first of `pose`
        (.., D)."""
        return []

    def change_body(self, body: BodyModel) -> None:
        """Take `body`, which differs from the one before in numbers alone, from now on."""

    def forget(self, run: int | None = None) -> None:
        """Forget what was learnt, of one run or of all: a new track begins."""

    def score_arguments(self) -> dict[str, Argument]:
        """Return the arguments of score_poses that are the term's, but its weight."""
        return {}

    def score_weights(self) -> dict[str, float]:
        """Return the weight of the term in score_poses for the frame observed last, by the name of
        the argument; 0 where nothing is known."""
        return {}


def made_terms(shared: Shared, settings: Mapping[str, TermSettings]) -> dict[str, Term]:
    """Return the registered terms of these `settings`, by name, on the device."""
    return {name: resolve_name(TERMS[name].launcher)(shared, own) for name, own in settings.items()}


@dataclass(frozen=True, eq=False)
class SharedTwin:
    """What the twin of the likelihood shares with the terms' twins; rows: see `sample_rows`."""

    scene: Scene
    velocity: float
    rows: np.ndarray


class TermTwin:
    """A term in NumPy, float64; as `Term`."""

    def observe(self, voxels: HostVoxels, maps: np.ndarray) -> None:
        """Take a frame: its voxels, and their maps (V, H, W, 2)."""

    def errors(self, poses: np.ndarray) -> np.ndarray:
        """Return the term's errors (N,) of poses (N, D), without its weight."""
        return np.zeros(len(poses))

    def view_errors(self, view: int, cones: np.ndarray) -> np.ndarray | None:
        """Return the errors (N,) of posed cones (N, C, 16) in a camera that sees them, times the
        weight, of a term that score_poses adds up; None of others and where nothing is known."""
        return None

    def learn(self, pose: np.ndarray) -> None:
        """Learn from a frame whose estimate is `pose` (D,)."""

    def forget(self) -> None:
        """Forget what was learnt: a new track begins."""
