"""A body that walks straight on, its feet planted while they stand: true steps for the tests."""

from dataclasses import dataclass, replace

import numpy as np

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.synthetic.gait import GaitModel
from apf.synthetic.walk import Walk
from apf.tracking.track import Track

SONG = load_body("song31")
#: Share of a stride that a foot stands.
STANCE = 0.6


@dataclass(frozen=True)
class Stride:
    """How it walks: along x, at this speed, m/s, with strides of this length, m."""

    speed: float = 1.0
    length: float = 1.0
    fps: float = 60.0

    def phases(self, frames: int) -> np.ndarray:
        """(F, 2) strides since the landing of the left and of the right foot; whole: it lands."""
        done = np.arange(frames) / self.fps * self.speed / self.length
        return np.stack([done, done + 0.5], -1)

    def stands(self, frames: int) -> np.ndarray:
        """(F, 2) bool."""
        return self.phases(frames) % 1 < STANCE


def strider(frames: int = 150, stride: Stride | None = None, noise: float = 0.0) -> Track:
    """A track of the default body that walks so, with `noise`, rad, on the legs' angles."""
    stride = stride or Stride()
    poses = np.tile(SONG.rest_pose, (frames, 1))
    along = stride.speed * np.arange(frames) / stride.fps
    _set(poses, "pelvis.tx", along)
    _set(poses, "pelvis.tz", np.full(frames, 0.86))
    for foot, side in enumerate("lr"):
        lap, phase = np.divmod(stride.phases(frames)[:, foot], 1)
        swing = np.clip((phase - STANCE) / (1 - STANCE), 0, 1)
        # It lands this far before the hip, and stands half of its stance behind it.
        ahead = stride.length * (STANCE / 2 - 0.5 * foot)
        x = stride.length * (lap + (1 - np.cos(np.pi * swing)) / 2) + ahead
        z = 0.08 + 0.1 * np.sin(np.pi * swing) ** 2
        hip, knee = _leg(x - along, z - 0.86)
        _set(poses, f"{side}_thigh.ry", hip)
        _set(poses, f"{side}_calf.ry", knee)
    if noise:
        random = np.random.default_rng(4)
        legs = [i for i, name in enumerate(SONG.dof_names) if "thigh" in name or "calf" in name]
        poses[:, legs] += random.normal(0, noise, (frames, len(legs)))
        poses = np.clip(poses, SONG.lower, SONG.upper)
    return track_of_poses(SONG, poses, stride.fps)


def track_of_poses(body: BodyModel, poses: np.ndarray, fps: float = 60.0) -> Track:
    """A track of nothing but poses."""
    return Track(
        body_name=body.name,
        dof_names=body.dof_names,
        joint_names=tuple(body.joint_names),
        fps=fps,
        frames=np.arange(len(poses)),
        poses=poses,
        joints=posed_joints(body, poses),
        edges=np.array(body.edges),
        body=body,
    )


def synthetic_walker(walk: Walk, frames: int) -> Track:
    """A track of the true joints of `apf synth`'s walker, who goes round in a curve."""
    track, gait = strider(frames), GaitModel(walk)
    joints = gait.skeleton.joints(gait.motion(track.times))
    columns = [gait.skeleton.joint_names.index(name) for name in track.joint_names]
    return replace(track, joints=joints[:, columns])


def _set(poses: np.ndarray, name: str, values: np.ndarray) -> None:
    poses[:, SONG.dof_names.index(name)] = values


def _leg(x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles of hip and knee that put the ankle at x, z m from the hip, by the law of cosines."""
    thigh, calf = 0.41, 0.433
    reach = np.hypot(x, z)
    knee = np.pi - np.arccos((thigh**2 + calf**2 - reach**2) / (2 * thigh * calf))
    between = np.arccos((thigh**2 + reach**2 - calf**2) / (2 * thigh * reach))
    return np.arctan2(x, -z) + between, knee
