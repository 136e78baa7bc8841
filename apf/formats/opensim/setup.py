"""Set-up files for OpenSim: markers of our body, and how the generic model is scaled and moved.
OpenSim itself does this in a process of its own, since it writes a log where it runs.

The joints of both are the same points. What joints do not show, how pelvis, chest and head are
turned, is shown by markers that are fixed to them: their places in the model are those that they
have in our body while both stand upright.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from apf.body.angles import anatomical_frames, standing_axes
from apf.body.kinematics import posed_joints, posed_points
from apf.body.limbs import limb_joints
from apf.body.markers import virtual_markers
from apf.body.model import BodyModel
from apf.formats.angles import opensim_coordinates
from apf.formats.motion import BodyMotion
from apf.formats.opensim.model import GenericModel, find_model, read_model
from apf.formats.trc import JointSeries, write_trc
from cl import InputError
from psfs.common.files import write_atomically, write_text

#: The files, in a folder of their own.
MODEL, MARKERS, MARKER_SET = "generic.osim", "markers.trc", "markers.xml"
SCALING, INVERSE_KINEMATICS = "scaling.xml", "ik.xml"
SCALED, ANGLES = "scaled.osim", "ik.mot"
#: How far in front of a joint the markers of pelvis, chest and head are, and outside of elbows and
#: knees, m.
_AHEAD, _OUTSIDE = 0.1, 0.05
#: Joints that are markers: the model's body that carries each, the body whose joint it is, and the
#: weight in inverse kinematics. The model has no clavicles: shoulders count half.
_JOINTS = {
    "hip": ("pelvis", "femur", 2.0),
    "knee": ("femur", "tibia", 1.0),
    "ankle": ("tibia", "talus", 1.0),
    "shoulder": ("torso", "humerus", 0.5),
    "elbow": ("humerus", "ulna", 1.0),
    "wrist": ("radius", "hand", 1.0),
}
#: Other markers: the model's body that carries each, and its weight.
_FIXED = {
    "pelvis_front": ("pelvis", 1.0),
    "neck": ("torso", 1.0),
    "chest_front": ("torso", 1.0),
    "head_top": ("head", 1.0),
    "head_front": ("head", 0.5),
    "l_heel": ("calcn_l", 0.5),
    "r_heel": ("calcn_r", 0.5),
    "l_toe": ("calcn_l", 0.5),
    "r_toe": ("calcn_r", 0.5),
}
#: Names of coordinates in Pose2Sim's model that are others in Rajagopal's.
COORDINATES = {
    "lumbar_extension": "L5_S1_Flex_Ext",
    "lumbar_bending": "L5_S1_Lat_Bending",
    "lumbar_rotation": "L5_S1_axial_rotation",
}
#: Coordinates that no marker shows: they stay at the model's defaults.
_UNSEEN = tuple(
    f"{name}_{side}"
    for name in ("pro_sup", "wrist_flex", "wrist_dev", "subtalar_angle", "mtp_angle")
    for side in "lr"
)
_LENGTHS = ("pelvis_tx", "pelvis_ty", "pelvis_tz")
_FRONTS = {
    "pelvis_front": ("pelvis", "pelvis"),
    "chest_front": ("thorax", "neck"),
    "head_front": ("head", "head_top"),
}
#: Markers outside of a hinge, which show how a straight limb is turned: our segment, the model's
#: body, and the weight.
_LATERAL = {"elbow": ("upper_arm", "humerus", 0.5), "knee": ("thigh", "femur", 0.5)}
_SIGNS = {"l": -1.0, "r": 1.0}
_NEEDED = ("pelvis", "neck", "head_top", *(f"{s}_{joint}" for s in "lr" for joint in _JOINTS))


def scale_factors(body: BodyModel, model: GenericModel) -> dict[str, np.ndarray]:
    """Return the factors (3,), forward, up, right, of the model's bodies: lengths between joints of
    our body over those of the model, the mean of both sides."""
    at, near, far = _upright(body), model.near, model.far

    def length(first: str, second: str) -> float:
        pairs = [(at[f"{side}_{first}"], at[f"{side}_{second}"]) for side in "lr"]
        return float(np.mean([np.linalg.norm(b - a) for a, b in pairs]))

    def width(joint: str, carried: str) -> float:
        ours = np.linalg.norm(at[f"l_{joint}"] - at[f"r_{joint}"])
        return float(ours / np.linalg.norm(near[f"{carried}_l"] - near[f"{carried}_r"]))

    def factor(first: str, second: str, bone: np.ndarray) -> np.ndarray:
        return np.full(3, length(first, second) / float(np.linalg.norm(bone)))

    shoulders = (at["l_shoulder"] + at["r_shoulder"]) / 2 - (at["l_hip"] + at["r_hip"]) / 2
    theirs = near["torso"] - far["torso"] + near["humerus_r"] - near["femur_r"]
    trunk = float(shoulders[1] / theirs[1])
    forearm = near["radius_r"] - far["ulna_r"] + near["hand_r"] - far["radius_r"]
    shank = factor("knee", "ankle", near["talus_r"] - far["tibia_r"])
    factors = {
        "pelvis": np.array([trunk, trunk, width("hip", "femur")]),
        "torso": np.array([trunk, trunk, width("shoulder", "humerus")]),
        "head": np.full(3, trunk),
    }
    limbs = {
        "femur": factor("hip", "knee", near["tibia_r"] - far["femur_r"]),
        "humerus": factor("shoulder", "elbow", near["ulna_r"] - far["humerus_r"]),
        **dict.fromkeys(("tibia", "talus", "calcn", "toes"), shank),
        **dict.fromkeys(("ulna", "radius", "hand"), factor("elbow", "wrist", forearm)),
    }
    factors |= {f"{name}_{side}": value for name, value in limbs.items() for side in "lr"}
    if "sacrum" in model.parents:
        factors["sacrum"] = factors["pelvis"]
    return factors


def marker_places(
    body: BodyModel, model: GenericModel, scales: Mapping[str, np.ndarray]
) -> dict[str, tuple[str, np.ndarray, float]]:
    """Return the body, the place (3,) m in it before it is scaled, and the weight of each marker of
    the model, by name."""
    markers: dict[str, tuple[str, np.ndarray, float]] = {}
    for name, (carrier, carried, weight) in _JOINTS.items():
        for side in "lr":
            segment = carrier if carrier in ("pelvis", "torso") else f"{carrier}_{side}"
            markers[f"{side}_{name}"] = (segment, model.near[f"{carried}_{side}"], weight)
            if name in _LATERAL:
                _, segment, weight = _LATERAL[name]
                outside = np.array([0, 0, _SIGNS[side] * _OUTSIDE]) / scales[f"{segment}_{side}"]
                markers[f"{side}_{name}_lateral"] = (
                    f"{segment}_{side}", model.near[f"{carried}_{side}"] + outside, weight,
                )  # fmt: skip
    at, factors = _upright(body), dict(scales)
    hips = (model.near["femur_l"] + model.near["femur_r"]) / 2 * factors["pelvis"]
    for name, (carrier, weight) in _FIXED.items():
        if name in at:
            inside = at[name] + hips - model.origin(carrier, factors)
            markers[name] = (carrier, inside / factors[carrier], weight)
    return markers


def _upright(body: BodyModel) -> dict[str, np.ndarray]:
    """Return joints and markers (3,) m of our body with all angles at 0, forward, up and right from
    the middle of its hips."""
    poses = np.zeros((1, body.n_dof))
    at = {name: places[0] for name, places in _place_markers(body, poses).items()}
    middle = (at["l_hip"] + at["r_hip"]) / 2
    return {name: standing_axes(body).T @ (point - middle) for name, point in at.items()}


def _place_markers(body: BodyModel, poses: np.ndarray) -> dict[str, np.ndarray]:
    """Return the places (F, 3) m of all markers in the world, by name."""
    joints, frames = posed_joints(body, poses), anatomical_frames(body, poses)
    at = {name: joints[:, body.joint_names.index(name)] for name in _NEEDED if name != "pelvis"}
    for name, (segment, joint) in _FRONTS.items():
        ahead = frames[segment][:, :, 0]
        at[name] = joints[:, body.joint_names.index(joint)] + _AHEAD * ahead
    for name, (segment, _, _) in _LATERAL.items():
        for side, sign in _SIGNS.items():
            outward = sign * frames[f"{side}_{segment}"][:, :, 2]
            at[f"{side}_{name}_lateral"] = at[f"{side}_{name}"] + _OUTSIDE * outward
    feet = [marker for marker in virtual_markers(body) if marker.name in _FIXED]
    if feet:
        on_feet = np.moveaxis(posed_points(body, poses, feet), 1, 0)
        at |= dict(zip((marker.name for marker in feet), on_feet, strict=True))
    return at


def marker_series(motion: BodyMotion) -> JointSeries:
    """Return the markers over time, NaN where the person or the limb is lost."""
    body = motion.body
    at = _place_markers(body, motion.poses)
    names, points = list(at), np.stack(list(at.values()), axis=1)
    on_limbs = dict(zip(body.joint_names, (motion.lost_limbs @ limb_joints(body)).T, strict=True))
    ends = {"heel": "ankle", "toe": "ankle"}
    gone = np.repeat(motion.lost[:, None], len(names), 1)
    for column, name in enumerate(names):
        joint = _FRONTS[name][1] if name in _FRONTS else name.removesuffix("_lateral")
        joint = f"{name[:2]}{ends[name[2:]]}" if name[2:] in ends else joint
        gone[:, column] |= on_limbs[joint].astype(bool)
    points = np.where(gone[..., None], np.nan, points)
    joints = motion.points
    return JointSeries(tuple(names), points, joints.fps, joints.frames, None, joints.note)


def _start_model(model: GenericModel, motion: BodyMotion) -> str:
    """Return the generic model whose default coordinates are those of our first pose: inverse
    kinematics starts there, and stays in a wrong minimum from arms held out to the sides."""
    root = ElementTree.fromstring(model.text)
    first = opensim_coordinates(motion.body, motion.poses[:1])
    known = {COORDINATES.get(name, name): float(value[0]) for name, value in first.items()}
    for coordinate in root.iter("Coordinate"):
        name, default = coordinate.get("name", ""), coordinate.find("default_value")
        if name not in known or default is None:
            continue
        value = known[name] if name in _LENGTHS else np.radians(known[name])
        if coordinate.findtext("clamped", "").strip() == "true":
            low, high = (float(limit) for limit in coordinate.findtext("range", "").split())
            value = min(max(value, low), high)
        default.text = f"{value:.6f}"
    return ElementTree.tostring(root, "unicode") + "\n"


def _marker_set(places: Mapping[str, tuple[str, np.ndarray, float]]) -> str:
    markers = [
        _element("Marker", {
            "socket_parent_frame": f"/bodyset/{body}", "location": _numbers(place), "fixed": "true",
        }, name)
        for name, (body, place, _) in places.items()
    ]  # fmt: skip
    return _document(_element("MarkerSet", {"objects": markers}, "markers"))


def _scaling(scales: Mapping[str, np.ndarray]) -> str:
    objects = [
        _element("Scale", {"scales": _numbers(factors), "segment": body, "apply": "true"})
        for body, factors in scales.items()
    ]
    tool = {
        "GenericModelMaker": {"model_file": MODEL, "marker_set_file": MARKER_SET},
        "ModelScaler": {
            "apply": "true",
            "scaling_order": "manualScale",
            "ScaleSet": {"objects": objects},
            "preserve_mass_distribution": "true",
            "output_model_file": SCALED,
        },
        "MarkerPlacer": {"apply": "false"},
    }
    return _document(_element("ScaleTool", tool, "scaled"))


def _inverse_kinematics(
    places: Mapping[str, tuple[str, np.ndarray, float]], begin: float, end: float
) -> str:
    tasks = [
        _element("IKMarkerTask", {"apply": "true", "weight": f"{weight:g}"}, name)
        for name, (_, _, weight) in places.items()
    ]
    unseen = {"apply": "true", "weight": "1", "value_type": "default_value"}
    tasks += [_element("IKCoordinateTask", unseen, name) for name in _UNSEEN]
    tool = {
        "results_directory": ".",
        "model_file": SCALED,
        "constraint_weight": "Inf",
        "accuracy": "1e-5",
        "time_range": _numbers([begin, end]),
        "output_motion_file": ANGLES,
        "report_errors": "false",
        "IKTaskSet": {"objects": tasks},
        "marker_file": MARKERS,
    }
    return _document(_element("InverseKinematicsTool", tool, "ik"))


def _element(tag: str, content: Any, name: str = "") -> ElementTree.Element:
    """Return an element with its children by their tags, a list of them, or a text."""
    element = ElementTree.Element(tag, {"name": name} if name else {})
    if isinstance(content, str):
        element.text = content
    elif isinstance(content, Mapping):
        element.extend(_element(key, value) for key, value in content.items())
    else:
        element.extend(content)
    return element


def _numbers(values: np.ndarray | list[float]) -> str:
    return " ".join(f"{value:.6f}" for value in values)


def _document(content: ElementTree.Element) -> str:
    top = ElementTree.Element("OpenSimDocument", Version="40000")
    top.append(content)
    ElementTree.indent(top)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(top, "unicode") + "\n"


_PROGRAM = f"""
import opensim
opensim.Logger.setLevelString("error")
opensim.ScaleTool("{SCALING}").run()  # returns False in 4.6, also where it succeeds
opensim.InverseKinematicsTool("{INVERSE_KINEMATICS}").run()
"""


def write_opensim(folder: Path, motion: BodyMotion, model: Path | None) -> tuple[Path, ...]:
    """Write into `folder` the generic model, the markers (TRC and where they are on the model), the
    set-ups of OpenSim's ScaleTool and InverseKinematicsTool, and, if Python's opensim is installed,
    the scaled model and its angles over time; return the files. model: the generic one, by default
    Pose2Sim's. Raises InputError, also for a body without the joints."""
    generic = read_model(find_model(model))
    lacking = [name for name in _NEEDED if name not in motion.body.joint_names]
    if lacking:
        raise InputError(
            f"body {motion.body.name}: has no {', '.join(lacking)}; expected a whole body for "
            "--to osim"
        )
    scales = scale_factors(motion.body, generic)
    positions = marker_places(motion.body, generic, scales)
    series = marker_series(motion)
    texts = {
        MODEL: _start_model(generic, motion),
        MARKER_SET: _marker_set(positions),
        SCALING: _scaling(scales),
        INVERSE_KINEMATICS: _inverse_kinematics(positions, series.times[0], series.times[-1]),
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    write_trc(folder / MARKERS, series)
    files = tuple(folder / name for name in (*texts, MARKERS))
    if importlib.util.find_spec("opensim") is None:
        return files
    return files + run_tools(folder, Path(sys.executable))


def run_tools(folder: Path, python: Path) -> tuple[Path, ...]:
    """Scale the model in `folder` and compute its inverse kinematics, by a Python that has opensim;
    return the new files. Raises InputError with OpenSim's last line if it fails."""
    with tempfile.TemporaryDirectory() as scratch:
        for name in (MODEL, MARKERS, MARKER_SET, SCALING, INVERSE_KINEMATICS):
            shutil.copy(folder / name, scratch)
        done = subprocess.run(
            [str(python), "-c", _PROGRAM], cwd=scratch, capture_output=True, text=True, check=False
        )
        made = [Path(scratch) / name for name in (SCALED, ANGLES)]
        if done.returncode or not all(path.is_file() for path in made):
            lines = (done.stderr.strip() or done.stdout.strip()).splitlines()
            last = lines[-1] if lines else "no message"
            raise InputError(f"{folder}: OpenSim failed: {last}")
        for path in made:
            with write_atomically(folder / path.name) as temporary:
                shutil.copy(path, temporary)
    return tuple(folder / path.name for path in made)
