"""Division of a frame's voxels and foreground among several people, on the device."""

from __future__ import annotations

import math

import numpy as np

from cl import Array, Device, InputError, Launch
from cl.batch import Parts
from cl.signature import Argument
from cl.workgroups import pack_defines, size_defines
from psfs.background.config import UNKNOWN
from psfs.cameras.camera import CameraRig
from psfs.voxels.device_voxels import CarvedVoxels
from psfs.voxels.grid import VoxelCloud, VoxelGrid

#: Greatest number of surface voxels of a person.
_ROOM = 2**19
#: Distance, m, from a body, and from its image, up to which voxels and foreground may be the
#: person's; depth, m, by which another person must be nearer to the camera to hide this one.
REACH, BEFORE = 0.35, 0.05


class PersonVoxels:
    """The part of `whole` that belongs to one person; trackers take it like `Voxels`.

    surface: (ROOM,) int32 flat indices, ascending, of which the first `count[0]` are valid.
    evidence: (V, H, W) int8, in which the others do not count. All are overwritten by the next
    frame.
    """

    stays = False

    def __init__(self, whole: CarvedVoxels, surface: Array, count: Array, evidence: Array) -> None:
        self._whole, self.surface, self.count = whole, surface, count
        self.evidence: Array | None = evidence

    @property
    def grid(self) -> VoxelGrid:
        """The grid of everybody's voxels."""
        return self._whole.grid

    def pictures(self) -> Array | None:
        """Return the frame's images, if it has any."""
        return self._whole.pictures()

    def cloud(self) -> VoxelCloud:
        """Download the surface voxels; waits for the device."""
        everybody = self._whole.cloud()
        own = np.isin(everybody.indices, self.surface.get(int(self.count.get()[0])))
        volume = everybody.grid.voxel_size**3 * int(own.sum())
        return VoxelCloud(
            everybody.grid, everybody.indices[own], everybody.probability[own], None, volume
        )


class Division:
    """Division of the latest frame of `voxels` among `n_people`.

    spheres: (P, K, 4) float32, to be written before each call: centres and radii, m, of `n_spheres`
    spheres about where each person's body is. persons: the voxels of each. A surface voxel belongs
    to the nearest person; so does a pixel of the foreground, but it is unknown to those that stand
    behind another one there. Twin: reference/division.py.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        voxels: CarvedVoxels,
        n_people: int,
        n_spheres: int,
    ) -> None:
        if voxels.evidence is None:
            raise InputError("the voxels have no evidence maps; expected those of a reconstructor")
        self._voxels, self._grid = voxels, voxels.grid
        shape = n_people, n_spheres, 4
        self.spheres = device.zeros(shape, np.float32, "the people's spheres")
        room = -(-min(math.prod(voxels.grid.shape), _ROOM) // 1024) * 1024
        lists = Parts(device, n_people, (room,), np.int32)
        counts = Parts(device, n_people, (1,), np.int32)
        maps = Parts(device, n_people, voxels.evidence.shape, np.int8)
        parts = zip(lists.arrays, counts.arrays, maps.arrays, strict=True)
        self.persons = [PersonVoxels(voxels, *part) for part in parts]
        lanes = 256 if device.is_gpu else 1
        self._defines: dict[str, int] = {
            **{"PEOPLE": n_people, "SPHERES": n_spheres, **rig.defines},
            **{"LANES": lanes, "UNKNOWN": UNKNOWN},
            **size_defines(device, rig.picture, voxels.grid.shape),
            **pack_defines(device, 64),
        }
        self._device = device
        owners = device.empty(voxels.surface.shape, np.uint8, "the owners of voxels")
        listed = {"indices": voxels.surface, "n_surface": voxels.count, "owners": owners}
        images = {
            "seen": device.empty((len(rig), n_people * n_spheres, 4), np.float32, "images"),
            "boxes": device.empty((len(rig), n_people, 4), np.float32, "images' boxes"),
        }
        self._assign = self._launch(
            "assign_and_project",
            (65536 if device.is_gpu else 256,), (64 if device.is_gpu else 4,),
            grid=voxels.grid.shape, geometry=self._geometry(), reach=REACH**2,
            n_views=len(rig), beside=REACH, spheres=self.spheres,
            cameras=device.to_device(rig.packed(), "the cameras"), **listed, **images,
        )  # fmt: skip
        list_voxels = self._launch(
            "list_voxels", (n_people * lanes,), (lanes,),
            room=lists.step, step=counts.step, lists=lists.whole, counts=counts.whole, **listed,
        )  # fmt: skip
        packs = -(-rig.width * rig.height // self._defines["PACK"])
        divide_evidence = self._launch(
            "divide_evidence", (packs, len(rig)), (64, 1),
            picture=rig.picture, beside=REACH**2, before=BEFORE, step=maps.step,
            spheres=self.spheres, evidence=voxels.evidence, own=maps.whole, **images,
        )  # fmt: skip
        self._launches = [self._assign, list_voxels, divide_evidence]

    def _launch(
        self,
        name: str,
        size: tuple[int, ...],
        group: tuple[int, ...],
        /,
        **arguments: Argument,
    ) -> Launch:
        kernel = self._device.kernel("reconstruction/people", name, **self._defines)
        return self._device.launch(kernel, size, group, **arguments)

    def __call__(self) -> list[PersonVoxels]:
        """Enqueue the division of the latest frame; return each person's voxels."""
        if self._voxels.grid is not self._grid:
            self._grid = self._voxels.grid
            self._assign.set(geometry=self._geometry())
        for launch in self._launches:
            launch()
        return self.persons

    def _geometry(self) -> tuple[float, ...]:
        return (*self._grid.origin, self._grid.voxel_size)
