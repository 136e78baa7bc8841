"""The result of the automatic start, and its error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from apf.body.model import BodyModel
from apf.body.stature import stature
from apf.initialisation.shape_model import SPREAD
from cl import InputError

#: Factor of the cost up to which a start with another heading is followed through the take, which
#: decides between them, and below which it makes this one doubtful.
RIVAL, _DOUBTFUL = 1.25, 1.05
#: Standard deviations of people's girth beyond which hardly anybody stands or walks.
_STOUT = 3.0


class StartError(InputError):
    """Error of a failed start: the first pose has to be given."""


@dataclass(frozen=True, eq=False)
class Start:
    """A body and its pose in the first frame.

    body: the template in the person's size. pose: (D,). rival: cost of the best start with another
    heading, divided by that of this one; infinite if there is none. seen: m, height of the visible
    part of the person. girth: thickness of the body relative to that height; that of the upright
    template is 1. rivals: the starts with other headings that cost up to `RIVAL` times as much.
    """

    body: BodyModel
    pose: np.ndarray
    rival: float
    seen: float
    girth: float
    rivals: tuple[Start, ...] = ()

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
