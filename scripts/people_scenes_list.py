"""The takes of `people_scenes.py`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from people_takes import Mover, Share, hold, never, ramp

FPS = 30.0
Spans = tuple[tuple[float, float], ...]
_ALWAYS: Spans = ((0.0, 1e3),)

_BOX, _SALSA, _JACKS = "synth_box_4cam", "synth_salsa_4cam_hd", "synth_jacks_6cam"
_PICKUP, _KICK, _RUN = "synth_pickup_6cam", "synth_kick_8cam", "synth_run_6cam"
_WALK, _CHAIR, _SKIRT = "synth_walk_8cam", "hard_chair_6cam", "hard_skirt_4cam"
_REAL, _NOPLATE, _LIGHT = "hard_real_5cam", "hard_noplate_6cam", "hard_light_6cam"
_MAN, _WOMAN = "hard_duo_6cam:0", "hard_duo_6cam:1"


@dataclass(frozen=True)
class Act:
    """A person who moves as one of a sequence does.

    motion: the sequence, and after a colon the number of the person in it. at: (x, y) m of the
    middle of the path. turn, bend: degrees, by which the motion is turned, and in the course of the
    take about the person, so that the path is bent. begin, every: first frame, and step of frames;
    at its end the motion goes back. girth: factor of the trunk's radii. there: spans, s, in which
    the person is there.
    """

    motion: str
    at: tuple[float, float]
    turn: float
    stature: float
    begin: int = 0
    every: int = 1
    bend: float = 0.0
    girth: float = 1.0
    there: Spans = _ALWAYS


@dataclass(frozen=True)
class Sitter(Mover):
    """A person who walks, and sits on a block (share `sit`); `there` as of an Act."""

    sit: Share = never
    there: Spans = _ALWAYS


@dataclass(frozen=True)
class Scene:
    """A take.

    empty: whether the empty room is filmed. off: degrees by which each camera is turned in the
    calibration. light: whether the light changes. apart: least distance of two people's joints, m.
    """

    cameras: int
    seed: int
    acts: tuple[Act | Sitter, ...]
    frames: int = 72
    empty: bool = True
    off: float = 0.0
    light: bool = False
    apart: float = 0.18

    @property
    def times(self) -> np.ndarray:
        """Times (F,) s of the frames."""
        return np.arange(self.frames) / FPS

    def show(self, act: Act | Sitter) -> np.ndarray:
        """Return the frames (F,) bool in which somebody is there."""
        return np.any([(a <= self.times) & (self.times < b) for a, b in act.there], axis=0)


def _always(times: np.ndarray) -> np.ndarray:
    return np.ones_like(times)


def _down(begin: float, end: float) -> Share:
    """Return a share that falls smoothly from 1 at `begin` s to 0 at `end` s."""
    return lambda times: 1 - ramp(begin, end)(times)


_CHAT = hold(1.2, 1e3)
SCENES = {
    "across4": Scene(
        4,
        701,
        (Act(_WALK, (0.1, 0.1), 20, 1.78, every=2), Act(_CHAIR, (0.0, -0.2), 110, 1.66, begin=20)),
        80,
    ),
    "circle5": Scene(
        5,
        702,
        (
            Act(_WALK, (0.5, 0.0), 0, 1.82, bend=150),
            Act(_WALK, (-0.35, 0.0), 180, 1.62, begin=20, bend=150),
        ),
        90,
        apart=0.14,
    ),
    "shake5": Scene(
        5,
        703,
        (
            Sitter((-1.1, -1.1), 45, 1.80, stands=_CHAT, reach=hold(1.5, 2.4), lift=hold(3.0, 3.4)),
            Sitter((1.0, 1.15), 225, 1.60, stands=_CHAT, reach=hold(1.4, 2.4)),
        ),
        108,
    ),
    "sit6": Scene(
        6,
        704,
        (
            Sitter((-0.7, 0.3), 0, 1.78, stands=_down(1.6, 2.0), sit=_down(0.8, 1.6)),
            Act(_REAL, (0.8, -0.7), 120, 1.68, begin=10),
        ),
        100,
    ),
    "sit4": Scene(
        4,
        705,
        (
            Sitter((0.6, -0.4), 180, 1.66, stands=_always, lift=hold(0.5, 0.9), sit=ramp(1.3, 2.1)),
            Act(_WALK, (0.1, 0.65), 185, 1.84, begin=0, every=2),
        ),
        84,
    ),
    "pickrun5": Scene(
        5,
        706,
        (Act(_PICKUP, (0.1, 0.0), 40, 1.72, begin=15), Act(_RUN, (-0.3, 0.2), 100, 1.80, begin=14)),
        76,
    ),
    "enter6": Scene(
        6,
        707,
        (
            Act(_LIGHT, (0.1, -0.2), 300, 1.70, begin=15),
            Act(_WALK, (-0.3, 0.25), 70, 1.80, every=2, there=((0.7, 2.3),)),
        ),
        84,
    ),
    "noempty6": Scene(
        6,
        708,
        (Act(_NOPLATE, (0.0, 0.3), 30, 1.84, begin=5), Act(_SALSA, (0.1, -0.6), 190, 1.64)),
        108,
        empty=False,
    ),
    "off5": Scene(
        5,
        709,
        (Act(_SALSA, (0.2, 0.3), 70, 1.70, begin=5), Act(_REAL, (-0.3, -0.3), 250, 1.78, begin=20)),
        80,
        off=0.5,
    ),
    "light6": Scene(
        6,
        710,
        (Act(_KICK, (0.4, 0.1), 80, 1.74, begin=5), Act(_SKIRT, (-0.4, -0.1), 200, 1.66, begin=10)),
        90,
        light=True,
    ),
    "jackduo8": Scene(
        8,
        711,
        (
            Act(_JACKS, (0.2, 0.3), 160, 1.76, begin=5),
            Act(_WOMAN, (-0.2, -0.2), 310, 1.63, begin=10),
        ),
        80,
    ),
    "trioA8": Scene(
        8,
        712,
        (
            Act(_WALK, (0.0, 0.05), 130, 1.80, every=2),
            Act(_BOX, (0.6, 0.4), 220, 1.66, begin=10),
            Act(_PICKUP, (-0.6, -0.4), 30, 1.74, begin=25),
        ),
        80,
    ),
    "trioB8": Scene(
        8,
        713,
        (
            Act(_WOMAN, (0.2, -0.1), 200, 1.63, begin=5),
            Act(_SALSA, (-0.5, 0.4), 90, 1.72, begin=10),
            Act(_MAN, (0.3, 0.1), 40, 1.84),
        ),
        96,
        off=0.5,
        apart=0.15,
    ),
    "trioC8": Scene(
        8,
        714,
        (
            Sitter((-0.7, 0.6), 0, 1.70, stands=_down(1.8, 2.2), sit=_down(1.0, 1.8)),
            Act(_KICK, (0.7, -0.5), 150, 1.82, begin=10, every=1),
            Act(_WALK, (0.0, -0.3), 190, 1.62, every=2, there=((1.0, 2.6),)),
        ),
        90,
        light=True,
    ),
    "meet4": Scene(
        4,
        715,
        (
            Sitter((0.1, -1.45), 90, 1.74, stands=_CHAT, reach=hold(1.5, 2.4)),
            Sitter(
                (0.0, 1.4), -90, 1.84, stands=_CHAT, reach=hold(1.5, 2.2), crouch=hold(2.7, 3.0)
            ),
        ),
        90,
    ),
    # Seen by nobody before they were tracked.
    "bacross5": Scene(
        5,
        801,
        (
            Act(_CHAIR, (0.1, 0.1), 200, 1.72, begin=40),
            Act(_WALK, (0.0, -0.2), 290, 1.84, begin=10),
        ),
        80,
    ),
    "bcircle4": Scene(
        4,
        802,
        (
            Act(_WALK, (0.5, 0.2), 60, 1.70, begin=5, every=2, bend=170),
            Act(_MAN, (-0.5, -0.2), 240, 1.80, bend=60),
        ),
        80,
    ),
    "bshake6": Scene(
        6,
        803,
        (
            Sitter((-1.55, 0.2), -5, 1.66, stands=_CHAT, reach=hold(1.4, 2.6)),
            Sitter((1.5, 0.0), 178, 1.86, stands=_CHAT, reach=hold(1.5, 2.5), lift=hold(3.1, 3.3)),
        ),
        108,
    ),
    "bsit5": Scene(
        5,
        804,
        (
            Sitter((0.3, -0.6), 90, 1.72, stands=_always, reach=hold(0.4, 0.8), sit=ramp(1.2, 2.0)),
            Act(_SALSA, (-0.7, 0.3), 20, 1.66, begin=10),
        ),
        96,
    ),
    "bsit8": Scene(
        8,
        805,
        (
            Sitter((0.8, 0.6), 215, 1.82, stands=_down(1.4, 1.8), sit=_down(0.6, 1.4)),
            Act(_PICKUP, (-0.5, -0.7), 130, 1.64, begin=10),
        ),
        96,
    ),
    "bpickrun8": Scene(
        8,
        806,
        (Act(_RUN, (0.2, 0.3), 200, 1.68), Act(_PICKUP, (-0.1, -0.2), 290, 1.82, begin=30)),
        84,
    ),
    "benter5": Scene(
        5,
        807,
        (
            Act(_BOX, (0.2, 0.2), 30, 1.78),
            Act(_CHAIR, (-0.4, -0.4), 180, 1.64, begin=10, there=((0.9, 1e3),)),
        ),
        84,
    ),
    "bnoempty6": Scene(
        6,
        808,
        (Act(_WALK, (0.1, 0.3), 10, 1.76, every=2), Act(_CHAIR, (0.1, -0.4), 120, 1.66, begin=10)),
        86,
        empty=False,
    ),
    "boff4": Scene(
        4,
        809,
        (Act(_LIGHT, (0.3, 0.3), 170, 1.74, begin=10), Act(_WALK, (-0.3, -0.3), 60, 1.64, begin=5)),
        80,
        off=0.5,
    ),
    "blight5": Scene(
        5,
        810,
        (
            Act(_REAL, (0.2, -0.4), 40, 1.80, begin=30),
            Act(_NOPLATE, (-0.1, 0.4), 200, 1.68, begin=20),
        ),
        90,
        light=True,
    ),
    "btrioA8": Scene(
        8,
        811,
        (
            Act(_JACKS, (0.0, 0.1), 30, 1.70),
            Act(_KICK, (0.7, -0.3), 120, 1.80, begin=20),
            Act(_CHAIR, (-0.1, 0.3), 110, 1.74, begin=50),
        ),
        70,
        off=0.5,
    ),
    "btrioB8": Scene(
        8,
        812,
        (
            Act(_WALK, (0.0, 0.0), 250, 1.76, every=2),
            Act(_WALK, (0.05, 0.05), 160, 1.64, begin=15, every=1),
            Act(_REAL, (-0.5, -0.6), 10, 1.82, begin=10),
        ),
        84,
    ),
    "btrioC8": Scene(
        8,
        813,
        (
            Sitter((-1.5, -0.3), 8, 1.80, stands=_CHAT, reach=hold(1.5, 2.4)),
            Sitter((1.5, 0.0), 186, 1.66, stands=_CHAT, reach=hold(1.4, 2.5)),
            Act(_SKIRT, (0.0, 0.9), 250, 1.62, begin=5),
        ),
        90,
    ),
    # Stout people, a child, and people nearer to each other.
    "cstout6": Scene(
        6,
        901,
        (
            Act(_WOMAN, (0.1, 0.3), 20, 1.58, begin=5, girth=1.35),
            Act(_MAN, (-0.1, -0.2), 130, 1.82),
        ),
        100,
    ),
    "cstout5": Scene(
        5,
        902,
        (
            Act(_SALSA, (0.2, 0.2), 140, 1.66, begin=10, girth=1.25),
            Act(_KICK, (-0.4, -0.3), 260, 1.80, begin=10),
        ),
        90,
    ),
    "cfast6": Scene(
        6,
        903,
        (Act(_JACKS, (0.3, 0.2), 200, 1.72, every=2), Act(_SALSA, (-0.3, -0.3), 20, 1.78, every=2)),
        60,
    ),
    "cchild6": Scene(
        6,
        904,
        (
            Act(_CHAIR, (0.1, 0.1), 60, 1.80, begin=20),
            Act(_PICKUP, (-0.1, -0.2), 170, 1.25, begin=20),
        ),
        90,
    ),
    "ctrio8": Scene(
        8,
        905,
        (
            Act(_WALK, (0.0, 0.0), 75, 1.74, every=2, girth=1.25),
            Act(_SKIRT, (0.4, -0.5), 110, 1.62, begin=10, girth=1.3),
            Act(_LIGHT, (-0.4, 0.6), 300, 1.70, begin=10, girth=1.15),
        ),
        84,
    ),
    "cclose6": Scene(
        6,
        906,
        (Act(_SALSA, (0.0, 0.1), 0, 1.66, begin=15), Act(_REAL, (0.1, -0.1), 180, 1.80, begin=25)),
        80,
        apart=0.09,
    ),
    "ctrioclose8": Scene(
        8,
        907,
        (
            Act(_BOX, (0.0, 0.1), 0, 1.66, begin=15),
            Act(_KICK, (0.3, -0.1), 180, 1.80, begin=25),
            Act(_PICKUP, (-0.3, -0.2), 80, 1.72, begin=20),
        ),
        80,
        apart=0.10,
    ),
}
