"""Write takes of several people who move as the people of other sequences do.

    python scripts/people_actors.py DATA OUT [NAME ...]

DATA holds sequences with truth.npz (`synth_box_4cam`, `hard_chair_6cam` and so on). Their true
joints move the bones of the synthetic person of `apf synth`, whose own joints are the truth of the
takes. Without names it writes all. No setting was chosen with them before they were measured.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from people_takes import Person, render_take

from apf.synthetic.body import Primitive
from apf.synthetic.config import SceneConfig
from apf.synthetic.render import SyntheticScene
from apf.synthetic.skeleton import (
    ANKLE_HEIGHT,
    BALL_FORWARD,
    BALL_HEIGHT,
    SHIN,
    THIGH,
    Motion,
    SyntheticSkeleton,
)
from cl import Device, NumpyDevice, select_device

#: A take to write.
T = TypeVar("T")
#: Frames of every take, at the 30 per second of the sequences.
_FRAMES = 72
#: Least distances of two people's joints, m, by the take's seed, and the steps in which a person is
#: moved away from those before until it is kept.
_APART, _STEP, _N_STEPS = (0.16, 0.20, 0.26), 0.03, 40
_DOWN, _AHEAD = np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])
_FOOT = np.array([BALL_FORWARD, 0.0, BALL_HEIGHT - ANKLE_HEIGHT])
#: Bones of a side: bone, its parent, its direction at rest, joints from and to which it reaches.
_LIMBS = (
    ("upper_arm", "thorax", _DOWN, "shoulder", "elbow"),
    ("forearm", "upper_arm", _DOWN, "elbow", "wrist"),
    ("hand", "forearm", _DOWN, "wrist", "hand"),
    ("thigh", "pelvis", _DOWN, "hip", "knee"),
    ("shin", "thigh", _DOWN, "knee", "ankle"),
    ("foot", "shin", _FOOT, "ankle", "toe"),
    ("toes", "foot", _AHEAD, "toe", "toe_tip"),
)


class Part(NamedTuple):
    """A person of a take: the sequence and the first frame of the motion, the place (x, y) m of its
    middle, how far it is turned, in degrees, and the stature, m."""

    sequence: str
    begin: int
    at: tuple[float, float]
    turn: float
    stature: float


@dataclass(frozen=True)
class ActedTake:
    """A take: who acts in it, before how many cameras, and by which seed it is furnished."""

    cameras: int
    seed: int
    parts: tuple[Part, ...]


_BOX, _SALSA, _JACKS = "synth_box_4cam", "synth_salsa_4cam_hd", "synth_jacks_6cam"
_PICKUP, _KICK, _RUN = "synth_pickup_6cam", "synth_kick_8cam", "synth_run_6cam"
_WALK, _WALK8, _CHAIR = "synth_walk_4cam", "synth_walk_8cam", "hard_chair_6cam"
_SKIRT, _REAL, _NOPLATE = "hard_skirt_4cam", "hard_real_5cam", "hard_noplate_6cam"
_LIGHT = "hard_light_6cam"

TAKES = {
    "boxsalsa": ActedTake(6, 301, (Part(_BOX, 20, (-0.35, 0.1), 0, 1.78),
                                   Part(_SALSA, 10, (0.45, -0.1), 90, 1.64))),
    "jackspick": ActedTake(6, 302, (Part(_JACKS, 10, (-0.4, 0.0), 40, 1.70),
                                    Part(_PICKUP, 20, (0.2, 0.1), 200, 1.83))),
    "walkbox": ActedTake(6, 303, (Part(_WALK, 10, (-0.1, 0.3), 0, 1.80),
                                  Part(_BOX, 40, (0.1, -0.2), 130, 1.66))),
    "kickrun": ActedTake(6, 304, (Part(_KICK, 20, (0.6, 0.2), 0, 1.76),
                                  Part(_RUN, 0, (-0.5, 0.0), 60, 1.60))),
    "salsapick": ActedTake(6, 305, (Part(_SALSA, 30, (0.0, 0.4), 200, 1.74),
                                    Part(_PICKUP, 30, (0.1, -0.5), 20, 1.58))),
    "chairskirt": ActedTake(6, 306, (Part(_CHAIR, 20, (-0.2, 0.3), 0, 1.85),
                                     Part(_SKIRT, 10, (0.3, -0.3), 100, 1.68))),
    "realw8": ActedTake(6, 307, (Part(_REAL, 10, (0.2, 0.2), 0, 1.72),
                                 Part(_WALK8, 10, (-0.3, -0.2), 180, 1.77))),
    "lightnop": ActedTake(6, 308, (Part(_LIGHT, 10, (0.3, 0.0), 0, 1.62),
                                   Part(_NOPLATE, 10, (-0.4, 0.2), 90, 1.80))),
    "trioa": ActedTake(8, 309, (Part(_WALK8, 0, (0.0, 0.0), 90, 1.80),
                                Part(_BOX, 0, (0.5, 0.6), 0, 1.65),
                                Part(_PICKUP, 20, (-0.5, -0.5), 60, 1.73))),
    "triob": ActedTake(8, 310, (Part(_SALSA, 0, (0.7, -0.4), 0, 1.62),
                                Part(_KICK, 10, (-0.6, -0.3), 100, 1.84),
                                Part(_JACKS, 20, (0.0, 0.7), 250, 1.75))),
    "saljack": ActedTake(6, 321, (Part(_SALSA, 0, (0.0, 0.0), 130, 1.80),
                                  Part(_JACKS, 30, (0.3, 0.3), 300, 1.62))),
    "pickw8": ActedTake(6, 322, (Part(_PICKUP, 0, (0.1, 0.0), 220, 1.70),
                                 Part(_WALK8, 20, (-0.2, 0.3), 15, 1.86))),
    "boxbox": ActedTake(6, 323, (Part(_BOX, 0, (-0.2, 0.0), 0, 1.75),
                                 Part(_BOX, 60, (0.3, 0.05), 180, 1.68))),
    "runskirt": ActedTake(6, 324, (Part(_RUN, 10, (0.0, 0.2), 150, 1.72),
                                   Part(_SKIRT, 20, (0.2, -0.3), 240, 1.60))),
    "noplreal": ActedTake(6, 325, (Part(_NOPLATE, 30, (0.0, -0.2), 70, 1.78),
                                   Part(_REAL, 40, (0.2, 0.3), 200, 1.66))),
    "walkwalk": ActedTake(6, 326, (Part(_WALK, 0, (0.0, 0.25), 40, 1.70),
                                   Part(_WALK8, 30, (0.0, -0.3), 40, 1.81))),
    "trioc": ActedTake(8, 327, (Part(_RUN, 0, (0.0, 0.0), 20, 1.77),
                                Part(_SALSA, 40, (0.3, 0.3), 90, 1.63),
                                Part(_WALK, 20, (-0.3, -0.2), 200, 1.71))),
    "triod": ActedTake(8, 328, (Part(_LIGHT, 20, (0.0, 0.0), 80, 1.69),
                                Part(_KICK, 0, (0.3, -0.3), 10, 1.85),
                                Part(_PICKUP, 40, (-0.2, 0.4), 120, 1.60))),
    "boxkick": ActedTake(6, 401, (Part(_BOX, 10, (-0.3, 0.1), 30, 1.72),
                                  Part(_KICK, 40, (0.4, -0.1), 190, 1.80))),
    "salwalk": ActedTake(6, 402, (Part(_SALSA, 45, (0.0, 0.2), 60, 1.68),
                                  Part(_WALK, 60, (0.3, -0.1), 100, 1.79))),
    "jackrun": ActedTake(6, 403, (Part(_JACKS, 0, (-0.2, 0.2), 110, 1.77),
                                  Part(_RUN, 20, (0.2, -0.2), 0, 1.63))),
    "chairpick": ActedTake(8, 404, (Part(_CHAIR, 45, (0.2, 0.2), 150, 1.74),
                                    Part(_PICKUP, 10, (-0.2, -0.3), 320, 1.66))),
    "lightbox8": ActedTake(8, 405, (Part(_LIGHT, 50, (0.3, 0.1), 45, 1.82),
                                    Part(_BOX, 70, (-0.2, -0.2), 220, 1.70))),
    "trioe": ActedTake(8, 406, (Part(_BOX, 40, (0.0, 0.0), 70, 1.83),
                                Part(_JACKS, 45, (0.4, 0.4), 10, 1.66),
                                Part(_WALK8, 60, (-0.4, -0.2), 150, 1.74))),
    "triof": ActedTake(8, 407, (Part(_SKIRT, 0, (0.1, 0.1), 200, 1.64),
                                Part(_REAL, 30, (-0.4, 0.3), 60, 1.80),
                                Part(_SALSA, 20, (0.2, -0.5), 310, 1.72))),
}  # fmt: skip


class Actor(Person):
    """One person of a take, who moves as somebody else does."""

    def __init__(
        self,
        seen: dict[str, np.ndarray],
        at: tuple[float, float],
        stature: float,
        primitives: list[Primitive] | None = None,
    ) -> None:
        """Move bones as `seen`, the joints (F, 3) m of a motion by name, about `at`, (x, y) m."""
        skeleton = SyntheticSkeleton(stature)
        rotations = _find_rotations(skeleton, seen)
        positions = np.empty(rotations.shape[:-1])
        for bone, parent in enumerate(skeleton.parents):
            if parent < 0:
                positions[:, bone] = seen["pelvis"] * (THIGH + SHIN) * stature / _leg(seen)
            else:
                offset = rotations[:, parent] @ skeleton.offsets[bone]
                positions[:, bone] = positions[:, parent] + offset
        feet = {"foot": ANKLE_HEIGHT, "toes": BALL_HEIGHT}
        soles = [
            positions[:, skeleton.index(f"{side}_{bone}"), 2] - height * stature
            for side in "lr"
            for bone, height in feet.items()
        ]
        positions += [*at, -np.percentile(np.min(soles, axis=0), 5)]
        super().__init__(skeleton, Motion(rotations, positions), primitives)


def _load_joints(path: Path, part: Part) -> dict[str, np.ndarray]:
    """Return the joints (F, 3) m of a part's motion by name, about its middle on the floor."""
    truth = np.load(path)
    joints = truth["joints"][part.begin : part.begin + _FRAMES].astype(float)
    c, s = np.cos(np.radians(part.turn)), np.sin(np.radians(part.turn))
    names = [str(name) for name in truth["joint_names"]]
    middle = joints[:, names.index("pelvis")].mean(0) * [1, 1, 0]
    turned = (joints - middle) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return {name: turned[:, k] for k, name in enumerate(names)}


def _leg(seen: dict[str, np.ndarray]) -> float:
    """Return the length of the left leg, m."""
    bones = (("l_hip", "l_knee"), ("l_knee", "l_ankle"))
    return float(sum(np.linalg.norm(seen[a] - seen[b], axis=-1).mean() for a, b in bones))


def _find_rotations(skeleton: SyntheticSkeleton, seen: dict[str, np.ndarray]) -> np.ndarray:
    """Return the rotations (F, B, 3, 3) of the bones by which they point as the joints do: the
    trunk's with both hips and shoulders, those of limbs turned least from their parents'."""
    hips, shoulders = seen["l_hip"] - seen["r_hip"], seen["l_shoulder"] - seen["r_shoulder"]
    both = _unit(hips) + _unit(shoulders)
    found = {
        "pelvis": _frame(seen["thorax"] - seen["pelvis"], hips),
        "spine": _frame(seen["thorax"] - seen["spine"], both),
        "thorax": _frame(seen["neck"] - seen["thorax"], shoulders),
        "neck": _frame(seen["head"] - seen["thorax"], shoulders),
        "head": _frame(seen["head_top"] - seen["head"], shoulders),
    }
    for side in ("l_", "r_"):
        for bone, parent, rest, start, end in _LIMBS:
            above = found.get(parent, found.get(side + parent))
            assert above is not None
            found[side + bone] = _swing(above, rest, seen[side + end] - seen[side + start])
    return np.stack([found[bone] for bone in skeleton.bones], axis=1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (..., 3) of length 1."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, 1e-9))


def _frame(up: np.ndarray, left: np.ndarray) -> np.ndarray:
    """Return rotations (F, 3, 3) whose z axis is `up` (F, 3) and whose y axis is nearest to
    `left`."""
    z = _unit(up)
    y = _unit(left - np.sum(left * z, axis=-1, keepdims=True) * z)
    return np.stack([np.cross(y, z), y, z], axis=-1)


def _swing(above: np.ndarray, rest: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """Return rotations `above` (F, 3, 3), turned least so that their direction `rest` (3,) points
    `towards` (F, 3)."""
    before, after = _unit(above @ rest), _unit(towards)
    cosine = np.sum(before * after, axis=-1)[:, None, None]
    cross = np.cross(np.cross(before, after)[:, None], np.eye(3)[None]).swapaxes(1, 2)
    return np.asarray((np.eye(3) + cross + cross @ cross / np.maximum(1 + cosine, 1e-3)) @ above)


def make_actors(take: ActedTake, data: Path) -> list[Actor]:
    """Return the people of a take, each moved outwards until nobody before is touched."""
    actors: list[Actor] = []
    for part in take.parts:
        seen = _load_joints(data / part.sequence / "truth.npz", part)
        actor, step = Actor(seen, part.at, part.stature), _STEP * _unit(np.array([*part.at, 0.0]))
        for _ in range(_N_STEPS):
            gaps = [actor.joints[:, :, None] - other.joints[:, None] for other in actors]
            if all(np.linalg.norm(gap, axis=-1).min() > _APART[take.seed % 3] for gap in gaps):
                break
            actor.move(step)
        actors.append(actor)
    return actors


class _Scene(SyntheticScene):
    """The scene of a take."""

    def __init__(
        self, actors: list[Actor], config: SceneConfig, device: Device | NumpyDevice
    ) -> None:
        super().__init__(config, device)
        self._walkers = list(actors)  # type: ignore[arg-type]
        self._there = np.ones((len(actors), config.frames), bool)
        self.people_joints = np.stack([actor.joints for actor in actors])
        self.joints = actors[0].joints
        n_balls = [len(actor.posed(k)[1]) for actor in actors for k in (0, _FRAMES // 2)]
        self._n_balls = max(self._n_balls, *n_balls)


def write_take(folder: Path, take: ActedTake, data: Path, device: Device | NumpyDevice) -> None:
    """Write a take as `apf synth` does."""
    actors = make_actors(take, data)
    config = SceneConfig(
        people=len(actors), cameras=take.cameras, seed=take.seed, frames=_FRAMES, fps=30.0
    )
    render_take(folder, config, device, partial(_Scene, actors))


def write_named(
    description: str | None,
    takes: Mapping[str, T],
    write: Callable[[Path, T, Path, Device | NumpyDevice], None],
) -> None:
    """Write those of `takes` that the command line names: DATA OUT [NAME ...]."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("data", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", choices=[*takes, []], metavar="NAME")
    args = parser.parse_args()
    device = select_device("auto")
    for name in args.names or takes:
        write(args.folder / name, takes[name], args.data, device)


if __name__ == "__main__":
    write_named(__doc__, TAKES, write_take)
