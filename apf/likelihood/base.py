"""Base class of the likelihoods and objectives that a filter evaluates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from apf.body.model import BodyModel
from apf.likelihood.config import KeypointConfig
from apf.likelihood.observations import ObservedPoints
from cl import Array, Launch, Step


class PointSubset(NamedTuple):
    """Every `stride`-th of K surface points, starting at number `first`. Indices wrap around, so
    that all subsets of a stride have the same size."""

    first: int
    stride: int


class Likelihood:
    """Likelihood that scores poses against an observation, on the device and without waiting.

    A subclass must have `errors`, `observe` and `launcher`. All other methods are optional and do
    nothing by default.

    errors: (N,) float32, -log weight of each pose at exponent 1; smaller is better.
    points: (K, 4) float32 surface points, m, that estimates are fitted to; the fourth value is 0
    for unused rows. None: estimates are not fitted to a surface.
    observed: observed points of the body that estimates are fitted to. None: there are none.
    unit: contribution of a term with weight 1 to `errors`, for terms that are added later.
    misfits: (1,) float32, written by `misfit_launcher`. None: the likelihood has none.
    misfits_of_all: whether `rescoring_launcher` can write misfits, too.

    The misfit of a pose is an absolute measure of fit, from 0 (perfect) to 2: the share of the body
    that lies outside the silhouettes, plus the share of the surface voxels that the body does not
    explain. It does not depend on the weights in `errors`, so that it can be compared between
    frames and searches.
    """

    errors: Array
    points: Array | None = None
    observed: ObservedPoints | None = None
    unit: float = 1.0
    misfits: Array | None = None
    misfits_of_all: bool = False

    @property
    def refines(self) -> bool:
        """Whether there are points that estimates are refined on."""
        return self.points is not None or self.observed is not None

    def observe(self, observation: Any) -> None:
        """Enqueue the preparation of a frame."""
        raise NotImplementedError

    def prepare(self, observation: Any) -> Callable[[], None]:
        """Enqueue the part of `observe` that may run during the search of the previous frame;
        return a function that enqueues the rest."""
        return lambda: self.observe(observation)

    def launcher(self, poses: Array) -> Sequence[Step]:
        """Return the launches that score `poses` (N, D) float32 into `errors`."""
        raise NotImplementedError

    def rescoring_launcher(
        self,
        poses: Array,
        errors: Array,
        stride: int = 1,
        least_recall: float = 0.0,
        misfits: Array | None = None,
    ) -> list[Launch]:
        """Return the launches that score `poses` (n, D) into `errors` (n,) for the limb search.

        All poses are scored by the same samples, every `stride`-th of `points`, and by silhouette
        recall with a weight of at least `least_recall`. `misfits` (n,), if given, receives the
        misfits; this needs a stride of 1 and `misfits_of_all`."""
        raise NotImplementedError

    def take_points(self, observed: ObservedPoints, config: KeypointConfig) -> bool:
        """Add the term of observed points, see `KeypointLikelihood`, to all launches made from now
        on. Return False if the likelihood cannot: the caller then adds the term itself."""
        return False

    def misfit_launcher(self, poses: Array) -> list[Launch]:
        """Return the launches that write the misfit of the first of `poses` (.., D)."""
        return []

    def learning_launcher(self, pose: Array) -> list[Launch]:
        """Return the launches that update the learned models after a frame, whose estimate is the
        first row of `pose` (.., D)."""
        return []

    def change_body(self, body: BodyModel) -> None:
        """Score poses of `body`, which differs from the scene's in numbers alone, from now on."""
        raise NotImplementedError

    def forget(self) -> None:
        """Reset the learned models before a new track."""
