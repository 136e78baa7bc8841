"""The benchmark scene of the reconstruction: Song's setting, a person walking in a room."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import count

import cv2
import numpy as np

from apf.synthetic.render import SyntheticScene
from apf.synthetic.scene import SceneConfig
from cl import Device
from cl.staging import allocate_pinned
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.sequence import Frame
from psfs.voxels.grid import VoxelGrid

#: Song et al.: 8 cameras of 640 x 480 pixels, 150 x 150 x 100 voxels.
VIEWS, SHAPE = 8, (150, 150, 100)
#: The room around the walk, m.
_LOW, _SIZE = np.array([-1.5, -1.5, 0.0]), np.array([3.0, 3.0, 2.0])
_N_BACKGROUND = 12
#: Frames per second; index of the frame in the middle of the room.
FPS, _MIDDLE = 30.0, 30


@dataclass(frozen=True, eq=False)
class Scene:
    """Images of pinhole cameras, undistorted, so that programs without a distortion model compute
    the same. frames: images and true masks. people_joints: (P, F, J, 3) m, the truth; joint_names:
    (J,)."""

    rig: CameraRig
    background: Background
    frames: Sequence[Frame]
    people_joints: np.ndarray
    joint_names: tuple[str, ...]

    @property
    def joints(self) -> np.ndarray:
        """(F, J, 3) m, the first person's."""
        return self.people_joints[0]

    def part(self, views: int) -> Scene:
        """Return the scene with `views` of the cameras, spread around the room."""
        picked = np.linspace(0, len(self.rig), views, endpoint=False).astype(int)
        rig = CameraRig(tuple(self.rig[k] for k in picked))
        background = Background(self.background.mean[picked], self.background.std[picked])
        frames = [
            Frame(f.index, _pick_views(f.images, picked), _pick_views(f.masks, picked))
            for f in self.frames
        ]
        return replace(self, rig=rig, background=background, frames=frames)

    def pin(self, device: Device) -> list[Frame]:
        """Return the frames with their images in pinned memory, from which uploads to `device` are
        fast."""
        return [Frame(f.index, _pin_pictures(device, f.images), f.masks) for f in self.frames]


def playing(frames: Sequence[Frame]) -> Iterator[Frame]:
    """Yield the frames forward and backward without end, numbered on, so that each follows the one
    before."""
    for index in count():
        frame = frames[there_and_back(index, len(frames))]
        yield Frame(index, frame.images, frame.masks)


def there_and_back(index: int, n: int) -> int:
    """Return the element at `index` of the periodic sequence 0, 1, ... n - 1, n - 2, ... 1, 0,
    1."""
    return n - 1 - abs(n - 1 - index % max(1, 2 * (n - 1)))


def _pick_views(pictures: np.ndarray | None, picked: np.ndarray) -> np.ndarray:
    assert pictures is not None
    return np.ascontiguousarray(pictures[picked])


def _pin_pictures(device: Device, pictures: np.ndarray | None) -> np.ndarray:
    assert pictures is not None
    copy = allocate_pinned(device, pictures.shape)
    copy[:] = pictures
    return copy


@lru_cache(maxsize=1)
def shared_scene(frames: int) -> Scene:
    """Return `make_scene` on the best device, cached for the next call with the same number."""
    return make_scene(Device.best(), frames)


def make_scene(device: Device, frames: int, people: int = 1) -> Scene:
    """Generate `frames` (up to 60) consecutive frames of walks, around their middle."""
    config = SceneConfig(cameras=VIEWS, frames=60, fps=FPS, people=people)
    scene = SyntheticScene(config, device)
    lenses = scene.rig
    rig = CameraRig(tuple(replace(camera, distortion=np.zeros(5)) for camera in lenses))

    def undistorted(pictures: np.ndarray) -> np.ndarray:
        pairs = zip(lenses, pictures, strict=True)
        return np.stack([cv2.undistort(p, c.K, c.distortion) for c, p in pairs])

    backgrounds = np.stack([undistorted(scene.background_frame(i)) for i in range(_N_BACKGROUND)])
    background = Background(
        backgrounds.mean(0, dtype=np.float32), backgrounds.std(0, dtype=np.float32)
    )
    shown, first = [], max(0, _MIDDLE - frames // 2)
    for index in range(first, first + frames):
        images, masks, _ = scene.frame(index)
        masks = np.where(undistorted(masks) > 127, np.uint8(255), np.uint8(0))
        shown.append(Frame(index, undistorted(images), masks))
    joints = scene.people_joints[:, first : first + frames]
    return Scene(rig, background, shown, joints, tuple(scene.joint_names))


def make_grid(shape: tuple[int, int, int] = SHAPE) -> VoxelGrid:
    """Return the room in `shape` voxels; the longest side determines their size."""
    voxel_size = float(np.max(_SIZE / shape))
    middle = _LOW + _SIZE / 2
    return VoxelGrid(middle - voxel_size * np.array(shape) / 2, voxel_size, shape)
