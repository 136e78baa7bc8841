"""The synthetic person's walk, and the curve that it follows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Walk:
    """The parameters of a person's walk, along a closed curve, by default one that stays in the
    room, or a line on the floor.

    Amplitudes from textbook gait analysis (Perry & Burnfield 2010), rounded.
    """

    height: float = 1.76
    """Stature, m."""
    speed: float = 1.2
    """Walking speed, m/s."""
    stride: float = 1.25
    """Length of a stride (two steps), m."""
    step_width: float = 0.10
    """Distance between the lines of the left and right feet, m."""
    radius: float = 1.2
    """Mean distance of the curve from the origin, m."""
    wobble: float = 0.15
    """Deviation of the curve from a circle, as a share of the radius."""
    turn: float = 0.0
    """Rotation of the curve about the origin, rad."""
    clockwise: bool = False
    """Whether the person walks clockwise, seen from above."""
    heading: float | None = None
    """Direction, rad, of a straight line to walk along instead; None for the curve."""
    start_phase: float = 0.0
    """Share of a stride already walked at time 0; 0 is the left heel strike."""
    arm_swing: float = 22.0
    """Amplitude of the upper arms, degrees."""
    elbow_bend: float = 20.0
    """Mean flexion of the elbows, degrees."""
    trunk_twist: float = 7.0
    """Amplitude of the shoulders' rotation relative to the walking direction, degrees."""
    pelvis_twist: float = 5.0
    """Amplitude of the pelvis's rotation, degrees."""
    toe_out: float = 6.0
    """Angle of the feet from the walking direction, degrees."""
    head_turn: float = 16.0
    """Amplitude of the head's rotation, degrees."""

    @classmethod
    def sample(cls, seed: int, height: float, heading: float | None = None) -> Walk:
        """Return a person of the given stature with a random walk, straight in the direction
        `heading`, rad, if it is given."""
        rng = np.random.default_rng([seed, 1])
        pace = (height / 1.76) ** 0.5 * rng.uniform(0.95, 1.05)
        return cls(
            height=height,
            speed=1.2 * pace,
            stride=1.25 * height / 1.76 * rng.uniform(0.97, 1.02),
            step_width=rng.uniform(0.08, 0.12),
            wobble=rng.uniform(0.08, 0.18),
            turn=rng.uniform(0.0, 2 * np.pi),
            clockwise=bool(rng.integers(2)),
            heading=heading,
            start_phase=rng.uniform(0.0, 1.0),
            arm_swing=rng.uniform(19.0, 25.0),
            elbow_bend=rng.uniform(15.0, 24.0),
            trunk_twist=rng.uniform(6.0, 9.0),
            toe_out=rng.uniform(4.0, 9.0),
            head_turn=rng.uniform(12.0, 20.0),
        )


class Path:
    """A closed smooth curve on the floor around the origin, or a line through it, parametrised by
    arc length."""

    def __init__(self, walk: Walk) -> None:
        self._line = walk.heading
        angle = np.linspace(0.0, 2 * np.pi, 4001)
        radius = walk.radius * (
            1 + walk.wobble * np.cos(2 * angle + 1.0) + 0.3 * walk.wobble * np.cos(3 * angle)
        )
        direction = -1.0 if walk.clockwise else 1.0
        bearing = direction * angle + walk.turn
        self._xy = np.stack([radius * np.cos(bearing), radius * np.sin(bearing)], -1)
        steps = np.diff(self._xy, axis=0)
        self._s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1))])
        middle = 0.5 * (self._s[1:] + self._s[:-1])
        heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
        lap = direction * 2 * np.pi
        # The heading continues across the seam of the closed curve.
        before, after = middle[-1] - self.length, middle[0] + self.length
        self._heading_s = np.concatenate([[before], middle, [after]])
        self._heading = np.concatenate([[heading[-1] - lap], heading, [heading[0] + lap]])
        self._lap = lap

    @property
    def length(self) -> float:
        return float(self._s[-1])

    def __call__(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (..., 2) m and unwrapped headings (...) rad at arc lengths s (...) m."""
        if self._line is not None:
            ahead = np.array([np.cos(self._line), np.sin(self._line)])
            return s[..., None] * ahead, np.full(np.shape(s), self._line)
        laps, rest = np.divmod(s, self.length)
        xy = np.stack([np.interp(rest, self._s, self._xy[:, k]) for k in (0, 1)], -1)
        return xy, np.interp(rest, self._heading_s, self._heading) + laps * self._lap
