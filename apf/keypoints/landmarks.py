"""Positions on the body of pose networks' keypoints, from the table `landmarks.toml`.

A keypoint is a point on the body, not a joint centre: it has a prior position in the frame of a
bone, and a spread of that prior; a tracker estimates the person's own from them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import ConfigDict, Field

from apf.body.angles import rotation_between
from apf.body.kinematics import bone_matrices
from apf.body.model import BodyModel
from apf.body.stature import stature
from cl import InputError
from psfs.cameras.names import join_names
from psfs.common.files import read_toml
from psfs.common.schema import Table, Vector, parse_values

#: The table that is shipped.
LANDMARKS = Path(str(resources.files("apf"))) / "keypoints" / "landmarks.toml"
#: Stature of the body that the table's lengths refer to, m.
_STATURE = 1.75
_SIDES = {"l": "left", "r": "right"}
#: Joints and bones that have no side.
_MIDDLE = ("pelvis", "thorax", "head", "neck", "head_top")


class Landmark(Table):
    """An anatomical point, or the same one of both sides, as an entry of a table has it.

    offset: (3,) m forward, left, up from `joint` of a hanging limb, for a stature of 1.75 m.
    spread: standard deviation of that position per axis, m. bone: that carries it, None for the
    joint's own. up: joint whose direction is up, None for the world's up. partner: the same point
    on the other side, None in the middle. aliases: normalised names.
    """

    model_config = ConfigDict(extra="forbid")

    name: str
    joint: str
    spread: Annotated[float, Field(gt=0, lt=1)]
    sided: bool = False
    aliases: tuple[str, ...] = Field((), strict=False)
    bone: str | None = None
    up: str | None = None
    offset: Vector = Field(default_factory=lambda: [0.0] * 3)
    partner: str | None = None


@dataclass(frozen=True, eq=False)
class BodyPoints:
    """The P keypoints that a body has.

    columns: (P,) int, the keypoint's index among the names asked for. names: of the landmarks.
    bones: (P,) int, index of the bone that carries it. offsets: (P, 3) m in that bone's frame, the
    prior's mean. spreads: (P,) m, its standard deviation per axis. partners: (P,) int, index of the
    same point on the other side; its own if there is none.
    """

    columns: np.ndarray
    names: tuple[str, ...]
    bones: np.ndarray
    offsets: np.ndarray
    spreads: np.ndarray
    partners: np.ndarray

    def __len__(self) -> int:
        return len(self.names)

    def place(self, body: BodyModel, poses: np.ndarray) -> np.ndarray:
        """Return the prior positions (N, P, 3) m in the world in poses (N, D)."""
        rotations, origins = bone_matrices(body, poses)
        turned = np.einsum("npab,pb->npa", rotations[:, self.bones], self.offsets)
        return np.asarray(origins[:, self.bones] + turned)


def normalise_name(name: str) -> str:
    """Normalise a name's case and separators: `left_eye` and `LeftEye` both become lefteye."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def list_sided_names(words: Sequence[str], side: str) -> tuple[str, ...]:
    """Return what points `words` of a side, l or r, are called, normalised."""
    long = _SIDES[side]
    return tuple(name for w in words for name in (side + w, long + w, w + side, w + long))


@lru_cache(maxsize=4)
def load_landmarks(path: Path = LANDMARKS) -> tuple[Landmark, ...]:
    """Read a table of anatomical points, by default the shipped one. Raises InputError."""
    return parse_landmarks(read_toml(path).get("landmark", []), path, "landmark")


def parse_landmarks(entries: Any, path: Path, kind: str) -> tuple[Landmark, ...]:
    """Parse the points of the tables [[kind]] of a file. Raises InputError."""
    tables = parse_values(dict[str, list[Landmark]], {kind: entries}, path)
    landmarks = [landmark for entry in tables[kind] for landmark in _list_sides(entry)]
    if not landmarks:
        raise InputError(f"{path}: holds no [[{kind}]]")
    by_alias: dict[str, str] = {}
    for landmark in landmarks:
        for alias in landmark.aliases:
            other = by_alias.setdefault(alias, landmark.name)
            if other != landmark.name:
                raise InputError(f"{path}: {alias} is a name of both {other} and {landmark.name}")
    return tuple(landmarks)


def _list_sides(entry: Landmark) -> list[Landmark]:
    """Return the landmark of an entry, or those of both sides."""
    words = [normalise_name(word) for word in (entry.name, *entry.aliases)]
    if not entry.sided:
        return [entry.model_copy(update={"aliases": tuple(words)})]
    sides = []
    for side, sign, other in (("l", 1.0, "r"), ("r", -1.0, "l")):
        bones = {key: getattr(entry, key) for key in ("joint", "bone", "up")}
        changes = {key: name and _add_side(name, side) for key, name in bones.items()}
        names = {"name": f"{side}_{entry.name}", "partner": f"{other}_{entry.name}"}
        forward, left, up = entry.offset
        parts = {"aliases": list_sided_names(words, side), "offset": [forward, sign * left, up]}
        sides.append(entry.model_copy(update=changes | names | parts))
    return sides


def _add_side(name: str, short: str) -> str:
    """Add the side to the name of a joint or bone, unless it is in the middle."""
    return name if name in _MIDDLE else f"{short}_{name}"


def find_landmarks(
    names: Sequence[str], landmarks: Sequence[Landmark] | None = None
) -> dict[int, Landmark]:
    """Find the landmark of each of the keypoints `names` that is one, by its index.

    If several names mean one landmark, the first counts.
    """
    by_alias = {
        alias: landmark for landmark in landmarks or load_landmarks() for alias in landmark.aliases
    }
    by_point: dict[int, Landmark] = {}
    for index, name in enumerate(names):
        landmark = by_alias.get(normalise_name(name))
        if landmark is not None and landmark not in by_point.values():
            by_point[index] = landmark
    return by_point


def landmark_edges(names: Sequence[str]) -> list[tuple[int, int]]:
    """Return the pairs of indices of landmarks `names` to join by lines."""
    edges = []
    for a, b in read_toml(LANDMARKS)["edges"]:
        for side in ("", "l_", "r_"):
            ends = [name if name in names else side + name for name in (a, b)]
            if all(end in names for end in ends):
                edges.append((names.index(ends[0]), names.index(ends[1])))
    return list(dict.fromkeys(edges))


def locate_points(
    body: BodyModel,
    names: Sequence[str],
    landmarks: Sequence[Landmark] | None = None,
    of_stature: float = _STATURE,
) -> BodyPoints:
    """Find which of the keypoints `names` are points on `body`, and where.

    of_stature: stature, m, that the landmarks' lengths refer to; they are scaled to the body's
    stature. Points whose joint the body lacks are left out. Raises InputError if none is left.
    """
    known = find_landmarks(names, landmarks)
    columns = [index for index, landmark in known.items() if landmark.joint in body.joint_names]
    if not columns:
        raise InputError(
            f"none of the keypoints {join_names(names)} is a point on the body {body.name}; "
            "expected names such as left_shoulder or LShoulder"
        )
    chosen = [known[index] for index in columns]
    scale = stature(body) / of_stature
    places = [_locate_landmark(body, landmark, scale) for landmark in chosen]
    points = [landmark.name for landmark in chosen]
    return BodyPoints(
        columns=np.array(columns),
        names=tuple(points),
        bones=np.array([bone for bone, _ in places]),
        offsets=np.array([offset for _, offset in places]),
        spreads=np.array([scale * landmark.spread for landmark in chosen]),
        partners=np.array(
            [
                points.index(landmark.partner) if landmark.partner in points else row
                for row, landmark in enumerate(chosen)
            ]
        ),
    )


def _locate_landmark(body: BodyModel, landmark: Landmark, scale: float) -> tuple[int, np.ndarray]:
    """Return the bone that carries a landmark and its position (3,) m in that bone's frame."""
    rotations, origins = bone_matrices(body, np.zeros((1, body.n_dof)))

    def world(name: str) -> np.ndarray:
        joint = body.joints[body.joint_names.index(name)]
        return origins[0, joint.bone] + rotations[0, joint.bone] @ joint.position

    joint = body.joints[body.joint_names.index(landmark.joint)]
    bones = [bone.name for bone in body.bones]
    bone = bones.index(landmark.bone) if landmark.bone in bones else joint.bone
    offset = scale * np.array(landmark.offset)
    if landmark.up in body.joint_names:
        offset = (
            rotation_between(np.array([0.0, 0, 1]), world(landmark.up) - world(landmark.joint))
            @ offset
        )
    place = world(landmark.joint) + offset - origins[0, bone]
    return bone, rotations[0, bone].T @ place
