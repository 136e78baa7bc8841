"""The surface of the synthetic person: smoothly blended round cones and ellipsoids on bones.

A primitive is a sphere of changing radius swept along a segment and scaled across it; a segment of
length zero gives an ellipsoid. Primitives of one group blend (smooth minimum, see
`cl/kernels/synthetic/scene_person.h`); groups do not, so that a hand that swings past the thigh
does not stick to it. Numbers are metres on a person of 1.76 m, in the frame of the bone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from apf.synthetic.skeleton import Motion, SyntheticSkeleton

#: Floats per packed primitive; `scene_person.h` states this number and the largest blend, too.
PRIMITIVE_FLOATS = 32
TABLE_HEIGHT = 1.76

SHIRT, TROUSERS, SKIN, HAIR, SHOE, SOCK, SOLE, EYE = range(8)
TRUNK, LEFT_ARM, RIGHT_ARM, LEFT_LEG, RIGHT_LEG = range(5)

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Primitive:
    """A round cone from `a` (radius `ra`) to `b` (`rb`) on a bone, m.

    squash: scale (along the bone's forward axis, across it). blend: distance over which it blends
    into its group, m. split: share of its length beyond which it shows the region `beyond`.
    """

    bone: str
    a: Point
    b: Point
    ra: float
    rb: float
    region: int
    squash: tuple[float, float] = (1.0, 1.0)
    blend: float = 0.03
    group: int = TRUNK
    split: float = 2.0
    beyond: int = SKIN

    def mirror(self) -> Primitive:
        """Return the right side's counterpart of a primitive of the left side."""
        swap = {LEFT_ARM: RIGHT_ARM, LEFT_LEG: RIGHT_LEG}
        return replace(
            self,
            bone="r" + self.bone[1:] if self.bone.startswith("l_") else self.bone,
            a=(self.a[0], -self.a[1], self.a[2]),
            b=(self.b[0], -self.b[1], self.b[2]),
            group=swap.get(self.group, self.group),
        )


def _ball(bone: str, centre: Point, radius: float, region: int, **more: object) -> Primitive:
    return Primitive(bone, centre, centre, radius, radius, region, **more)  # type: ignore[arg-type]


def _make_centre() -> list[Primitive]:
    """Make the trunk and head."""
    return [
        _ball("pelvis", (-0.005, 0, 0.035), 0.118, TROUSERS, squash=(0.90, 1.34), blend=0.04),
        Primitive("spine", (0.012, 0, -0.03), (0.006, 0, 0.10), 0.124, 0.122, SHIRT,
                  squash=(0.88, 1.14), blend=0.05),
        _ball("spine", (0.048, 0, 0.025), 0.082, SHIRT, squash=(0.78, 1.2), blend=0.06),
        Primitive("thorax", (0.0, 0, -0.02), (-0.010, 0, 0.135), 0.126, 0.118, SHIRT,
                  squash=(0.88, 1.20), blend=0.06),
        Primitive("neck", (-0.012, 0, -0.05), (0.012, 0, 0.10), 0.056, 0.052, SKIN, blend=0.03),
        _ball("head", (0.012, 0, 0.115), 0.100, SKIN, squash=(0.97, 0.76), blend=0.03),
        _ball("head", (0.048, 0, 0.030), 0.062, SKIN, squash=(0.95, 0.86), blend=0.03),
        Primitive("head", (0.102, 0, 0.082), (0.118, 0, 0.055), 0.009, 0.014, SKIN, blend=0.015),
        _ball("head", (-0.002, 0, 0.137), 0.098, HAIR, squash=(1.06, 0.84), blend=0.012),
        _ball("head", (-0.045, 0, 0.070), 0.075, HAIR, squash=(0.80, 0.92), blend=0.015),
    ]  # fmt: skip


def _make_left_side() -> list[Primitive]:
    """Make the left side: chest, shoulder, arm, buttock, leg."""
    sleeve = Primitive("l_upper_arm", (0, 0, 0.0), (0, 0, -0.285), 0.056, 0.041, SHIRT,
                       blend=0.035, split=0.60)  # fmt: skip
    thigh = Primitive("l_thigh", (0, 0.004, -0.01), (0, 0, -0.40), 0.088, 0.061, TROUSERS,
                      squash=(1.06, 1.0), blend=0.035)  # fmt: skip
    trunk = [
        _ball("thorax", (0.062, 0.068, 0.080), 0.068, SHIRT, squash=(0.72, 1.1), blend=0.06),
        _ball("thorax", (-0.062, 0.075, 0.090), 0.085, SHIRT, squash=(0.65, 1.0), blend=0.06),
        Primitive("thorax", (-0.012, 0.140, 0.180), (-0.018, 0.030, 0.240), 0.046, 0.050, SHIRT,
                  blend=0.06),
        _ball("l_upper_arm", (0, -0.006, -0.030), 0.059, SHIRT, squash=(1.0, 0.92), blend=0.06),
        sleeve,
        _ball("pelvis", (-0.058, 0.066, -0.010), 0.086, TROUSERS, squash=(0.95, 1.0), blend=0.05),
        thigh,
        _ball("head", (0.002, 0.074, 0.080), 0.028, SKIN, squash=(0.7, 0.35), blend=0.01),
        _ball("head", (0.097, 0.031, 0.092), 0.0085, EYE, squash=(0.9, 1.3), blend=0.004),
    ]  # fmt: skip
    arm = [
        sleeve,
        Primitive("l_forearm", (0, 0, 0.0), (0.004, 0, -0.12), 0.041, 0.041, SKIN),
        Primitive("l_forearm", (0.004, 0, -0.11), (0, 0, -0.262), 0.041, 0.026, SKIN,
                  squash=(1.05, 0.95)),
        Primitive("l_hand", (0.002, 0, -0.025), (0.004, 0, -0.085), 0.030, 0.034, SKIN,
                  squash=(1.12, 0.52), blend=0.02),
        Primitive("l_hand", (0.006, -0.002, -0.095), (0.0, -0.022, -0.160), 0.027, 0.019, SKIN,
                  squash=(1.15, 0.50), blend=0.015),
        Primitive("l_hand", (0.022, 0, -0.030), (0.046, -0.012, -0.098), 0.014, 0.010, SKIN,
                  blend=0.015),
    ]  # fmt: skip
    leg = [
        thigh,
        Primitive("l_shin", (0.004, 0, 0.0), (-0.014, 0, -0.13), 0.060, 0.061, TROUSERS),
        Primitive("l_shin", (-0.014, 0, -0.12), (-0.004, 0, -0.385), 0.061, 0.051, TROUSERS),
        Primitive("l_shin", (-0.004, 0, -0.37), (0, 0, -0.425), 0.038, 0.037, SOCK, blend=0.01),
        Primitive("l_foot", (-0.030, 0, -0.043), (0.105, 0, -0.047), 0.036, 0.032, SHOE,
                  squash=(1.0, 1.12), blend=0.02),
        Primitive("l_foot", (-0.006, 0, -0.008), (0.085, 0, -0.043), 0.039, 0.032, SHOE,
                  blend=0.03),
        Primitive("l_toes", (-0.012, 0, 0.0), (0.044, -0.004, -0.003), 0.0262, 0.0225, SHOE,
                  squash=(1.0, 1.50), blend=0.03),
    ]  # fmt: skip
    # Sleeve and thigh are in two groups, since they blend into both the trunk and the limb.
    arm = [replace(p, group=LEFT_ARM) for p in arm]
    return trunk + arm + [replace(p, group=LEFT_LEG) for p in leg]


class PersonSurface:
    """A person's primitives, to be posed by a skeleton's motion."""

    def __init__(self, skeleton: SyntheticSkeleton) -> None:
        left = _make_left_side()
        parts = _make_centre() + left + [p.mirror() for p in left]
        self.primitives = sorted(parts, key=lambda p: p.group)
        self._bones = np.array([skeleton.index(p.bone) for p in self.primitives])
        scale = skeleton.height / TABLE_HEIGHT
        self._a = scale * np.array([p.a for p in self.primitives], np.float64)
        b = scale * np.array([p.b for p in self.primitives], np.float64)
        self._length = np.linalg.norm(b - self._a, axis=1)
        self._radii = scale * np.array([(p.ra, p.rb) for p in self.primitives])
        self._squash = np.array([p.squash for p in self.primitives])
        self._axes = np.stack(
            [_primitive_axes(d) for d in b - self._a]
        )  # rows: across forward, across side, along
        self._static = self._constant_columns(skeleton, scale)

    def __len__(self) -> int:
        return len(self.primitives)

    def _constant_columns(self, skeleton: SyntheticSkeleton, scale: float) -> np.ndarray:
        """Return columns 12-31 of the packed primitives, which do not depend on the pose."""
        rest = skeleton.forward(np.zeros((1, 3)), {}).positions[0, self._bones, 2]
        out = np.zeros((len(self), PRIMITIVE_FLOATS), np.float64)
        pack_constants(out, self._length, self._radii, self._squash)
        out[:, 18] = [scale * p.blend for p in self.primitives]
        out[:, 19] = [p.group for p in self.primitives]
        out[:, 24] = [p.region for p in self.primitives]
        out[:, 25] = [p.beyond for p in self.primitives]
        out[:, 26] = [p.split for p in self.primitives] * np.where(
            self._length > 0, self._length, 1
        )
        out[:, 27] = rest + self._a[:, 2]
        out[:, 28] = self._axes[:, 2, 2]
        return out

    def packed(self, motion: Motion, frame: int) -> np.ndarray:
        """Pack the primitives of a frame, (P, PRIMITIVE_FLOATS) float32, in the order of
        `scene_person.h`."""
        rotation = motion.rotations[frame, self._bones]
        origin = motion.positions[frame, self._bones] + np.einsum("pab,pb->pa", rotation, self._a)
        axes = np.einsum("pka,pba->pkb", self._axes, rotation)  # rows in the world
        rows = axes / np.concatenate([self._squash, np.ones((len(self), 1))], 1)[:, :, None]
        out = self._static.copy()
        out[:, 0:9] = rows.reshape(-1, 9)
        out[:, 9:12] = -np.einsum("pka,pa->pk", rows, origin)
        out[:, 20:23] = origin + 0.5 * self._length[:, None] * axes[:, 2]
        out[:, 29:31] = 0.0
        return out.astype(np.float32)

    def balls(self, packed: np.ndarray) -> np.ndarray:
        """Return spheres (S, 4) float32, centre and radius, m, along the primitives, for soft
        shadows.

        Parts smaller than a hand and primitives in two groups are left out.
        """
        width = np.sqrt(np.prod(self._squash, axis=1))
        balls = []
        for i, (row, p) in enumerate(zip(packed, self.primitives, strict=True)):
            repeated = p.group != TRUNK and p.bone.endswith(("upper_arm", "thigh"))
            if row[31] < 0.025 or repeated:
                continue
            number = 1 + int(np.ceil(row[12] / (2.2 * self._radii[i].max())))
            for share in np.linspace(0.0, 1.0, number) if row[12] > 0 else (0.0,):
                centre = row[20:23] + (share - 0.5) * row[12] * row[6:9]
                radius = (1 - share) * self._radii[i, 0] + share * self._radii[i, 1]
                balls.append([*centre, width[i] * radius])
        return np.array(balls, np.float32)


def pack_constants(
    packed: np.ndarray, length: np.ndarray, radii: np.ndarray, squash: np.ndarray
) -> None:
    """Write those columns of packed primitives (P, PRIMITIVE_FLOATS) that their lengths (P,) and
    radii (P, 2), m, and squashes (P, 2) determine."""
    change = radii[:, 1] - radii[:, 0]
    # Where one end's ball holds the other's, no cone touches both.
    taper = np.where(length > np.abs(change), change / np.maximum(length, 1e-9), 0.0)
    largest = radii.max(1) * np.maximum(squash.max(1), 1.0)
    packed[:, 12], packed[:, 13], packed[:, 14] = length, radii[:, 0], taper
    packed[:, 15] = taper / np.sqrt(1 - taper**2)
    packed[:, 16:18] = 1 / squash
    packed[:, 23], packed[:, 31] = 0.5 * length + largest, largest


def _primitive_axes(direction: np.ndarray) -> np.ndarray:
    """Return unit vectors (3, 3) by rows: two across `direction` and one along it.

    The first points to the bone's forward axis, or up if the primitive itself points forward.
    """
    length = np.linalg.norm(direction)
    along = direction / length if length > 0 else np.array([0.0, 0.0, 1.0])
    reference = np.array([0.0, 0.0, 1.0]) if abs(along[0]) > 0.8 else np.array([1.0, 0.0, 0.0])
    first = reference - (reference @ along) * along
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(along, first), along])
