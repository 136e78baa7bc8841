"""One session for each of several people, in which the others do not count.

All people are reconstructed together. Who covers which pixel follows from their colours and from
where they are, see `psfs.voxels.division`: before they are tracked, that is where their coarse
voxels are, and later where the tracked bodies are.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from collections.abc import Sequence as Items
from dataclasses import replace
from typing import cast

import numpy as np

from cl import InputError
from psfs.backend import AnyReconstructor, Divide, make_division
from psfs.cameras.camera import CameraRig
from psfs.common.numbers import select_span
from psfs.people.people import People, Person
from psfs.sequence import Frame
from psfs.session import Session, SessionSettings
from psfs.volume import Volume, automatic_grid, find_volume
from psfs.voxels.body_prior import TrackedBody
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.grid import VoxelCloud, VoxelGrid
from psfs.voxels.host_voxels import HostVoxels

#: Room around the coarse voxels of a person, m.
MARGIN = 0.2
#: Coarse voxels along an edge of the cubes of which a sphere stands for each.
_BLOCK = 2


class JointReconstruction:
    """The reconstruction of all people of a session, divided among them.

    `spheres[frame]`, (P, K, 4) float32, says where everybody is, see `Division`.
    """

    def __init__(self, session: Session, people: People) -> None:
        self._session = join_session(session, people)
        self.people = people
        self.grids: list[VoxelGrid] = []
        self._of_person = [cover_with_spheres(people.grid, person) for person in people]
        self._divide: Divide | None = None
        self._reconstruct: AnyReconstructor | None = None
        self._clouds: dict[int, list[VoxelCloud]] = {}

    def place(self, number: int, spheres: Mapping[int, np.ndarray]) -> None:
        """Say that a person is about `spheres` (K, 4) m in the frames that are their keys."""
        self._of_person[number].update(spheres)
        self._divide = None
        self._clouds.clear()

    def begin(self) -> AnyReconstructor:
        """Return the reconstructor of everybody in its initial state."""
        grid = automatic_grid(self._session)
        reconstruct = cast(AnyReconstructor, self._session.reconstructor(grid))
        if self._divide is None or reconstruct is not self._reconstruct:
            frames = (len(one) for frames in self._of_person for one in frames.values())
            self._n_spheres = max(frames, default=1)
            known = [one.colours for one in self.people if one.colours is not None]
            colours = np.stack(known) if len(known) == len(self.people) else None
            self._divide = make_division(
                self._session.device, reconstruct, self.grids, self._n_spheres, colours
            )
            self._reconstruct = reconstruct
        return reconstruct

    def divide(self, frame: int, number: int | None = None) -> Items[Voxels | HostVoxels]:
        """Return the voxels of everybody in the frame that was reconstructed last, of which only
        those of the person of a `number` may be valid if one is given."""
        assert self._divide is not None
        spheres = np.zeros((len(self.people), self._n_spheres, 4), np.float32)
        for row, frames in zip(spheres, self._of_person, strict=True):
            if frame in frames:
                row[: len(frames[frame])] = frames[frame]
        return self._divide(spheres, number)

    def iterate_clouds(self, number: int, indices: Items[int]) -> Iterator[VoxelCloud]:
        """Yield the surface voxels of a person in the frames of `indices`; those of the others are
        kept until they are asked for."""
        missing = [index for index in indices if index not in self._clouds]
        reconstruct = self.begin() if missing else None
        with self._session.sequence.reader(learning=False) as read:
            for index in indices:
                if reconstruct is not None and index not in self._clouds:
                    reconstruct(read(index))
                    self._clouds[index] = [voxels.cloud() for voxels in self.divide(index)]
                yield self._clouds[index][number]


def cover_with_spheres(grid: VoxelGrid, person: Person) -> dict[int, np.ndarray]:
    """Return spheres (K, 4) float32, centres and radii, m, about a person in every frame: one for
    each cube of some coarse voxels, with their middle and their volume. Between frames with coarse
    voxels those of the nearest move along with the middle of all."""
    known = np.array(sorted(person.voxels))
    covers = [_cover(grid, person.voxels[int(frame)]) for frame in known]
    middles = np.stack([cover[:, :3].mean(0) for cover in covers])
    spheres = {}
    for frame in np.union1d(person.frames, known):
        nearest = int(np.abs(known - frame).argmin())
        middle = [np.interp(frame, known, along) for along in middles.T]
        moved = covers[nearest].copy()
        moved[:, :3] += middle - middles[nearest]
        spheres[int(frame)] = moved
    return spheres


def _cover(grid: VoxelGrid, voxels: np.ndarray) -> np.ndarray:
    cubes = np.stack(np.unravel_index(voxels, grid.shape)) // _BLOCK
    _, rows, counts = np.unique(cubes, axis=1, return_inverse=True, return_counts=True)
    sums = np.zeros((len(counts), 3))
    np.add.at(sums, rows.ravel(), grid.centres(voxels))
    radii = grid.voxel_size * np.cbrt(counts * 3 / (4 * np.pi))
    return np.column_stack([sums / counts[:, None], radii]).astype(np.float32)


class PersonReconstructor:
    """Reconstruction of one of several people before all are tracked together, on either device:
    everybody is reconstructed anew for each person. evidence: without the others."""

    def __init__(self, joint: JointReconstruction, number: int) -> None:
        self._joint, self._number = joint, number
        self._everybody = joint.begin()
        self._latest: Voxels | HostVoxels | None = None
        self.grid = joint.grids[number]

    def evidence(self) -> np.ndarray:
        """Return the evidence maps (V, H, W) int8 that the latest frame was carved with."""
        assert self._latest is not None and self._latest.evidence is not None
        maps = self._latest.evidence
        return maps if isinstance(maps, np.ndarray) else maps.get()

    def __call__(self, frame: Frame) -> Voxels | HostVoxels:
        """Return the person's voxels in a frame. Raises InputError as `Reconstructor` does."""
        self._everybody(frame)
        self._latest = self._joint.divide(frame.index, self._number)[self._number]
        return self._latest


class PersonSession(Session):
    """The session of one of several people."""

    def __init__(
        self, session: Session, joint: JointReconstruction, number: int, volume: Volume
    ) -> None:
        selection = select_span(joint.people.persons[number].frames, session.frames.step)
        super().__init__(
            session.sequence.with_rig(with_hidden_maps(session.rig)),
            session.device,
            SessionSettings(session.reconstruction, selection, session.settings.voxel_size),
        )
        self.joint, self.number = joint, number
        self.replace_result(find_volume, volume)

    def reconstructor(
        self, grid: VoxelGrid, body: TrackedBody | None = None
    ) -> PersonReconstructor:
        """Return the reconstructor of the person. Raises InputError for another grid than that of
        the person, or a tracked body."""
        if body is not None or not grid.equals(self.joint.grids[self.number]):
            raise InputError("one of several people is reconstructed in their own grid alone")
        return PersonReconstructor(self.joint, self.number)

    def iterate_clouds(self, grid: VoxelGrid, indices: Items[int]) -> Iterator[VoxelCloud]:
        """Yield the surface voxels of the person in the frames of `indices`."""
        return self.joint.iterate_clouds(self.number, indices)

    def evidence(self, indices: Iterable[int]) -> list[np.ndarray]:
        """Return the evidence (V, H, W) int8 of each frame of `indices`, without the others."""
        reconstruct, found = PersonReconstructor(self.joint, self.number), []
        with self.sequence.reader(learning=False) as read:
            for index in indices:
                reconstruct(read(index))
                found.append(reconstruct.evidence())
        return found


def separate(session: Session, people: People) -> list[PersonSession]:
    """Return a session for each of `people`, over the frames from the first to the last that show
    them."""
    joint = JointReconstruction(session, people)
    sessions = []
    for number, person in enumerate(people):
        volume = Volume(*replace(people, persons=(person,)).box(MARGIN))
        sessions.append(PersonSession(session, joint, number, volume))
        joint.grids.append(automatic_grid(sessions[-1]))
    return sessions


def join_session(session: Session, people: People) -> Session:
    """Return a session whose volume holds everybody, with some room around them."""
    joint = Session(session.sequence, session.device, session.settings)
    joint.replace_result(find_volume, Volume(*people.box(MARGIN)))
    return joint


def with_hidden_maps(rig: CameraRig) -> CameraRig:
    """Return the rig with a map of hidden pixels in every camera, empty where it had none: its
    evidence may then be unknown."""
    return CameraRig(
        tuple(
            camera if camera.hidden is not None
            else replace(camera, hidden=np.zeros(camera.size[::-1], bool))
            for camera in rig
        )
    )  # fmt: skip
