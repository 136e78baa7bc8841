"""A handle at a joint in the 3-D view, by which it is dragged, or its limb is turned."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from apf.tracking.correction import Correction
from apf.tracking.track import Track
from cl import InputError
from psfs.page.nodes import to_quaternion

if TYPE_CHECKING:
    import viser

_SIZE = 0.35  # m


class JointHandle:
    """A handle for a joint of a track in one of its rows.

    turns: whether it turns the joint about the one before it, with all that hangs on it, instead of
    moving it. moved: called after a user moved it. Raises InputError if nothing is to be turned.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        track: Track,
        row: int,
        joint: str,
        *,
        turns: bool,
        moved: Callable[[], None],
    ) -> None:
        self.frame, self.turns = int(track.frames[row]), turns
        names, places = track.joint_names, track.joints[row]
        number = names.index(joint)
        at = number
        self._moved = [number]
        if turns:
            before = {int(b): int(a) for a, b in track.edges}
            if number not in before:
                raise InputError(f"nothing turns the {joint}; expected a joint of a limb")
            at = before[number]
            self._moved += [child for child in before if _hangs_on(child, number, before)]
        self._names = [names[number] for number in self._moved]
        self._pivot, self._offsets = places[at], places[self._moved] - places[at]
        self._node = scene.add_transform_controls(
            "/handle", scale=_SIZE, disable_axes=turns, disable_sliders=turns,
            disable_rotations=not turns, depth_test=False, position=self._pivot,
        )  # fmt: skip
        self._node.on_update(lambda event: moved())

    @property
    def wanted(self) -> dict[str, Correction]:
        """The places where the joints are to be, by name."""
        turn = trimesh.transformations.quaternion_matrix(self._node.wxyz)[:3, :3]
        places = np.asarray(self._node.position, float) + self._offsets @ turn.T
        return {
            name: Correction(self.frame, name, (float(x), float(y), float(z)))
            for name, (x, y, z) in zip(self._names, places, strict=True)
        }

    def move(self, position: np.ndarray) -> None:
        """Move the joint to a place (3,) m."""
        self._node.position = position

    def turn(self, rotation: np.ndarray) -> None:
        """Turn the limb by a rotation (3, 3) from where it was tracked."""
        self._node.wxyz = to_quaternion(rotation)

    def remove(self) -> None:
        """Remove the handle from the view."""
        self._node.remove()


def _hangs_on(joint: int, other: int, before: dict[int, int]) -> bool:
    """Return whether a joint comes after another one on its limb."""
    while joint in before:
        joint = before[joint]
        if joint == other:
            return True
    return False
