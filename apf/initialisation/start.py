"""What the automatic start found, and the error of one that found nothing."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from apf.body.model import BodyModel
from apf.body.stature import stature
from apf.initialisation.config import StartConfig
from cl import InputError


class StartError(InputError):
    """No start was found: a first pose has to be given."""


@dataclass(frozen=True, eq=False)
class Start:
    """A body and its pose in the first frames.

    body: the template in the person's size. pose: (D,) in the first frame. poses: (M, D) in all
    frames fitted. registration_error: mean of these, 0 is perfect, see
    `pose_search.registration_error`. rival: how much worse the best hypothesis that looks elsewhere
    is, as a factor of the cost; infinite where none comes near. seen: m, how high what is seen of
    the person is. girth: how thick the body is for that height, the template standing upright
    being 1.
    """

    body: BodyModel
    pose: np.ndarray
    poses: np.ndarray
    registration_error: float
    rival: float
    seen: float
    girth: float
    config: StartConfig = field(default_factory=StartConfig)

    @property
    def doubts(self) -> list[str]:
        """What speaks against this start, a sentence each."""
        found = []
        if self.rival < self.config.acceptance.rival:
            found.append(
                "it is not sure which way the person looks: another fits the voxels nearly as well"
            )
        if np.log(self.girth) > self.config.acceptance.stout * self.config.shape.prior.girth:
            found.append(
                f"the start fits badly: what is seen is {self.seen:.2f} m high and "
                f"{self.girth:.1f} times as thick as people of that height who stand or walk, as "
                "whom it is tracked"
            )
        return found

    @property
    def height(self) -> float:
        """Stature, m."""
        return stature(self.body)


def check_startable(body: BodyModel) -> None:
    """Raise StartError if a body cannot be stood on voxels by itself: its root does not move, or
    its joints do not show how tall the person is."""
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
