"""Small tracks and truths for the tests of outputs."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from apf.body.toml import load_body
from apf.evaluation.joint_names import EVALUATED_JOINTS
from apf.formats.trc import JointSeries
from apf.tracking.people import PeopleTracks
from apf.tracking.track import Track
from helpers import bodies
from helpers.striders import track_of_poses


def walker(frames: int = 30, start: int = 0, fps: float = 60.0, body_name: str = "song31") -> Track:
    """Return a track of a body walking a curve and swinging its limbs."""
    body = load_body(body_name)
    phase = np.linspace(0, 4, frames)
    swing = 0.4 * np.sin(6 * phase)
    poses = bodies.bent(
        body, np.tile(body.rest_pose, (frames, 1)), pelvis__tx=np.cos(phase),
        pelvis__ty=np.sin(phase), pelvis__tz=0.09, pelvis__rz=phase + np.pi / 2,
        l_thigh__ry=swing, r_thigh__ry=-swing,
    )  # fmt: skip
    layers = np.linspace(0, 1, frames * 4).reshape(frames, 4)
    return replace(
        track_of_poses(body, poses, fps),
        frames=np.arange(start, start + frames),
        diagnostics={"ess": 100 * layers, "best_log_weight": -layers},
        provenance='{"seed": 7}',
    )


def lose(track: Track, rows: npt.ArrayLike) -> Track:
    """Return a track whose person is lost in these rows."""
    lost = np.isin(np.arange(len(track)), rows)
    return replace(track, diagnostics={**track.diagnostics, "lost": lost})


def pair() -> PeopleTracks:
    """Return two walkers, of whom the second is visible in frames 2 to 4."""
    first, frames = walker(6), np.arange(6)
    poses = bodies.bent(first.its_body, first.poses, pelvis__tx=0.8)
    second = replace(first, poses=poses, joints=first.joints + np.array([0.8, 0, 0]))
    return PeopleTracks((first, second), frames, (frames, frames[2:5]), 1, ("good", "bad"))


def truth_of(track: Track) -> JointSeries:
    """Return the track's own joints, in the order of EVALUATED_JOINTS."""
    columns = [track.joint_names.index(name) for name in EVALUATED_JOINTS]
    return JointSeries(EVALUATED_JOINTS, track.joints[:, columns].copy(), track.fps, track.frames)
