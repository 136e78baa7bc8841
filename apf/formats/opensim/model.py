"""The generic OpenSim model: where its joints are, read from its .osim."""

from __future__ import annotations

import importlib.util
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cl import InputError
from cl.errors import pip_command
from psfs.common.files import name_file_in_errors, parse_xml, read_text

#: The model that Pose2Sim's wheel carries: Rajagopal et al. 2016 without muscles.
_CARRIED = Path("OpenSim_Setup", "Model_Pose2Sim_simple.osim")
_EXPECTED = "an OpenSim model with the joints of Rajagopal et al. 2016"


@dataclass(frozen=True, eq=False)
class GenericModel:
    """An OpenSim model whose bodies have parallel axes (forward, up, right) in its neutral pose.

    text: of the file. parents, near, far: of each joint, by the name of the body that it carries:
    the body that carries it, and its place (3,) m in the frames of both.
    """

    text: str
    parents: dict[str, str]
    near: dict[str, np.ndarray]
    far: dict[str, np.ndarray]

    def origin(self, body: str, scales: dict[str, np.ndarray]) -> np.ndarray:
        """Return the origin (3,) m of a body from that of the pelvis in the neutral pose, with the
        bodies scaled by factors (3,)."""
        if body == "pelvis":
            return np.zeros(3)
        parent = self.parents[body]
        scale, carrier = scales.get(body, np.ones(3)), scales.get(parent, np.ones(3))
        start: np.ndarray = self.origin(parent, scales) + self.near[body] * carrier
        return start - self.far[body] * scale


def find_model(path: Path | None) -> Path:
    """Return the file of the generic model: `path`, or the one that Pose2Sim carries. Raises
    InputError if there is none."""
    if path is not None:
        return path
    spec = importlib.util.find_spec("Pose2Sim")
    places = spec.submodule_search_locations if spec is not None else None
    for place in places or ():
        if (Path(place) / _CARRIED).is_file():
            return Path(place) / _CARRIED
    raise InputError(
        "no OpenSim model to scale: Pose2Sim, which carries one, is not installed; expected "
        f"{pip_command('opensim')}, or --osim-model FILE"
    )


def read_model(path: Path) -> GenericModel:
    """Read a model. Raises InputError if it is none, or lacks a joint that is needed."""
    text = read_text(path, _EXPECTED)
    with name_file_in_errors(path):
        root = parse_xml(text, _EXPECTED)
    parents, near, far = {}, {}, {}
    for joint in root.iterfind("./Model/JointSet/objects/*"):
        frames = {
            frame.get("name", ""): _read_frame(path, frame)
            for frame in joint.iterfind("frames/PhysicalOffsetFrame")
        }
        ends = [joint.findtext(f"socket_{end}_frame", "").strip() for end in ("parent", "child")]
        if not set(ends) <= set(frames):
            continue  # without offsets, as a patella's: nothing is measured from it
        (parent, start), (child, end) = (frames[name] for name in ends)
        parents[child], near[child], far[child] = parent, start, end
    bodies = ("torso", "head", *(f"{body}_{side}" for body in _NEEDED for side in "lr"))
    lacking = [body for body in bodies if body not in parents]
    if lacking:
        raise InputError(
            f"{path}: no joint that carries {', '.join(lacking)}; expected {_EXPECTED}"
        )
    for body in bodies:
        _check_chain(path, body, parents)
    return GenericModel(text, parents, near, far)


def _check_chain(path: Path, body: str, parents: dict[str, str]) -> None:
    """Raise InputError unless the joints lead from a body to the pelvis."""
    above: list[str] = []
    while body != "pelvis":
        above.append(body)
        body = parents.get(body, "")
        if not body or body in above:
            raise InputError(
                f"{path}: joints lead from {' to '.join(above)} and not to pelvis; "
                f"expected {_EXPECTED}"
            )


#: Bodies of each side whose joints are measured.
_NEEDED = ("femur", "tibia", "talus", "calcn", "humerus", "ulna", "radius", "hand")


def _read_frame(path: Path, frame: ElementTree.Element) -> tuple[str, np.ndarray]:
    """Return the body that an offset frame is fixed to, and its place (3,) m there."""
    text = frame.findtext("translation", "")
    try:
        place = np.array([float(value) for value in text.split()])
    except ValueError:
        place = np.empty(0)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise InputError(
            f"{path}: the translation of {frame.get('name')} is {text!r}; expected three numbers"
        )
    return frame.findtext("socket_parent", "").strip().rpartition("/")[2], place
