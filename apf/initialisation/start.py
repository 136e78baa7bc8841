"""The result of the automatic start, and its error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

import numpy as np
from pydantic import Field

from apf.body.model import BodyModel
from apf.body.stature import stature
from apf.filters.config import FilterConfig
from apf.initialisation.shape_model import SPREAD, ShapeModel
from cl import InputError
from psfs.common.config import Config, natural, positive


class StartConfig(Config):
    """The frames of an automatic start and its searches."""

    SOURCE: ClassVar = "tuned"

    n_frames: int = natural(20, "Most frames that the body is fitted to.")
    duration: float = positive(
        1.0,
        "Time over which these frames are spread; as long as a stride, so that the legs separate.",
        unit="s",
    )
    n_searched: int = natural(
        4, "Number of these frames that are searched over all headings, first and last among them."
    )
    n_headings: int = natural(8, "Number of headings from which the search begins, evenly around.")
    #: A visual hull of few cameras is thicker than the person, so that a wrongly turned or bent
    #: body fills it as well. Silhouettes and edges therefore have more weight than in tracking.
    filter: FilterConfig = Field(
        default_factory=partial(
            FilterConfig.create,
            surface_weight=1.0,
            silhouette_recall_weight=2.0,
            contour_weight=4.0,
            part_colour_weight=0.0,  # the colours of the parts are not estimated yet
        )
    )


#: Factor of the cost of a start with another heading below which it makes this one doubtful.
_DOUBTFUL = 1.05
#: Standard deviations of people's girth beyond which hardly anybody stands or walks.
_STOUT = 3.0


class StartError(InputError):
    """Error of a failed start: the first pose has to be given."""


@dataclass(frozen=True, eq=False)
class Start:
    """A body and its poses in some frames.

    template, shape: the body before and the logs of the scales (S,) that fit it to the person, see
    `ShapeModel`. poses: (M, D) in the frames with the numbers `frames`. best: which of them fits
    best. rival: cost of the best start with another heading, divided by that of this one; infinite
    if there is none. seen: m, height of the visible part of the person. rivals: the start that
    faces away from this one, if there is one; the whole take decides between them.
    """

    template: BodyModel
    shape: np.ndarray
    poses: np.ndarray
    frames: Sequence[int]
    best: int
    rival: float
    seen: float
    rivals: tuple[Start, ...] = ()

    @cached_property
    def body(self) -> BodyModel:
        """The template in the person's size."""
        return ShapeModel(self.template).body(self.shape)

    @property
    def girth(self) -> float:
        """Thickness of the body relative to the height that is seen; of the upright template 1."""
        return float(np.exp(self.shape[:2].sum())) * stature(self.template) / self.seen

    @property
    def pose(self) -> np.ndarray:
        """The pose (D,) that fits best."""
        return self.poses[self.best]

    @property
    def frame(self) -> int:
        """The number of its frame."""
        return self.frames[self.best]

    @property
    def is_ambiguous(self) -> bool:
        """Whether another heading fits nearly as well."""
        return self.rival < _DOUBTFUL

    @property
    def doubts(self) -> list[str]:
        """Doubts about this start, a sentence each."""
        found = []
        if self.is_ambiguous:
            found.append("the heading is ambiguous: another one fits the voxels nearly as well")
        if np.log(self.girth) > _STOUT * SPREAD["girth"]:
            found.append(
                f"the start fits badly: the visible part is {self.seen:.2f} m high and "
                f"{self.girth:.1f} times as thick as people of that height who stand or walk; "
                "it is tracked as if the person stood or walked"
            )
        return found

    @property
    def height(self) -> float:
        """Stature, m."""
        return stature(self.body)


def check_startable(body: BodyModel) -> None:
    """Raise StartError if a body has no automatic start: its root does not move, or its joints do
    not show how tall the person is."""
    kinds = {axis.kind for axis in body.bones[0].axes}
    lacking = [kind for kind in ("tx", "ty", "tz", "rz") if kind not in kinds]
    if lacking:
        raise StartError(
            f"the body {body.name}: its root {body.bones[0].name} has no axes "
            f"{', '.join(lacking)}; expected them, to stand it on the voxels"
        )
    try:
        stature(body)
    except InputError as error:
        raise StartError(str(error)) from None
