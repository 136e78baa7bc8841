"""How a take is tracked, and from where."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from apf.body import BodyModel, load_body
from apf.filters.method import Method
from apf.keypoints.keypoints import Keypoints
from cl import InputError

#: The body that is tracked where none is named: Song et al.'s, ten cones, 31 degrees of freedom.
DEFAULT_BODY = "song31"


@dataclass(frozen=True, eq=False)
class TakeSettings:
    """Settings of the stages `initialise` and `track`, and what is known before them."""

    method: Method = field(default_factory=Method)
    """The search and what it compares."""
    seeds: tuple[int, ...] = ()
    """Seeds of the runs, a track each; by default the method's own. The start takes that one."""
    template: BodyModel | None = None
    """The body whose size is searched for; by default `DEFAULT_BODY`."""
    keep_shape: bool = False
    """Whether the template is the person's own body."""
    height: float | None = None
    """Stature of the person, m, if it is known."""
    given: tuple[BodyModel, np.ndarray] | None = None
    """A body and its pose (D,) in the first frame, which then are not searched for."""
    keypoints: Keypoints | None = None
    """Keypoints of the sequence's cameras and frames. Body, start and every pose follow them, too.
    """

    @cached_property
    def body_template(self) -> BodyModel:
        """The template, or the default body."""
        return self.template or load_body(DEFAULT_BODY)

    @cached_property
    def tracked_method(self) -> Method:
        """The method, with its term for keypoints if there are keypoints. Raises InputError for a
        method that needs keypoints without any."""
        if self.keypoints is not None:
            n_cameras, _, n_points = self.keypoints.points.shape[:3]
            return self.method.with_keypoints(n_cameras * n_points)
        if self.method.uses_keypoints:
            raise InputError("a likelihood with keypoints, but none were given; expected some")
        return self.method

    @property
    def run_seeds(self) -> list[int]:
        """The seeds of the runs."""
        return list(self.seeds) or [self.method.filter.search.seed]
