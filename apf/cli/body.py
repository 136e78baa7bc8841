"""`apf body`: show a body file, and check what it is good for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.tree import Tree

from apf.body.cones import overlap_errors
from apf.body.kinematics import posed_cones
from apf.body.limbs import limb_names
from apf.body.model import BodyModel, plain_name, sideless
from apf.body.stature import is_whole, stature
from apf.body.toml import load_body
from apf.evaluation.joint_names import EVALUATED_JOINTS, match_joints
from apf.initialisation.start import StartError, check_startable
from apf.request import BodyRequest
from psfs.cameras.names import join_names
from psfs.cli.commandline import stdout

#: Depth of one part in another at rest, as the square of a share of its radius, that is reported.
_DEEP = 0.25


def run(request: BodyRequest) -> None:
    body = load_body(request.file)
    if request.action == "show":
        stdout.print(grow_tree(body))
    tall = f", {stature(body):.2f} m tall" if is_whole(body) else ""
    stdout.print(
        f"{body.name}: {len(body.bones)} bones, {body.n_dof} degrees of freedom, "
        f"{len(body.cones)} cones, {len(body.joints)} joints{tall}; limbs: "
        f"{join_names(limb_names(body)) or 'none'}"
    )
    for remark in list_remarks(body):
        stdout.print(f"- {remark}")


def grow_tree(body: BodyModel) -> Tree:
    """Return the bones with their axes, and on each its cones and joints."""
    tree, branches = Tree(body.name), list[Tree]()
    for number, bone in enumerate(body.bones):
        axes = [
            f"{axis.kind} {body.lower[axis.dof]:.3g} to {body.upper[axis.dof]:.3g}"
            for axis in bone.axes
        ]
        above = tree if bone.parent < 0 else branches[bone.parent]
        branches.append(above.add(f"{bone.name}: {', '.join(axes) or 'fixed'}"))
        for cone in body.cones:
            if cone.bone == number:
                length = 1e3 * float(np.linalg.norm(cone.end - cone.start))
                radii = " to ".join(f"{1e3 * radius:.0f}" for radius in cone.radii)
                branches[-1].add(f"cone {cone.name}: {length:.0f} mm long, radii {radii}")
        for joint in body.joints:
            if joint.bone == number:
                branches[-1].add(f"joint {joint.name}")
    return tree


def list_remarks(body: BodyModel) -> Iterator[str]:
    """Yield what works less well with this body than it could."""
    try:
        check_startable(body)
    except StartError as error:
        yield f"no automatic start, give --init: {error}"
    outside = (body.rest_pose < body.lower) | (body.rest_pose > body.upper)
    for dof in np.flatnonzero(outside):
        yield f"{body.dof_names[dof]}: rests at {body.rest_pose[dof]:.3g}, outside its limits"
    known = match_joints(body.joint_names)
    if missing := [name for name in EVALUATED_JOINTS if name not in known]:
        yield f"without {join_names(missing)}: angles and comparisons that need them are left out"
    sizes = {c.name: np.array([np.linalg.norm(c.end - c.start), *c.radii]) for c in body.cones}
    for name, size in sizes.items():
        twin = {"l_": "r_", "r_": "l_"}.get(name[:2], "") + sideless(name)
        if twin not in sizes or (name < twin and not np.allclose(size, sizes[twin], rtol=0.01)):
            yield f"{plain_name(name)}: has no twin of its size on the other side"
    rest = posed_cones(body, body.rest_pose[None])
    for pair in body.apart:
        if overlap_errors(rest, [pair])[0] > _DEEP:
            first, second = (plain_name(body.cones[number].name) for number in pair)
            yield f"{first} and {second} must not lie in each other, and do at rest"
