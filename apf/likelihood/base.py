"""What a filter searches with: the base of likelihoods and objectives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from apf.body.model import BodyModel
from apf.likelihood.config import KeypointConfig
from apf.likelihood.observations import ObservedPoints
from cl import Array, Launch, Step


class PointSubset(NamedTuple):
    """Every `stride`-th of K surface points from number `first` on; after the last the first again,
    so that all subsets of a stride have the same size."""

    first: int
    stride: int


class Likelihood:
    """Scores poses against what was observed; all on the device, without waiting.

    A subclass has `errors`, `observe` and `launcher`. The rest is optional: what a likelihood does
    not override does nothing, and the filter does without it.

    errors: (N,) float32, -log weight at exponent 1 of each pose; smaller is better.
    points: (K, 4) float32 surface points, m, that estimates are refined on; the fourth value is 0
    where there is none. None: estimates stay the particles' mean.
    observed: points of the body that estimates are refined on. None: on none.
    unit: what a term of weight 1 counts in `errors`, for terms that are added to them.
    misfits: (R,) float32 of R runs, which `misfit_launcher` fills. None: not known.
    misfits_of_all: whether `rescoring_launcher` knows them, too.

    The misfit of a pose states in absolute terms how badly it fits: the share of the body that lies
    outside the silhouettes plus the share of the surface voxels that the body leaves unexplained, 0
    (perfect) to 2. It depends on no weight of `errors`, so that frames and searches compare.
    """

    errors: Array
    points: Array | None = None
    observed: ObservedPoints | None = None
    unit: float = 1.0
    misfits: Array | None = None
    misfits_of_all: bool = False

    @property
    def refines(self) -> bool:
        """Whether there is something that estimates are refined on."""
        return self.points is not None or self.observed is not None

    def observe(self, observation: Any) -> None:
        """Enqueue the preparation of a frame."""
        raise NotImplementedError

    def prepare(self, observation: Any) -> Callable[[], None]:
        """Enqueue what of `observe` may be done while the frame before is still searched; return
        what enqueues the rest."""
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
        """Return the launches that score `poses` (n, D) into `errors` (n,), all by the same: every
        `stride`-th of `points`, and silhouette recall with a weight of at least `least_recall`.
        `misfits` (n,) gets theirs, for a stride of 1, of likelihoods that have `misfits_of_all`.
        Asked for by the limb search, where there are `points`."""
        raise NotImplementedError

    def take_points(self, observed: ObservedPoints, config: KeypointConfig) -> bool:
        """Add the term of observed points, see `KeypointLikelihood`, to the errors of all launches
        that are asked for from now on. False, of a likelihood that cannot, leaves it to others."""
        return False

    def misfit_launcher(self, poses: Array) -> list[Launch]:
        """Return the launches that put into `misfits` those of the first R of `poses` (.., D)."""
        return []

    def learning_launcher(self, pose: Array) -> list[Launch]:
        """Return the launches that learn from a frame whose estimate is the first of `pose`
        (.., D)."""
        return []

    def change_body(self, body: BodyModel) -> None:
        """Score poses of `body`, which differs from the scene's in numbers alone, from now on."""
        raise NotImplementedError

    def forget(self, run: int | None = None) -> None:
        """Forget what was learnt, of one run or of all: a new track begins."""
