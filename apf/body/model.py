"""The body model as data: a tree of bones with free axes, tapered cones and named joints.

World matrix of a bone (Rymut 2016 eq. 4.18-4.21): W = W_parent T(offset) rest A_1 A_2 ..., where
each free axis A is a translation along or a rotation about a local axis. The pose is the vector
of all axis values (metres, radians).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from cl import InputError
from psfs.cameras.names import listed
from psfs.common.files import written_whole
from psfs.common.toml import read_toml

AXES = ("tx", "ty", "tz", "rx", "ry", "rz")
#: The bodies that are shipped.
_BODIES = Path(str(resources.files("apf"))) / "body" / "models"

#: The joints that `apf evaluate` compares.
EVALUATED_JOINTS = (
    "pelvis", "neck", "head_top",
    "l_shoulder", "l_elbow", "l_wrist", "r_shoulder", "r_elbow", "r_wrist",
    "l_hip", "l_knee", "l_ankle", "r_hip", "r_knee", "r_ankle",
)  # fmt: skip


@dataclass(frozen=True)
class FreeAxis:
    """A degree of freedom: `kind` in AXES, `sign` +1 or -1, `dof` its place in the pose."""

    kind: str
    sign: int
    dof: int


@dataclass(frozen=True, eq=False)
class Bone:
    """offset (3,) m from the parent's origin in the parent's frame; rest (3, 3) rotation."""

    name: str
    parent: int  # -1 for a root
    offset: np.ndarray
    rest: np.ndarray
    axes: tuple[FreeAxis, ...]


@dataclass(frozen=True, eq=False)
class Cone:
    """A tapered cylinder fixed to a bone: end centres (3,) m and radii m in the bone's frame.

    Its section is an ellipse: the radius is scaled by `scale` along `side` and along
    axis x side. in_images: False for a part that only explains voxels near it (a foot, say) and
    is neither looked for in the images nor drawn.
    """

    name: str
    bone: int
    start: np.ndarray
    end: np.ndarray
    radii: tuple[float, float]
    side: np.ndarray
    scale: tuple[float, float]
    in_images: bool = True


@dataclass(frozen=True, eq=False)
class Joint:
    """A named point (3,) m in a bone's frame."""

    name: str
    bone: int
    position: np.ndarray


@dataclass(frozen=True, eq=False)
class BodyModel:
    """Bones (parents first), cones, joints, and per degree of freedom its limits and noise.

    dof_names: (D,). lower, upper: (D,) limits, infinite where free. sigma: (D,) standard
    deviation of the change from one frame to the next at 60 frames/s. rest_pose: (D,) standing.
    ease: (D,) how far from rest is easy, infinite where no value is easier than another.
    edges: joint pairs to draw. apart: pairs of cones that must not lie in each other.
    """

    name: str
    bones: tuple[Bone, ...]
    cones: tuple[Cone, ...]
    joints: tuple[Joint, ...]
    dof_names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    sigma: np.ndarray
    rest_pose: np.ndarray
    ease: np.ndarray
    edges: tuple[tuple[int, int], ...]
    apart: tuple[tuple[int, int], ...] = ()

    @property
    def n_dof(self) -> int:
        return len(self.dof_names)

    @property
    def limits(self) -> np.ndarray:
        """(D, 2) float32 lower and upper limit, as the kernels take them."""
        return np.stack([self.lower, self.upper], -1).astype(np.float32)

    @property
    def angles(self) -> list[int]:
        """Places in the pose of the rotations, rad."""
        return [axis.dof for bone in self.bones for axis in bone.axes if axis.kind[0] == "r"]

    @property
    def joint_names(self) -> list[str]:
        return [joint.name for joint in self.joints]

    @property
    def cone_names(self) -> list[str]:
        return [cone.name for cone in self.cones]

    @property
    def scale_groups(self) -> list[str]:
        """Names of the bones that are scaled together: left and right share one."""
        return list(dict.fromkeys(sideless(bone.name) for bone in self.bones))

    @property
    def radius_groups(self) -> list[str]:
        """Names of the cones whose radii are scaled together: left and right share one."""
        return list(dict.fromkeys(sideless(cone.name) for cone in self.cones))

    def scaled(
        self, lengths: Mapping[str, float], radii: float | Mapping[str, float] = 1.0
    ) -> BodyModel:
        """The body with what is fixed to each bone (children's offsets, cones, joints) scaled.

        lengths: factor per scale group, 1 where absent; radii: factor for all cone radii, or per
        radius group, 1 where absent.
        """
        if not isinstance(radii, Mapping):
            radii = dict.fromkeys(self.radius_groups, radii)
        width = [radii.get(sideless(cone.name), 1.0) for cone in self.cones]
        factor = [lengths.get(sideless(bone.name), 1.0) for bone in self.bones]
        bones = tuple(
            bone if bone.parent < 0 else replace(bone, offset=bone.offset * factor[bone.parent])
            for bone in self.bones
        )
        cones = tuple(
            replace(
                cone,
                start=cone.start * factor[cone.bone],
                end=cone.end * factor[cone.bone],
                radii=(cone.radii[0] * girth, cone.radii[1] * girth),
            )
            for cone, girth in zip(self.cones, width, strict=True)
        )
        joints = tuple(replace(j, position=j.position * factor[j.bone]) for j in self.joints)
        return replace(self, bones=bones, cones=cones, joints=joints)


def sideless(name: str) -> str:
    """The name of a bone, cone or joint without its side: left and right share one."""
    return name.removeprefix("l_").removeprefix("r_")


def side_of(name: str) -> str:
    """left, right or middle, as the name of a bone, cone or joint begins."""
    lower = name.lower()
    sides = (side for side in ("left", "right") if lower.startswith((f"{side[0]}_", side)))
    return next(sides, "middle")


def load_body(name_or_path: str | Path) -> BodyModel:
    """A body from a TOML file, or one of those shipped (`song31`) by name.

    Raises InputError naming the file and the entry that is wrong.
    """
    path = Path(name_or_path)
    shipped = {file.stem: file for file in sorted(_BODIES.glob("*.toml"))}
    path = shipped.get(str(name_or_path), path)
    if not path.is_file():
        raise InputError(f"{path}: no body model; expected a TOML file or one of {listed(shipped)}")
    try:
        return _parse(read_toml(path))
    except KeyError as error:
        raise InputError(f"{path}: an entry lacks the key {error}") from None
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: {error}") from None


def _parse(data: dict[str, Any]) -> BodyModel:
    """TOML tables to a BodyModel; ValueError, KeyError or TypeError say what is wrong."""
    names = [entry["name"] for entry in data["bone"]]
    if len(set(names)) < len(names):
        raise ValueError("two bones have the same name")
    bones, dofs = _parse_bones(data["bone"], names)
    cones = tuple(_parse_cone(entry, names) for entry in data.get("cone", []))
    joints = tuple(
        Joint(e["name"], _index(names, e["bone"], "bone"), _vector(e.get("position", (0, 0, 0))))
        for e in data["joint"]
    )
    joint_names = [joint.name for joint in joints]
    cone_names = [cone.name for cone in cones]
    if not (dofs and cones and joints):
        raise ValueError("a body needs at least one free axis, one cone and one joint")
    limits = np.array([dof.get("limits", (-np.inf, np.inf)) for dof in dofs], float)
    ordered = limits[:, 0] < limits[:, 1]
    if not ordered.all():
        wrong = dofs[int(np.argmin(ordered))]["name"]
        raise ValueError(f"{wrong}: the lower limit is not below the upper one")
    sigma = np.array([dof["sigma"] for dof in dofs], float)
    if not np.all(sigma >= 0):
        raise ValueError("a sigma is not a number from 0 on")
    ease = np.array([dof.get("ease", np.inf) for dof in dofs], float)
    if not np.all(ease > 0):
        raise ValueError("an ease is not a positive number")
    return BodyModel(
        name=data["name"],
        bones=bones,
        cones=cones,
        joints=joints,
        dof_names=tuple(dof["name"] for dof in dofs),
        lower=limits[:, 0],
        upper=limits[:, 1],
        sigma=sigma,
        rest_pose=np.array([dof.get("rest", 0.0) for dof in dofs], float),
        ease=ease,
        edges=_pairs(data["edges"], joint_names, "joint"),
        apart=_pairs(data.get("apart", []), cone_names, "cone"),
    )


def _parse_bones(
    entries: Sequence[Mapping[str, Any]], names: Sequence[str]
) -> tuple[tuple[Bone, ...], list[dict[str, Any]]]:
    """The bones, and the entries of their axes by their place in the pose, which is the order of
    the file unless they say."""
    dofs: list[dict[str, Any]] = []
    bones = []
    for index, entry in enumerate(entries):
        axes = []
        for axis in entry.get("axes", []):
            kind = axis["axis"].removeprefix("-")
            sign = 1 if kind == axis["axis"] else -1
            if kind not in AXES:
                raise ValueError(f"bone {entry['name']}: axis {kind!r}; expected one of {AXES}")
            axes.append(FreeAxis(kind, sign, int(axis.get("dof", len(dofs)))))
            dofs.append({"name": f"{entry['name']}.{kind}", **axis})
        bones.append(
            Bone(
                entry["name"],
                _index(names[:index], entry["parent"], "bone") if entry.get("parent") else -1,
                _vector(entry.get("offset", (0, 0, 0))),
                _rotation(entry.get("rest", np.eye(3))),
                tuple(axes),
            )
        )
    places = [axis.dof for bone in bones for axis in bone.axes]
    if sorted(places) != list(range(len(dofs))):
        raise ValueError(f"the axes' places in the pose are {places}; expected each of 0, 1, ...")
    return tuple(bones), [dofs[place] for place in np.argsort(places)]


def _parse_cone(entry: dict[str, Any], bones: Sequence[str]) -> Cone:
    start, end = _vector(entry["start"]), _vector(entry["end"])
    length = float(np.linalg.norm(end - start))
    radius_a, radius_b = (float(radius) for radius in entry["radii"])
    scale_x, scale_y = (float(factor) for factor in entry.get("scale", (1.0, 1.0)))
    if not min(length, radius_a, radius_b, scale_x, scale_y) > 0:
        raise ValueError(f"cone {entry['name']}: its length, radii and scale must be positive")
    axis = (end - start) / length
    side = _vector(entry.get("side", (0, 1, 0)))
    side = side - axis * (side @ axis)
    if np.linalg.norm(side) < 1e-6:
        raise ValueError(f"cone {entry['name']}: its side lies along its axis")
    return Cone(
        entry["name"],
        _index(bones, entry["bone"], "bone"),
        start,
        end,
        (radius_a, radius_b),
        side / np.linalg.norm(side),
        (scale_x, scale_y),
        bool(entry.get("in_images", True)),
    )


def _rotation(values: Any) -> np.ndarray:
    rotation = np.asarray(values, np.float64)
    if (
        rotation.shape != (3, 3)
        or np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6
        or np.linalg.det(rotation) < 0
    ):
        raise ValueError(f"{values!r} is not a rotation matrix")
    return rotation


def _pairs(
    entries: Sequence[Sequence[str]], names: Sequence[str], what: str
) -> tuple[tuple[int, int], ...]:
    return tuple((_index(names, a, what), _index(names, b, what)) for a, b in entries)


def _vector(values: Any) -> np.ndarray:
    vector = np.asarray(values, np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{values!r} is not three finite numbers")
    return vector


def _index(names: Sequence[str], name: str, what: str) -> int:
    if name not in names:
        raise ValueError(f"no {what} named {name!r} (yet); known: {', '.join(names) or 'none'}")
    return list(names).index(name)


def save_body(path: str | Path, body: BodyModel) -> None:
    """Write `body` as a TOML file that `load_body` reads back."""
    cone_names, joint_names = body.cone_names, body.joint_names
    bone_names = [bone.name for bone in body.bones]
    data = {
        "name": body.name,
        "edges": [[joint_names[a], joint_names[b]] for a, b in body.edges],
        "apart": [[cone_names[a], cone_names[b]] for a, b in body.apart],
        "bone": [
            {
                "name": bone.name,
                **({"parent": bone_names[bone.parent]} if bone.parent >= 0 else {}),
                "offset": bone.offset.tolist(),
                "rest": bone.rest.tolist(),
                "axes": [_axis_entry(body, axis) for axis in bone.axes],
            }
            for bone in body.bones
        ],
        "cone": [
            {
                "name": cone.name,
                "bone": bone_names[cone.bone],
                "start": cone.start.tolist(),
                "end": cone.end.tolist(),
                "radii": list(cone.radii),
                "side": cone.side.tolist(),
                "scale": list(cone.scale),
                "in_images": cone.in_images,
            }
            for cone in body.cones
        ],
        "joint": [
            {
                "name": joint.name,
                "bone": bone_names[joint.bone],
                "position": joint.position.tolist(),
            }
            for joint in body.joints
        ],
    }
    with written_whole(path) as temporary:
        temporary.write_text(tomli_w.dumps(data))


def _axis_entry(body: BodyModel, axis: FreeAxis) -> dict[str, Any]:
    lower, upper = float(body.lower[axis.dof]), float(body.upper[axis.dof])
    return {
        "axis": ("-" if axis.sign < 0 else "") + axis.kind,
        "dof": axis.dof,
        "name": body.dof_names[axis.dof],
        "sigma": float(body.sigma[axis.dof]),
        "rest": float(body.rest_pose[axis.dof]),
        "ease": float(body.ease[axis.dof]),
        "limits": [lower, upper],
    }
