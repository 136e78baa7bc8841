"""Write takes of several people for measuring: other movements than the walks of `apf synth`.

    python scripts/people_takes.py OUT [NAME ...]

Without names it writes all. Settings were chosen with the takes of `DEVELOPED`;
those of `CONFIRMED` were meant to be measured only.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from apf.synthetic import body, generate
from apf.synthetic.body import PersonSurface, Primitive
from apf.synthetic.config import SceneConfig
from apf.synthetic.gait import GaitModel
from apf.synthetic.render import SyntheticScene
from apf.synthetic.skeleton import Motion, SyntheticSkeleton, rotation
from apf.synthetic.walk import Walk
from cl import Device, NumpyDevice, select_device

#: Seconds of every take, and its frame rate.
SECONDS, FPS = 3.0, 20.0
#: Number of a person's primitives; the renderer draws as many for every body.
_N_PRIMITIVES = len(body.make_person())
#: A share (F,) from 0 to 1 for each of the times (F,) s.
Share = Callable[[np.ndarray], np.ndarray]


def ramp(begin: float, end: float) -> Share:
    """Return a share that rises smoothly from 0 at `begin` s to 1 at `end` s."""

    def share(times: np.ndarray) -> np.ndarray:
        u = np.clip((times - begin) / (end - begin), 0, 1)
        return u * u * (3 - 2 * u)

    return share


def hold(begin: float, end: float) -> Share:
    """Return a share that is 1 from `begin` to `end` s, with ramps of half a second."""
    up, down = ramp(begin - 0.5, begin), ramp(end, end + 0.5)
    return lambda times: up(times) - down(times)


def never(times: np.ndarray) -> np.ndarray:
    """Return 0 at all times."""
    return np.zeros_like(times)


@dataclass(frozen=True)
class Mover:
    """A person who walks on a straight line.

    start: (x, y) m on the floor at time 0. heading: degrees. stands: when the person stands still
    (share of the speed that is lost). reach: when the right hand reaches ahead; lift: when both
    arms are lifted sideways; crouch: when the knees are bent. present: from and to which s the
    person is there. shirt: which of the colours; None for a colour of their own.
    """

    start: tuple[float, float]
    heading: float
    stature: float = 1.75
    speed: float = 1.15
    stands: Share = never
    reach: Share = never
    lift: Share = never
    crouch: Share = never
    present: tuple[tuple[float, float], ...] = ((0.0, 1e3),)
    shirt: int | None = None


@dataclass(frozen=True)
class Thing:
    """An object that is moved: a `ball` that bounces, or a `trolley`, from start by velocity."""

    kind: str
    start: tuple[float, float]
    velocity: tuple[float, float]


@dataclass(frozen=True)
class TakeOfPeople:
    """A take: who moves in it, before how many cameras, and by which seed it is furnished."""

    movers: tuple[Mover, ...]
    cameras: int = 6
    seed: int = 1
    things: tuple[Thing, ...] = field(default=())


_CHAT = hold(1.3, 1e3)

DEVELOPED = {
    "cross": TakeOfPeople((Mover((-1.7, 0.2), 0), Mover((0.25, -1.15), 90, 1.62)), seed=51),
    "shake": TakeOfPeople(
        (Mover((-1.55, 0.05), 0, stands=_CHAT, reach=hold(1.5, 2.6)),
         Mover((1.55, -0.05), 180, 1.68, stands=_CHAT, reach=hold(1.5, 2.6))), seed=52),
    "close": TakeOfPeople(
        (Mover((-0.2, 0.2), 170, stands=hold(-1, 1.0), lift=hold(2.2, 2.9)),
         Mover((0.2, -0.15), -20, 1.82, stands=hold(-1, 0.8))), seed=53),
    "alike": TakeOfPeople(
        (Mover((-1.7, 0.2), 10, shirt=1), Mover((1.7, 0.6), 200, 1.72, shirt=1)), seed=54),
    "four": TakeOfPeople(
        (Mover((-1.6, -0.5), 20, lift=hold(1, 2.5)), Mover((1.5, 0.9), 190, 1.6)), 4, seed=55),
    "trio": TakeOfPeople(
        (Mover((-1.4, 0.5), 0), Mover((1.6, -0.1), 180, 1.65), Mover((0.6, -1.9), 90, 1.85)), 8,
        seed=56),
    "trolley": TakeOfPeople(
        (Mover((-1.6, 0.3), 0),), seed=57, things=(Thing("trolley", (1.5, -0.6), (-0.7, 0.0)),)),
    "abreast": TakeOfPeople(
        (Mover((0.3, -1.5), 90, 1.7), Mover((-0.27, -1.45), 90, 1.78)), seed=91),
}  # fmt: skip

CONFIRMED = {
    "pass": TakeOfPeople((Mover((-1.7, 0.27), 0, 1.83), Mover((1.7, -0.27), 180, 1.7)), 5, seed=61),
    "meet": TakeOfPeople(
        (Mover((-0.1, -1.6), 90, 1.6, stands=_CHAT, reach=hold(1.6, 2.7)),
         Mover((0.0, 1.5), -90, 1.8, stands=_CHAT, reach=hold(1.4, 2.7), crouch=_CHAT)),
        seed=62),
    "beside": TakeOfPeople(
        (Mover((-1.5, 0.3), 0), Mover((-1.45, -0.3), 0, 1.66, crouch=hold(1.5, 2))), seed=63),
    "late": TakeOfPeople(
        (Mover((-1.9, 0.5), 0, speed=0.7, lift=hold(0.5, 3)),
         Mover((0.5, -1.9), 95, 1.68, present=((1.4, 1e3),))), seed=64),
    "twins": TakeOfPeople(
        (Mover((-1.6, -0.3), 0, 1.74, shirt=3), Mover((0.2, 2.2), -90, 1.74, shirt=3)), seed=65),
    "four2": TakeOfPeople(
        (Mover((0.4, -1.7), 90, 1.7), Mover((-0.5, 0.2), 0, 1.8, stands=lambda t: 0 * t + 0.95,
                                           lift=hold(0.8, 2), crouch=hold(2.6, 3.4))),
        4, seed=66),
    "trio2": TakeOfPeople(
        (Mover((-1.6, -0.6), 10, 1.58), Mover((1.2, 0.7), 180, 1.78, shirt=2),
         Mover((0.3, -1.0), 95, 1.7, shirt=2, lift=hold(1.5, 3))), 8, seed=67),
    "ball": TakeOfPeople(
        (Mover((-1.6, 0.2), 0), Mover((1.4, 0.9), 180, 1.7)), seed=68,
        things=(Thing("ball", (1.2, -1.0), (-0.8, 0.3)),)),
    "cart": TakeOfPeople(
        (Mover((0.2, -1.6), 90, 1.8, speed=0.9),), 5, seed=69,
        things=(Thing("trolley", (0.35, -0.8), (0.05, 0.85)),)),
    "abreast8": TakeOfPeople(
        (Mover((1.45, -0.3), 180, 1.62), Mover((1.5, 0.26), 180, 1.8)), 8, seed=92),
}  # fmt: skip


class MoverGait(GaitModel):
    """The motion of a `Mover`."""

    def __init__(self, mover: Mover, seed: int) -> None:
        walk = Walk.sample(seed, mover.stature, np.radians(mover.heading))
        slow = mover.speed / 1.15
        self._mover, self._times = mover, np.zeros(0)
        super().__init__(replace(walk, speed=mover.speed, stride=walk.stride * slow**0.5))

    def motion(self, times: np.ndarray) -> Motion:
        """Return the placement of all bones at `times` (F,) s."""
        mover, self._times = self._mover, times
        pace = 1 - mover.stands(times)
        walked = np.concatenate([[0.0], np.cumsum((pace[1:] + pace[:-1]) / 2 * np.diff(times))])
        moved = super().motion(walked)
        return Motion(moved.rotations, moved.positions + np.array([*mover.start, 0.0]))

    def _trunk(
        self, times: np.ndarray, phase: np.ndarray
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        root, local = super()._trunk(times, phase)
        if len(self._times) == len(times):
            root[:, 2] -= 0.2 * self._mover.crouch(self._times)
        return root, local

    def _swing_arm(self, local: dict[str, np.ndarray], side: str, phase: np.ndarray) -> None:
        super()._swing_arm(local, side, phase)
        if len(self._times) != len(phase):
            return
        out, deg, count = (1.0 if side == "l" else -1.0), np.pi / 180, len(phase)
        lift = self._mover.lift(self._times) * (85 + 10 * np.sin(4 * self._times)) * deg
        reach = self._mover.reach(self._times) * deg * (side == "r")
        shake = 6 * np.sin(12 * self._times)
        local[f"{side}_upper_arm"] = (
            rotation("x", out * lift) @ rotation("y", -(48 + shake) * reach)
            @ local[f"{side}_upper_arm"]
        )  # fmt: skip
        local[f"{side}_forearm"] = (
            rotation("y", -(22 - shake) * reach, count) @ local[f"{side}_forearm"]
        )


class Person:
    """One person of a take, as the scene uses its walkers. joints: (F, J, 3) m."""

    def __init__(
        self,
        skeleton: SyntheticSkeleton,
        motion: Motion,
        primitives: list[Primitive] | None = None,
    ) -> None:
        self._motion = motion
        self.joints = skeleton.joints(motion)
        self._flesh = PersonSurface(skeleton, primitives)

    def move(self, by: np.ndarray) -> None:
        """Move the person by (3,) m."""
        self._motion.positions[:] += by
        self.joints += by

    def posed(self, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return primitives, balls, and the centre (2,) m of the shadow map."""
        primitives = self._flesh.packed(self._motion, index)
        return primitives, self._flesh.balls(primitives), self.joints[index, 0, :2]


def _shape(kind: str) -> list[Primitive]:
    """Return the primitives of an object about the floor below it, as many as a person has."""
    skirt: list[Primitive] = []
    if kind == "ball":
        skirt.append(Primitive("pelvis", (0, 0, 0.12), (0, 0, 0.12), 0.12, 0.12, 0))
    else:  # two boards on four posts, and a box
        for height in (0.2, 0.55, 0.9):
            ends = (-0.25, 0, height), (0.25, 0, height)
            skirt.append(Primitive("pelvis", *ends, 0.06, 0.06, 1, squash=(1.0, 3.0)))
        for x in (-0.25, 0.25):
            for y in (-0.14, 0.14):
                skirt.append(Primitive("pelvis", (x, y, 0.05), (x, y, 0.95), 0.025, 0.025, 4))
        skirt.append(Primitive("pelvis", (0, 0, 0.72), (0, 0, 0.74), 0.14, 0.14, 0))
    hidden = Primitive("pelvis", (0, 0, -3.0), (0, 0, -3.0), 0.03, 0.03, 0)
    return skirt + [hidden] * (_N_PRIMITIVES - len(skirt))


class _Object:
    """An object of a take, drawn as people are."""

    def __init__(self, thing: Thing, times: np.ndarray) -> None:
        skeleton = SyntheticSkeleton(body.TABLE_HEIGHT)
        made = body.make_person
        body.make_person = lambda: _shape(thing.kind)  # the surface is a person's otherwise
        try:
            self._flesh = PersonSurface(skeleton)
        finally:
            body.make_person = made
        floor = np.array(thing.start) + times[:, None] * thing.velocity
        bounce = 0.5 * abs(np.sin(5 * times)) if thing.kind == "ball" else 0 * times
        root = np.column_stack([floor, bounce])
        self._motion, self._floor = skeleton.forward(root, {}), floor

    def posed(self, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return primitives, balls, and the centre (2,) m of the shadow map."""
        primitives = self._flesh.packed(self._motion, index)
        balls = self._flesh.balls(primitives)
        return primitives, balls[balls[:, 2] > 0], self._floor[index]


class _Scene(SyntheticScene):
    """The scene of a take."""

    def __init__(
        self, take: TakeOfPeople, config: SceneConfig, device: Device | NumpyDevice
    ) -> None:
        bodies = len(take.movers) + len(take.things)
        super().__init__(config.replace(people=max(2, bodies)), device)
        times = np.arange(config.frames) / config.fps
        gaits = [MoverGait(mover, take.seed + k) for k, mover in enumerate(take.movers)]
        people = [Person(gait.skeleton, gait.motion(times)) for gait in gaits]
        things = [_Object(thing, times) for thing in take.things]
        self._walkers = [*people, *things]  # type: ignore[list-item]
        self._there = np.ones((bodies, config.frames), bool)
        for there, mover in zip(self._there, take.movers, strict=False):
            there[:] = np.any([(a <= times) & (times < b) for a, b in mover.present], axis=0)
        joints = np.stack([person.joints for person in people])
        self.people_joints = np.where(self._there[: len(people), :, None, None], joints, np.nan)
        self.joints = joints[0]
        self._palettes = list(self._palettes[:bodies])
        for k, mover in enumerate(take.movers):
            if mover.shirt is not None:
                self._palettes[k] = self._palettes[mover.shirt % len(self._palettes)]
        shapes = [walker.posed(0) for walker in self._walkers]
        self._n_balls = max(self._n_balls, *(len(balls) for _, balls, _ in shapes))


def render_take(
    folder: Path,
    config: SceneConfig,
    device: Device | NumpyDevice,
    make_scene: Callable[[SceneConfig, Device | NumpyDevice], SyntheticScene],
) -> None:
    """Write a take as `apf synth` does, of another scene."""
    made = generate.SyntheticScene
    generate.SyntheticScene = make_scene  # type: ignore
    try:
        generate.generate(folder, config, device)
    finally:
        generate.SyntheticScene = made  # type: ignore[misc]


def write_take(folder: Path, take: TakeOfPeople, device: Device | NumpyDevice) -> None:
    """Write a take as `apf synth` does."""
    config = SceneConfig(
        people=max(2, len(take.movers) + len(take.things)), cameras=take.cameras, seed=take.seed,
        frames=round(SECONDS * FPS), fps=FPS,
    )  # fmt: skip
    render_take(folder, config, device, partial(_Scene, take))


def main() -> None:
    """Write the takes that are named."""
    takes = DEVELOPED | CONFIRMED
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", choices=[*takes, []], metavar="NAME")
    args = parser.parse_args()
    device = select_device("auto")
    for name in args.names or takes:
        write_take(args.folder / name, takes[name], device)


if __name__ == "__main__":
    sys.exit(main())
