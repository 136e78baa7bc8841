"""Settings of a take: how it is tracked, and from which body and pose."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np

from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.filters.method import Method
from apf.keypoints.keypoints import Keypoints
from cl import InputError

#: The default body: that of Song et al., ten cones, 31 degrees of freedom, and one more, by which
#: the trunk bends sideways.
DEFAULT_BODY = "song32"

#: A body and its pose (D,) in the first frame.
GivenStart: TypeAlias = tuple[BodyModel, np.ndarray]


@dataclass(frozen=True, eq=False)
class TakeSettings:
    """Settings of the stages `initialise` and `track`, and prior knowledge of the person."""

    method: Method = field(default_factory=Method)
    """The search and the likelihood."""
    seeds: tuple[int, ...] = ()
    """Seeds of the runs, one track for each; by default the method's seed. The start always uses
    the method's seed."""
    template: BodyModel | None = None
    """The body whose size is estimated; by default `DEFAULT_BODY`."""
    keep_shape: bool = False
    """Whether the template is the person's own body."""
    height: float | None = None
    """Stature of the person, m, if it is known."""
    given: GivenStart | None = None
    """If given, neither body nor pose is searched for."""
    keypoints: Keypoints | None = None
    """Keypoints of the sequence's cameras and frames. Body, start and poses are fitted to them,
    too."""

    @cached_property
    def body_template(self) -> BodyModel:
        """The given template, or the default body."""
        return self.template or load_body(DEFAULT_BODY)

    @cached_property
    def tracked_method(self) -> Method:
        """The method, with a keypoint term if keypoints are given. Raises InputError if the method
        needs keypoints and none are given."""
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
