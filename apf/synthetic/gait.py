"""A procedural walk along a closed curve, planned from the footprints.

The feet are planned in the world: they stand still while they bear weight and roll over heel and
ball. The legs follow by inverse kinematics; trunk, head and arms swing with the phase of the
stride. Amplitudes are those of textbook gait analysis (Perry & Burnfield 2010), rounded.
"""

from __future__ import annotations

import numpy as np
import scipy

from apf.body.kinematics import axis_rotation
from apf.synthetic.skeleton import (
    ANKLE_HEIGHT,
    BALL_FORWARD,
    BALL_HEIGHT,
    HEEL_BACK,
    HEEL_RADIUS,
    SHIN,
    THIGH,
    Motion,
    SyntheticSkeleton,
)
from apf.synthetic.walk import Path, Walk

#: Share of the stride that a foot is on the floor, and the phase at which its ankle is below the
#: hip (phase 0 is the foot's heel strike).
STANCE, MIDSTANCE = 0.62, 0.245
#: Pitch of the sole over one stride: (phase, degrees); positive = toes up.
_PITCH = (
    (0.0, 18.0), (0.09, 0.0), (0.34, 0.0), (0.50, -20.0), (0.62, -50.0), (0.69, -46.0),
    (0.79, -16.0), (0.89, 8.0), (0.96, 18.0), (1.0, 18.0),
)  # fmt: skip
#: Forward speed of the foot just before it lands, as a share of the walking speed.
_LANDING = 0.7
#: Largest extension of the leg: a straight knee would snap from frame to frame.
_REACH = 0.995


class GaitModel:
    """A walker whose `motion(times)` returns the bones at any times (s)."""

    def __init__(self, walk: Walk) -> None:
        self.walk = walk
        self.skeleton = SyntheticSkeleton(walk.height)
        self.path = Path(walk)
        self._pitch = scipy.interpolate.PchipInterpolator(
            *np.array(_PITCH).T * [[1.0], [np.pi / 180]]
        )
        laps = np.linspace(0.0, self.path.length / walk.speed, 600)
        self._hip_height = self._highest_pelvis(laps)

    def motion(self, times: np.ndarray) -> Motion:
        """Return the world placement of all bones at `times` (F,) s."""
        phase, root, local = self._trunk(times)
        for side, offset in (("l", 0.0), ("r", 0.5)):
            self._swing_arm(local, side, phase + 0.5 - offset)
        root[:, 2] += self._hip_height
        upper = self.skeleton.forward(root, local)
        for side, offset in (("l", 0.0), ("r", 0.5)):
            self._place_leg(local, upper, side, phase + offset, offset)
        return self.skeleton.forward(root, local)

    # Trunk and arms -------------------------------------------------------------------------

    def _trunk(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Return the phase (F,), of which 0 is the left heel strike, pelvis positions (F, 3),
        height relative to `_hip_height`, and the trunk's rotations."""
        walk, deg = self.walk, np.pi / 180
        phase = times * walk.speed / walk.stride + walk.start_phase
        turn = 2 * np.pi * phase
        surge = 0.008 * walk.height / 1.76 * np.sin(2 * turn + 0.5)
        xy, heading = self.path(walk.stride * (phase - walk.start_phase) + surge)
        sway = 0.011 * walk.height * np.cos(turn - 2 * np.pi * 0.30)
        left = np.stack([-np.sin(heading), np.cos(heading)], -1)
        bob = 0.0120 * walk.height * np.cos(2 * (turn - 2 * np.pi * 0.30))
        root = np.concatenate([xy + sway[:, None] * left, bob[:, None]], 1)

        inward = -1.0 if walk.clockwise else 1.0  # lean into the curve
        if walk.heading is not None:
            inward = 0.0
        lean = -1.5 * inward * deg * np.ones_like(phase)
        twist = -walk.pelvis_twist * deg * np.cos(turn)
        list_ = 3.0 * deg * np.cos(turn - 2 * np.pi * 0.20)
        counter = (walk.trunk_twist + walk.pelvis_twist) * deg * np.cos(turn - 0.2)
        look = deg * walk.head_turn * np.sin(2 * np.pi * times / 3.7 + 5.0 * walk.start_phase)
        nod = 2.0 * deg * np.sin(2 * turn + 0.8) + 2.5 * deg * np.sin(times * 1.3)
        pitch = (3.0 + 1.2 * np.sin(2 * turn)) * deg
        local = {
            "pelvis": axis_rotation(2, heading + twist)
            @ axis_rotation(0, lean + list_)
            @ axis_rotation(1, 3.0 * deg),
            "spine": axis_rotation(2, 0.45 * counter) @ axis_rotation(0, -0.7 * list_),
            "thorax": axis_rotation(2, 0.55 * counter)
            @ axis_rotation(0, -0.6 * list_)
            @ axis_rotation(1, pitch - 2.0 * deg),
            "neck": axis_rotation(2, 0.4 * (look - counter - twist))
            @ axis_rotation(1, 7.0 * deg + nod),
            "head": axis_rotation(2, 0.6 * (look - counter - twist))
            @ axis_rotation(1, -9.0 * deg - 0.5 * nod),
        }
        return phase, root, local

    def _swing_arm(self, local: dict[str, np.ndarray], side: str, phase: np.ndarray) -> None:
        """Set the arm angles; phase 0 is the other foot's heel strike, when the arm is foremost."""
        walk, deg = self.walk, np.pi / 180
        out = 1.0 if side == "l" else -1.0
        swing = np.cos(2 * np.pi * (phase - 0.02))
        flexion = (4.0 + walk.arm_swing * swing) * deg
        bend = (walk.elbow_bend + 11.0 * np.cos(2 * np.pi * (phase - 0.06))) * deg
        local[f"{side}_upper_arm"] = (
            axis_rotation(0, out * (8.0 - 2.0 * swing) * deg)
            @ axis_rotation(1, -flexion)
            @ axis_rotation(2, -out * 14.0 * deg)
        )
        local[f"{side}_forearm"] = axis_rotation(1, -bend) @ axis_rotation(2, -out * 15 * deg)
        local[f"{side}_hand"] = axis_rotation(0, -out * 4 * deg) @ axis_rotation(
            1, -(6.0 + 5.0 * swing) * deg
        )

    # Legs -----------------------------------------------------------------------------------

    def _place_leg(
        self,
        local: dict[str, np.ndarray],
        upper: Motion,
        side: str,
        phase: np.ndarray,
        offset: float,
    ) -> None:
        """Rotate hip, knee and ankle so that the foot stands where `_foot` says."""
        skeleton, height = self.skeleton, self.walk.height
        ankle, pitch, toe_pitch, heading = self._foot(side, phase, offset)
        hip = upper.positions[:, skeleton.index(f"{side}_thigh")]
        pelvis = upper.rotations[:, skeleton.index("pelvis")]
        ahead = _forward_vector(heading) + pelvis[:, :, 0]
        thigh, shin = _solve_two_bones(hip, ankle, ahead, THIGH * height, SHIN * height)
        facing = axis_rotation(2, heading)
        foot = facing @ axis_rotation(1, -pitch)
        local[f"{side}_thigh"] = pelvis.transpose(0, 2, 1) @ thigh
        local[f"{side}_shin"] = thigh.transpose(0, 2, 1) @ shin
        local[f"{side}_foot"] = shin.transpose(0, 2, 1) @ foot
        local[f"{side}_toes"] = axis_rotation(1, pitch - toe_pitch)

    def _foot(
        self, side: str, phase: np.ndarray, offset: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return ankle (F, 3) m, pitch of sole and toes (F,) rad, and heading (F,) rad of a
        foot."""
        step, f = np.divmod(phase, 1.0)
        pitch = self._pitch(f)
        here, next_ = (self._footprint(side, step + k, offset) for k in (0.0, 1.0))
        standing = self._stand(here, pitch)

        u = np.clip((f - STANCE) / (1 - STANCE), 0.0, 1.0)
        small = 1e-3
        rate = (1 - STANCE) / small
        pitches = self._pitch(np.array([STANCE - small, STANCE, 0.0, small]))
        before, start = (self._stand(here, np.full_like(f, p)) for p in pitches[:2])
        end, after = (self._stand(next_, np.full_like(f, p)) for p in pitches[2:])
        landing = rate * (after - end)
        landing[:, :2] += (
            _LANDING * (1 - STANCE) * self.walk.stride * _forward_vector(next_[1])[:, :2]
        )
        flying = _evaluate_hermite(start, rate * (start - before), end, landing, u[:, None])
        flying[:, 2] += 0.022 * self.walk.height * np.sin(np.pi * u) ** 2

        swings = f > STANCE
        ankle = np.where(swings[:, None], flying, standing)
        smooth = u * u * (3 - 2 * u)
        heading = here[1] + smooth * (next_[1] - here[1])
        # The toes stay flat while the heel rises and straighten early in the swing.
        straight = np.where(swings, np.clip(u / 0.5, 0.0, 1.0), 0.0)
        toe_pitch = np.where(pitch < 0, straight * pitch, pitch)
        return ankle, pitch, toe_pitch, heading

    def _footprint(
        self, side: str, step: np.ndarray, offset: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the ankle's position above the floor (F, 2) m and the foot's heading (F,) rad."""
        walk = self.walk
        out = 1.0 if side == "l" else -1.0
        s = walk.stride * (step + MIDSTANCE - offset - walk.start_phase)
        xy, heading = self.path(s)
        left = np.stack([-np.sin(heading), np.cos(heading)], -1)
        return xy + 0.5 * out * walk.step_width * left, heading + out * np.radians(walk.toe_out)

    def _stand(self, footprint: tuple[np.ndarray, np.ndarray], pitch: np.ndarray) -> np.ndarray:
        """Return the ankle (F, 3) of a foot on the floor that has rolled to `pitch` over heel or
        ball."""
        height = self.walk.height
        heel = height * np.array([-HEEL_BACK, 0.0, HEEL_RADIUS])
        ball = height * np.array([BALL_FORWARD, 0.0, BALL_HEIGHT])
        pivot = np.where(pitch[:, None] > 0, heel, ball)
        ankle = np.array([0.0, 0.0, height * ANKLE_HEIGHT])
        arm = np.einsum("fab,fb->fa", axis_rotation(1, -pitch), ankle - pivot)
        xy, heading = footprint
        placed = np.einsum("fab,fb->fa", axis_rotation(2, heading), pivot + arm)
        placed[:, :2] += xy
        return placed

    def _highest_pelvis(self, times: np.ndarray) -> float:
        """Return the largest height at which both legs reach their feet all along the path."""
        phase, root, local = self._trunk(times)
        upper = self.skeleton.forward(root, local)
        reach = _REACH * (THIGH + SHIN) * self.walk.height
        highest = np.inf
        for side, offset in (("l", 0.0), ("r", 0.5)):
            hip = upper.positions[:, self.skeleton.index(f"{side}_thigh")]
            ankle = self._foot(side, phase + offset, offset)[0]
            across2 = np.sum((hip - ankle)[:, :2] ** 2, axis=1)
            room = ankle[:, 2] + np.sqrt(np.maximum(reach**2 - across2, 0.0)) - hip[:, 2]
            highest = min(highest, float(room.min()))
        return highest


def _forward_vector(heading: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(heading), np.sin(heading), np.zeros_like(heading)], -1)


def _evaluate_hermite(
    p0: np.ndarray, v0: np.ndarray, p1: np.ndarray, v1: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """Evaluate the cubic with values p0, p1 and slopes v0, v1 at u = 0, 1."""
    u2, u3 = u * u, u * u * u
    return (
        (2 * u3 - 3 * u2 + 1) * p0
        + (u3 - 2 * u2 + u) * v0
        + (3 * u2 - 2 * u3) * p1
        + (u3 - u2) * v1
    )


def _solve_two_bones(
    hip: np.ndarray, ankle: np.ndarray, ahead: np.ndarray, thigh: float, shin: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return world rotations (F, 3, 3) of thigh and shin from hip to ankle; the knee points
    `ahead`."""
    reach = ankle - hip
    length = np.linalg.norm(reach, axis=1, keepdims=True)
    along = reach / length
    length = np.minimum(length, thigh + shin)
    pole = ahead - np.sum(ahead * along, axis=1, keepdims=True) * along
    pole /= np.linalg.norm(pole, axis=1, keepdims=True)
    cosine = np.clip((thigh**2 + length**2 - shin**2) / (2 * thigh * length), -1.0, 1.0)
    to_knee = cosine * along + np.sqrt(1 - cosine**2) * pole
    left = np.cross(-along, pole)
    down = (length * along - thigh * to_knee) / shin
    return tuple(np.stack([np.cross(left, -d), left, -d], -1) for d in (to_knee, down))  # type: ignore[return-value]
