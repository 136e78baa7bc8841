"""The required contents of a body's TOML file."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from psfs.common.schema import Name, Positive, Table, flat

#: Most bones, cones, joints and degrees of freedom of one body, and most pairs of them.
MOST, MOST_PAIRS = 200, 2000
#: Largest extent of a body and of its parts, and coordinate of these, m: no person is taller with
#: arms raised.
TALLEST = 3.0

Length = Annotated[float, Field(ge=-TALLEST, le=TALLEST)]
Place = Annotated[list[Length], flat(3)]
Radius = Annotated[float, Field(gt=0, le=1)]
#: Numbers that may be infinite.
Bound = Annotated[float, Field(ge=-math.inf, allow_inf_nan=True)]
Pair = Annotated[list[Name], Field(min_length=2, max_length=2)]


class _Entry(Table):
    model_config = ConfigDict(extra="forbid")


class AxisEntry(_Entry):
    """A free axis.

    limits, rest: m or rad. sigma: per frame at 60 frames/s. posture_sigma: of the posture prior.
    posture_rise: of the posture prior's mean, for the axes of a bone with a parent and a child.
    """

    axis: Literal["tx", "ty", "tz", "rx", "ry", "rz", "-tx", "-ty", "-tz", "-rx", "-ry", "-rz"]
    sigma: Annotated[float, Field(ge=0, le=100)]
    dof: Annotated[int, Field(ge=0, lt=MOST)] | None = None
    name: Name | None = None
    limits: Annotated[list[Bound], Field(min_length=2, max_length=2)] = [-math.inf, math.inf]
    rest: Annotated[float, Field(ge=-1000, le=1000)] = 0.0
    posture_sigma: Annotated[float, Field(gt=0, allow_inf_nan=True)] = math.inf
    posture_rise: Annotated[float, Field(ge=-math.pi, le=math.pi)] = 0.0


class BoneEntry(_Entry):
    """A bone; offset: m in its parent's frame; rest: a rotation."""

    name: Name
    parent: Name | None = None
    offset: Place = [0.0, 0.0, 0.0]
    rest: Annotated[list[float], flat(9)] = [1.0, 0, 0, 0, 1, 0, 0, 0, 1]
    axes: Annotated[list[AxisEntry], Field(max_length=MOST)] = []


class ConeEntry(_Entry):
    """A cone; start, end, radii: m in its bone's frame."""

    name: Name
    bone: Name
    start: Place
    end: Place
    radii: Annotated[list[Radius], flat(2)]
    side: Place = [0.0, 1.0, 0.0]
    scale: Annotated[list[Positive], flat(2)] = [1.0, 1.0]
    in_images: bool = True
    loose: bool = False  # files of earlier versions have it; it says nothing any more


class JointEntry(_Entry):
    """A joint; position: m in its bone's frame."""

    name: Name
    bone: Name
    position: Place = [0.0, 0.0, 0.0]


class BodyEntry(_Entry):
    """A whole body."""

    name: Name
    bone: Annotated[list[BoneEntry], Field(min_length=1, max_length=MOST)]
    cone: Annotated[list[ConeEntry], Field(min_length=1, max_length=MOST)]
    joint: Annotated[list[JointEntry], Field(min_length=1, max_length=MOST)]
    edges: Annotated[list[Pair], Field(max_length=MOST_PAIRS)]
    apart: Annotated[list[Pair], Field(max_length=MOST_PAIRS)] = []


class DerivedEntry(_Entry):
    """A body that begins from another one, `base`: a shipped one or a file.

    scale: of the whole; lengths, radii: factors per scale and radius group, see `BodyModel.scaled`.
    without: bones that go, with all that hangs on them. bone, cone, joint: replace those of the
    same name, or are added. edges, apart: the base's, as far as their ends are left, if not given.
    """

    base: Name
    name: Name
    scale: Positive = 1.0
    lengths: dict[Name, Positive] = {}
    radii: dict[Name, Positive] = {}
    without: list[Name] = []
    bone: Annotated[list[BoneEntry], Field(max_length=MOST)] = []
    cone: Annotated[list[ConeEntry], Field(max_length=MOST)] = []
    joint: Annotated[list[JointEntry], Field(max_length=MOST)] = []
    edges: Annotated[list[Pair], Field(max_length=MOST_PAIRS)] | None = None
    apart: Annotated[list[Pair], Field(max_length=MOST_PAIRS)] | None = None
