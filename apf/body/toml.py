"""Body models as TOML files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from apf.body.model import AXES, BodyModel, Bone, Cone, FreeAxis, Joint
from cl import InputError, MissingFileError
from psfs.cameras.names import listed
from psfs.common.files import written_whole
from psfs.common.toml import parse_toml, read_toml

#: The bodies that are shipped.
_BODIES = Path(str(resources.files("apf"))) / "body" / "models"


def load_body(name_or_path: str | Path) -> BodyModel:
    """Read a body from a TOML file, or one of those shipped (`song31`) by name.

    Raises MissingFileError, or InputError naming the file and the entry that is wrong.
    """
    path = Path(name_or_path)
    shipped = {file.stem: file for file in sorted(_BODIES.glob("*.toml"))}
    path = shipped.get(str(name_or_path), path)
    if not path.is_file():
        wanted = f"a TOML file or one of {listed(shipped)}"
        raise MissingFileError(f"{path}: no body model; expected {wanted}")
    return _checked(read_toml(path), path)


def body_from_text(text: str, source: str | Path) -> BodyModel:
    """Return the body that `body_text` wrote. Raises InputError naming its `source` and the entry
    that is wrong."""
    return _checked(parse_toml(text, source), source)


def _checked(data: dict[str, Any], source: str | Path) -> BodyModel:
    try:
        return _parse(data)
    except KeyError as error:
        raise InputError(f"{source}: an entry lacks the key {error}") from None
    except (TypeError, ValueError) as error:
        raise InputError(f"{source}: {error}") from None


def _parse(data: dict[str, Any]) -> BodyModel:
    """Make a BodyModel of TOML tables; ValueError, KeyError or TypeError say what is wrong."""
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
    posture_sigma = np.array([dof.get("posture_sigma", np.inf) for dof in dofs], float)
    if not np.all(posture_sigma > 0):
        raise ValueError("a posture_sigma is not a positive number")
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
        posture_sigma=posture_sigma,
        edges=_pairs(data["edges"], joint_names, "joint"),
        apart=_pairs(data.get("apart", []), cone_names, "cone"),
    )


def _parse_bones(
    entries: Sequence[Mapping[str, Any]], names: Sequence[str]
) -> tuple[tuple[Bone, ...], list[dict[str, Any]]]:
    """Return the bones, and the entries of their axes ordered by index in the pose.

    That is the order of the file unless an entry's `dof` says otherwise.
    """
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
    indices = [axis.dof for bone in bones for axis in bone.axes]
    if sorted(indices) != list(range(len(dofs))):
        raise ValueError(f"the axes' indices in the pose are {indices}; expected each of 0, 1, ...")
    return tuple(bones), [dofs[index] for index in np.argsort(indices)]


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
    with written_whole(path) as temporary:
        temporary.write_text(body_text(body))


def body_text(body: BodyModel) -> str:
    """Return `body` as TOML, for `body_from_text`."""
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
    return tomli_w.dumps(data)


def _axis_entry(body: BodyModel, axis: FreeAxis) -> dict[str, Any]:
    lower, upper = float(body.lower[axis.dof]), float(body.upper[axis.dof])
    return {
        "axis": ("-" if axis.sign < 0 else "") + axis.kind,
        "dof": axis.dof,
        "name": body.dof_names[axis.dof],
        "sigma": float(body.sigma[axis.dof]),
        "rest": float(body.rest_pose[axis.dof]),
        "posture_sigma": float(body.posture_sigma[axis.dof]),
        "limits": [lower, upper],
    }
