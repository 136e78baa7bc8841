"""Settings of synthetic sequences."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Literal, get_args

from pydantic import model_validator

from cl import InputError
from psfs.common.config import Config, fraction, setting

if TYPE_CHECKING:
    from apf.synthetic.walk import Walk

#: Ways to walk: around the middle of the room, straight at the first camera, or straight between
#: two cameras.
CourseKind = Literal["round", "straight", "diagonal"]


class SceneConfig(Config):
    """A synthetic sequence."""

    SOURCE: ClassVar = "by hand: a small sequence with what usual cameras show"

    cameras: int = setting(
        4, "Number of cameras on a ring around the person.", least=1, most=64, flag="--cameras"
    )
    frames: int = setting(
        60, "Number of frames per camera.", least=1, most=1_000_000, flag="--frames"
    )
    fps: float = setting(30.0, "Frame rate.", unit="frames/s", least=1, most=1000, flag="--fps")
    size: tuple[int, int] = setting(
        (640, 480),
        "Width and height of the pictures, each even and from 32 to 8192.",
        unit="px",
        flag="--size",
        flag_help="width and height of the pictures, px",
        metavar="WxH",
    )
    seed: int = setting(
        1,
        "Seed of person, walk, room, cameras and noise.",
        "any",
        least=0,
        most=2**63,
        flag="--seed",
    )
    noise: float = setting(
        2.5,
        "Standard deviation of the sensor's noise.",
        unit="grey levels",
        least=0,
        most=50,
        flag="--noise",
    )
    flicker: float = setting(
        0.01, "Relative standard deviation of each frame's gain.", least=0, most=0.2
    )
    height: float = setting(
        1.76, "Stature of the person.", unit="m", least=1.2, most=2.2, flag="--height"
    )
    course: CourseKind = setting(
        "round",
        "Where the person walks: round the middle of the room, straight at the first camera, or on "
        "the diagonal between two cameras (P1S and P1D in Rymut 2016, 6.7).",
        choices=get_args(CourseKind),
        flag="--course",
    )
    shadow: float = fraction(
        1.0, "Strength of the person's shadow on the floor; 0 for diffuse light.", flag="--shadow"
    )

    people: int = setting(
        1, "Number of people, who walk on two courses.", least=1, most=9, flag="--people"
    )
    visitor: bool = setting(
        False,
        "Whether the last person comes after a third of the frames, leaves after two thirds and "
        "comes back for the last sixth.",
        flag="--visitor",
    )

    body: str | None = setting(
        None,
        "Body, shipped or a file, that goes about in place of a person; its cones are filmed.",
        flag="--body",
        flag_help="film this body, shipped or a TOML file, in place of a person",
        metavar="BODY",
    )

    @model_validator(mode="after")
    def _can_be_drawn(self) -> SceneConfig:
        for side in self.size:
            if not 32 <= side <= 8192 or side % 2:  # of which H.264 codes pairs
                raise InputError(f"size is {self.size} px; expected even sides from 32 to 8192 px")
        if self.body is not None and self.people > 1:
            raise InputError(f"people is {self.people}; expected 1 with a body")
        if self.visitor and self.people < 2:
            raise InputError("visitor needs somebody to visit; expected people of 2 or more")
        return self

    @property
    def walk(self) -> Walk:
        from apf.synthetic.walk import Walk

        return Walk.sample(self.seed, self.height, self._heading)

    @property
    def _heading(self) -> float | None:
        """Direction of a straight walk, rad; None for a round one."""
        import numpy as np

        if self.course == "round":
            return None
        # of the first camera, but for a random part of the cameras' spacing
        bearing = float(np.random.default_rng([self.seed, 2]).uniform(0.0, 2 * np.pi))
        beside = math.pi / self.cameras if self.course == "diagonal" else 0.0
        return bearing + beside
