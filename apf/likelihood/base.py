"""What a tracker searches with."""

from __future__ import annotations

from typing import Any, Protocol

from cl import Array, Launch


class Scorer(Protocol):
    """Scores poses against what was observed; all on the device, without waiting.

    errors: (N,) float32, -log weight at exponent 1 of each pose: smaller is better. A scorer that
    has `points`, (K, 4) float32 surface points with a fourth value of 0 where there is none, and
    `rescoring_launcher` has the tracker's estimate refined on them (see `VoxelLikelihood`). One
    that has `misfit`, (R,) float32, R the tracker's runs, and `misfit_launcher(poses)`, which fills
    it for the first R of `poses` (.., D), says in absolute terms how badly they fit (see there,
    too). One that has `learner(pose)`, launches, and `forget()` is told every frame's estimate and
    every start; it serves a single run.
    """

    @property
    def errors(self) -> Array: ...

    def observe(self, observation: Any) -> None:
        """Enqueue the preparation of a frame."""

    def launcher(self, poses: Array) -> list[Launch]:
        """The launches that score `poses` (N, D) float32 into `errors`, arguments set."""
