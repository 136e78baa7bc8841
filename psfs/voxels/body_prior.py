"""A tracked body as a prior of the voxels' occupancy: where a track says that the person is."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cl import Array, Device, InputError
from cl.workgroups import pixel_pack, row_group, size_defines
from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import CELL, cell_rays, cells
from psfs.common.cones import CONE_FLOATS, largest_slopes
from psfs.common.npz import Values, read_npz
from psfs.common.ranges import spans
from psfs.voxels.config import ReconstructionConfig

#: Log odds, nats, that a voxel or pixel well within the body shows the person.
INSIDE = 5.0
#: Log odds that a voxel outside of the body does, and that a pixel beside it does; 0 in a frame in
#: which a limb is lost.
OUTSIDE, BESIDE = -2.0, -1.2
#: Distance, m, from the cones' surface, inwards and outwards, over which the log odds of voxels
#: change.
EDGE = 0.02
#: Distance, m, at the drawn body's edge over which the log odds of pixels fall by 1 nat, and the
#: same within parts lower than LOW, m, above the floor, whose shadows look like shoes.
WIDTH, LOW_WIDTH, LOW = 0.01, 0.0035, 0.2
#: Places of a cone's slope and of whether it is low among its floats, where `psfs.common.cones`
#: leaves a 0.
_SLOPE, _LOW = 11, 15
#: The arrays of a `track.npz` that are read here; a cone of which nothing is known is NaN.
_ARRAYS = {
    "frames": Values(("F",), "int", low=0),
    "cones": Values(("F", "C", CONE_FLOATS), finite=False, low=-1e6, high=1e6, needed=False),
}
_PEOPLE = "people.json"
_WHAT = "a track.npz that `apf track` wrote"


@dataclass(frozen=True, eq=False)
class TrackedBody:
    """The cones of a tracked person, or of several, in the world.

    path: the file or, of several people, the folder. frames: (F,) int frame numbers, ascending.
    cones: (F, C, 16), NaN where the track has lost the limb or the person. several: whether they
    are of several people.
    """

    path: Path
    frames: np.ndarray
    cones: np.ndarray
    several: bool = False

    @classmethod
    def open(cls, path: str | Path) -> TrackedBody:
        """Read the body of a `track.npz`, or of the folder that holds one; of several people those
        of all. Raises InputError for a track without a body, of one of several people, or a file
        that is no track."""
        path = Path(path)
        if (path / _PEOPLE).exists():
            return cls._join(path, [cls._read(folder) for folder in sorted(path.glob("person*"))])
        folder = path if path.is_dir() else path.parent
        if (everybody := folder.resolve().parent / _PEOPLE).exists():
            raise InputError(
                f"{path}: one of several people, who are reconstructed together; expected the "
                f"folder of all, {everybody.parent}"
            )
        return cls._read(path)

    @classmethod
    def _join(cls, path: Path, bodies: list[TrackedBody]) -> TrackedBody:
        """Return all people's cones; those of somebody who is not there are unknown."""
        if not bodies:
            raise InputError(f"{path}: {_PEOPLE}, but no person1; expected {_WHAT}")
        frames = np.unique(np.concatenate([body.frames for body in bodies]))
        cones = [np.stack([body[frame] for frame in frames]) for body in bodies]
        return cls(path, frames, np.concatenate(cones, axis=1), several=True)

    @classmethod
    def _read(cls, path: Path) -> TrackedBody:
        path = path / "track.npz" if path.is_dir() else path
        data = read_npz(path, _ARRAYS, _WHAT)
        if "cones" not in data:
            raise InputError(
                f"{path}: holds no cones of a body; expected {_WHAT} with this version, or "
                "`apf smooth` of an older one"
            )
        if not data["cones"].size or np.any(np.diff(data["frames"]) <= 0):
            raise InputError(f"{path}: {len(data['frames'])} frames, {data['cones'].shape[1]} "
                             "cones; expected some, frames ascending")  # fmt: skip
        return cls(path, data["frames"], data["cones"].astype(np.float64))

    def __getitem__(self, frame: int) -> np.ndarray:
        """Return the cones (C, 16) of a frame; all are unknown if the track lacks it."""
        row = int(np.searchsorted(self.frames, frame))
        if row == len(self.frames) or self.frames[row] != frame:
            return np.full(self.cones.shape[1:], np.nan)
        return self.cones[row]

    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the lowest and highest corner (3,), m, of the box around all known cones."""
        ends = self.cones[..., :8].reshape(-1, 4)
        ends = ends[np.isfinite(ends).all(-1)]
        return (ends[:, :3] - ends[:, 3:]).min(0), (ends[:, :3] + ends[:, 3:]).max(0)

    def check_frames(self, wanted: Iterable[int]) -> None:
        """Raise InputError if the track lacks one of the wanted frames."""
        missing = sorted(set(wanted) - set(self.frames.tolist()))
        if missing:
            raise InputError(
                f"{self.path}: lacks the frames {spans(missing)}; expected a track of all "
                "frames that are reconstructed"
            )


def body_counts(cones: np.ndarray, step: float) -> tuple[float, float, np.ndarray]:
    """Return the evidence counts of `step` nats that a body adds inside and outside, and its known
    cones (N, 16).

    A limb that the track has lost may be anywhere: nothing is then held against any voxel.
    """
    known = np.isfinite(cones).all(-1)
    outside = OUTSIDE if known.all() else 0.0
    return INSIDE / step, outside / step, cones[known]


def location_counts(cones: np.ndarray, steps: float) -> tuple[float, float]:
    """Return the location prior's counts of 1 / `steps` nats well within and well beside the drawn
    body, at most what an int8 holds."""
    lowest = BESIDE if np.isfinite(cones).all() else 0.0
    inside, outside = np.clip(steps * np.array([INSIDE, lowest]), -127, 127)
    return float(inside), float(outside)


def find_low_cones(cones: np.ndarray, floor: float) -> np.ndarray:
    """Return (C,) bool: cones both of whose ends are lower than `LOW` above the floor, which
    is at the height `floor`, m."""
    return cones[:, [2, 6]].max(1) < floor + LOW


def pack_body(config: ReconstructionConfig, cones: np.ndarray) -> np.ndarray:
    """Return (C + 1, 16) float32 of cones (C, 16), as body_prior.h and body_location.cl read
    them."""
    evidence = config.silhouette.evidence
    step, steps = evidence.step, evidence.ratio_steps
    inside, outside, known = body_counts(cones, step)
    packed = np.zeros((len(cones) + 1, CONE_FLOATS), np.float32)
    packed[0, :5] = inside, outside, EDGE, EDGE, len(known)
    packed[0, 5:7] = location_counts(cones, steps)
    packed[0, 7:9] = steps / WIDTH, steps / LOW_WIDTH
    packed[1 : len(known) + 1] = known
    packed[1 : len(known) + 1, _SLOPE] = largest_slopes(known)
    packed[1 : len(known) + 1, _LOW] = find_low_cones(known, config.silhouette.floor.height)
    return packed


class BodyLocation:
    """Computation of a frame's location prior, in place of the one by the voxels of the frame
    before.

    location: (V, rows, columns) int8, as in `ForegroundPrior`. body: the body as `pack_body` packs
    it; where it has no known cones, the location stays as it is. Kernel: body_location.cl; twin:
    `psfs.reference.reconstructor.body_location`.
    """

    def __init__(self, device: Device, rig: CameraRig, location: Array, body: Array) -> None:
        rows, columns = cells(rig)
        centres = np.pad(rig.centres, ((0, 0), (0, 1))).astype(np.float32)
        pack, rays = pixel_pack(device, columns), np.moveaxis(cell_rays(rig), -1, 1)
        defines = {"CELL": CELL, "PACK": pack, **size_defines(device, rig.picture)}
        kernel = device.kernel("reconstruction/body_location", "body_location", **defines)
        self._launch = device.launch(
            kernel,
            (-(-columns // pack), rows, len(rig)),
            row_group(device),
            picture=rig.picture,
            centres=device.to_device(centres, "the cameras' centres"),
            rays=device.to_device(rays.astype(np.float32, "C"), "the cells' rays"),
            body=body,
            location=location,
        )

    def __call__(self) -> None:
        """Enqueue the prior of the body on the device."""
        self._launch()
