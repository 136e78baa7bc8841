"""Read and write body models as TOML files."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from apf.body.kinematics import posed_cones, posed_joints
from apf.body.model import BodyModel, Bone, Cone, FreeAxis, Joint
from apf.body.schema import (
    MOST,
    TALLEST,
    AxisEntry,
    BodyEntry,
    BoneEntry,
    ConeEntry,
    DerivedEntry,
)
from cl import InputError, MissingFileError
from psfs.cameras.names import join_names
from psfs.common.files import parse_toml, read_toml, write_text
from psfs.common.schema import parse_values

#: Folder of the bodies that are shipped.
_BODIES = Path(str(resources.files("apf"))) / "body" / "models"


def load_body(name_or_path: str | Path) -> BodyModel:
    """Read a body from a TOML file, or a shipped one (`song31`) by name.

    Raises MissingFileError, or InputError naming the file and the entry that is wrong.
    """
    path = Path(name_or_path)
    shipped = {file.stem: file for file in sorted(_BODIES.glob("*.toml"))}
    path = shipped.get(str(name_or_path), path)
    if not path.exists():
        wanted = f"a TOML file or one of {join_names(shipped)}"
        raise MissingFileError(f"{path}: no body model; expected {wanted}")
    return _validate(read_toml(path), path)


def parse_body(text: str, source: str | Path) -> BodyModel:
    """Parse the body that `format_body` wrote. Raises InputError naming its `source` and the wrong
    entry."""
    return _validate(parse_toml(text, source), source)


def _validate(data: dict[str, object], source: str | Path) -> BodyModel:
    try:
        if "base" in data:
            data = _derive(parse_values(DerivedEntry, data, source), Path(source).parent, source)
        entry = parse_values(BodyEntry, data, source)
    except RecursionError:
        raise InputError(f"{source}: is the base of its own base; expected another") from None
    try:
        body = _parse(entry)
        _check_extent(body)
    except ValueError as error:
        raise InputError(f"{source}: {error}") from None
    return body


def _derive(entry: DerivedEntry, folder: Path, source: str | Path) -> dict[str, Any]:
    """Return the tables of a body that begins from another one, in `folder` unless it is shipped.
    Raises InputError naming the `source`."""
    beside = folder / entry.base
    base = load_body(beside if beside.suffix == ".toml" else entry.base)
    for kind, groups in (("lengths", base.scale_groups), ("radii", base.radius_groups)):
        for group in getattr(entry, kind):
            if group not in groups:
                known = join_names(groups)
                raise InputError(f"{source}: {kind}: no {group!r} in {base.name}; known: {known}")
    lengths = {name: entry.scale * entry.lengths.get(name, 1.0) for name in base.scale_groups}
    radii = {name: entry.scale * entry.radii.get(name, 1.0) for name in base.radius_groups}
    tables: dict[str, Any] = _tabulate(base.scaled(lengths, radii)) | {"name": entry.name}
    names = [bone.name for bone in base.bones]
    if missing := [name for name in entry.without if name not in names]:
        raise InputError(f"{source}: no bone named {missing[0]!r} in {base.name}")
    gone = {names.index(name) for name in entry.without}
    for index, bone in enumerate(base.bones):
        gone |= {index} if bone.parent in gone else set()
    lost = {base.bones[index].name for index in gone}
    for bone in tables["bone"]:
        for axis in bone["axes"]:
            del axis["dof"]  # those of bones that go leave no gap
            axis["rest"] *= entry.scale if axis["axis"].strip("-")[0] == "t" else 1
    for kind, owner in (("bone", "name"), ("cone", "bone"), ("joint", "bone")):
        new = {each.name: each.model_dump(exclude_none=True) for each in getattr(entry, kind)}
        tables_left = [new.pop(of["name"], of) for of in tables[kind] if of[owner] not in lost]
        tables[kind] = tables_left + list(new.values())
    for kind, items in (("edges", "joint"), ("apart", "cone")):
        left = {each["name"] for each in tables[items]}
        stated = getattr(entry, kind)
        inherited = [pair for pair in tables[kind] if left >= set(pair)]
        tables[kind] = inherited if stated is None else stated
    return tables


def _parse(entry: BodyEntry) -> BodyModel:
    """Build a BodyModel from TOML tables. ValueError says what is wrong."""
    names = _check_distinct("bone", [bone.name for bone in entry.bone])
    cone_names = _check_distinct("cone", [cone.name for cone in entry.cone])
    joint_names = _check_distinct("joint", [joint.name for joint in entry.joint])
    bones, dofs = _parse_bones(entry.bone, names)
    if not 1 <= len(dofs) <= MOST:
        raise ValueError(f"{len(dofs)} free axes; expected 1 to {MOST}")
    limits = np.array([axis.limits for _, axis in dofs], float)
    ordered = limits[:, 0] < limits[:, 1]
    if not ordered.all():
        wrong = dofs[int(np.argmin(ordered))][0]
        raise ValueError(f"{wrong}: the lower limit is not below the upper one")
    body = BodyModel(
        name=entry.name,
        bones=bones,
        cones=tuple(_parse_cone(cone, names) for cone in entry.cone),
        joints=tuple(
            Joint(j.name, _find_index(names, j.bone, "bone"), np.array(j.position, float))
            for j in entry.joint
        ),
        dof_names=tuple(_check_distinct("degree of freedom", [name for name, _ in dofs])),
        lower=limits[:, 0],
        upper=limits[:, 1],
        sigma=np.array([axis.sigma for _, axis in dofs], float),
        rest_pose=np.array([axis.rest for _, axis in dofs], float),
        posture_sigma=np.array([axis.posture_sigma for _, axis in dofs], float),
        posture_rise=np.array([axis.posture_rise for _, axis in dofs], float),
        edges=_parse_pairs(entry.edges, joint_names, "joint"),
        apart=_parse_pairs(entry.apart, cone_names, "cone"),
    )
    for dof in np.flatnonzero(body.posture_rise):
        child = body.bones[body.lifted_bones[dof]]
        if body.lifted_bones[dof] < 0 or body.bones[child.parent].parent < 0:
            raise ValueError(
                f"{body.dof_names[dof]} has a posture_rise; expected a bone with parent and child"
            )
    return body


def _check_extent(body: BodyModel) -> None:
    """Raise ValueError for a body that is larger than `TALLEST` in its rest pose."""
    rest = np.clip(body.rest_pose, body.lower, body.upper)[None]
    points = np.concatenate([posed_joints(body, rest)[0], posed_cones(body, rest)[0, :, :3]])
    extent = float(np.ptp(points, axis=0).max())
    if not extent <= TALLEST:
        raise ValueError(f"the body measures {extent:.3g} m; expected at most {TALLEST:g} m")


def _check_distinct(what: str, names: list[str]) -> list[str]:
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ValueError(f"two {what}s have the same name, {twice[0]}")
    return names


def _parse_bones(
    entries: Sequence[BoneEntry], names: Sequence[str]
) -> tuple[tuple[Bone, ...], list[tuple[str, AxisEntry]]]:
    """Return the bones, and their named axes ordered by index in the pose.

    That is the order of the file unless an entry's `dof` says otherwise.
    """
    dofs: list[tuple[str, AxisEntry]] = []
    bones = []
    for index, entry in enumerate(entries):
        axes = []
        for axis in entry.axes:
            kind = axis.axis.removeprefix("-")
            sign = 1 if kind == axis.axis else -1
            axes.append(FreeAxis(kind, sign, len(dofs) if axis.dof is None else axis.dof))
            dofs.append((axis.name or f"{entry.name}.{kind}", axis))
        bones.append(
            Bone(
                entry.name,
                -1 if entry.parent is None else _find_parent(entry, names, index),
                np.array(entry.offset, float),
                _parse_rotation(entry.rest),
                tuple(axes),
            )
        )
    indices = [axis.dof for bone in bones for axis in bone.axes]
    if sorted(indices) != list(range(len(dofs))):
        raise ValueError(f"the axes' indices in the pose are {indices}; expected each of 0, 1, ...")
    return tuple(bones), [dofs[index] for index in np.argsort(indices)]


def _find_parent(entry: BoneEntry, names: Sequence[str], index: int) -> int:
    before = list(names[:index])
    if entry.parent in before:
        return before.index(entry.parent)
    known = join_names(before) or "none"
    raise ValueError(
        f"bone {entry.name}: its parent is {entry.parent!r}; expected a bone before it: {known}"
    )


def _parse_cone(entry: ConeEntry, bones: Sequence[str]) -> Cone:
    start, end = np.array(entry.start, float), np.array(entry.end, float)
    length = float(np.linalg.norm(end - start))
    if length < 1e-6:
        raise ValueError(f"cone {entry.name}: its length is {length:g} m; expected a positive one")
    axis = (end - start) / length
    side = np.array(entry.side, float)
    side = side - axis * (side @ axis)
    if np.linalg.norm(side) < 1e-6:
        raise ValueError(f"cone {entry.name}: its side lies along its axis")
    (radius_a, radius_b), (scale_x, scale_y) = entry.radii, entry.scale
    return Cone(
        entry.name,
        _find_index(bones, entry.bone, "bone"),
        start,
        end,
        (float(radius_a), float(radius_b)),
        side / np.linalg.norm(side),
        (float(scale_x), float(scale_y)),
        entry.in_images,
    )


def _parse_rotation(values: Sequence[float]) -> np.ndarray:
    rotation = np.array(values, np.float64).reshape(3, 3)
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
        raise ValueError(f"{rotation.tolist()} is not a rotation matrix")
    return rotation


def _parse_pairs(
    entries: Sequence[Sequence[str]], names: Sequence[str], what: str
) -> tuple[tuple[int, int], ...]:
    return tuple((_find_index(names, a, what), _find_index(names, b, what)) for a, b in entries)


def _find_index(names: Sequence[str], name: str, what: str) -> int:
    if name not in names:
        raise ValueError(f"no {what} named {name!r}; expected one of {join_names(names) or 'none'}")
    return list(names).index(name)


def save_body(path: str | Path, body: BodyModel) -> None:
    """Write `body` as a TOML file that `load_body` reads."""
    write_text(path, format_body(body))


def format_body(body: BodyModel) -> str:
    """Return `body` as TOML, for `parse_body`."""
    return tomli_w.dumps(_tabulate(body))


def _tabulate(body: BodyModel) -> dict[str, Any]:
    """Return the tables of `body`, those of a `BodyEntry`."""
    cone_names, joint_names = body.cone_names, body.joint_names
    bone_names = [bone.name for bone in body.bones]
    return {
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
        "cone": [_plain_entry(cone, bone_names) for cone in body.cones],
        "joint": [_plain_entry(joint, bone_names) for joint in body.joints],
    }


def _plain_entry(part: Cone | Joint, bone_names: Sequence[str]) -> dict[str, Any]:
    """Return the fields of a part in plain values, its bone by name."""
    fields = vars(part) | {"bone": bone_names[part.bone]}
    return {
        name: np.asarray(value).tolist() if isinstance(value, (np.ndarray, tuple)) else value
        for name, value in fields.items()
    }


def _axis_entry(body: BodyModel, axis: FreeAxis) -> dict[str, object]:
    rows = {"sigma": body.sigma, "rest": body.rest_pose, "posture_sigma": body.posture_sigma}
    rows |= {"posture_rise": body.posture_rise}
    return {
        "axis": ("-" if axis.sign < 0 else "") + axis.kind,
        "dof": axis.dof,
        "name": body.dof_names[axis.dof],
        **{name: float(values[axis.dof]) for name, values in rows.items()},
        "limits": [float(body.lower[axis.dof]), float(body.upper[axis.dof])],
    }
