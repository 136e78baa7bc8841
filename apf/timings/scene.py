"""The benchmark: Song et al.'s setting, a person walking in a room, and their whole algorithm on
one device, from images to pose and coloured voxels."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import count, islice
from typing import Any

import cv2
import numpy as np

from apf.backend import make_filter
from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.filters.base import Estimate
from apf.filters.config import FilterConfig
from apf.initialisation.from_joints import fit_to_joints
from apf.scene import Scene as TrackedScene
from apf.synthetic.config import SceneConfig
from apf.synthetic.render import SyntheticScene
from apf.timings.measure import Place, Timing, cpu_place
from cl import Device, NumpyDevice
from cl.staging import allocate_pinned
from psfs.backend import make_reconstructor
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.sequence import Frame
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid

#: Song et al.: 8 cameras of 640 x 480 pixels, 150 x 150 x 100 voxels.
VIEWS, SHAPE = 8, (150, 150, 100)
#: The room around the walk, m.
_LOW, _SIZE = np.array([-1.5, -1.5, 0.0]), np.array([3.0, 3.0, 2.0])
_N_BACKGROUND = 12
#: Environment that limits the libraries below NumPy to one thread.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
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


def _pin_pictures(device: Device, pictures: np.ndarray | None) -> np.ndarray:
    assert pictures is not None
    copy = allocate_pinned(device, pictures.shape)
    copy[:] = pictures
    return copy


def make_scene(device: Device, frames: int, people: int = 1, views: int = VIEWS) -> Scene:
    """Generate `frames` (up to 60) consecutive frames of walks, around their middle."""
    config = SceneConfig(cameras=views, frames=60, fps=FPS, people=people)
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
        images, numbers = scene.frame(index)
        masks = np.where(numbers > 0, np.uint8(255), np.uint8(0))
        masks = np.where(undistorted(masks) > 127, np.uint8(255), np.uint8(0))
        shown.append(Frame(index, undistorted(images), masks))
    joints = scene.people_joints[:, first : first + frames]
    return Scene(rig, background, shown, joints, tuple(scene.joint_names))


def make_grid(shape: tuple[int, int, int] = SHAPE) -> VoxelGrid:
    """Return the room in `shape` voxels; the longest side determines their size."""
    voxel_size = float(np.max(_SIZE / shape))
    middle = _LOW + _SIZE / 2
    return VoxelGrid(middle - voxel_size * np.array(shape) / 2, voxel_size, shape)


@dataclass(frozen=True, eq=False)
class Problem:
    """The benchmark problem: a scene's frames, the body and its pose (D,) in the first,
    settings."""

    scene: Scene
    body: BodyModel
    pose: np.ndarray
    config: FilterConfig
    shape: tuple[int, int, int] = SHAPE
    reconstruction: ReconstructionConfig = field(default_factory=ReconstructionConfig)

    def error_mm(self, place: int, pose: np.ndarray) -> float:
        """Return the mean distance, mm, of the joints of `pose` to the truth of the frame played at
        `place`."""
        truth = self.scene.joints[there_and_back(place, len(self.scene.frames))]
        names = [n for n in self.body.joint_names if n in self.scene.joint_names]
        mine = posed_joints(self.body, pose[None])[0]
        mine = mine[[list(self.body.joint_names).index(name) for name in names]]
        truth = truth[[self.scene.joint_names.index(name) for name in names]]
        return 1e3 * float(np.linalg.norm(mine - truth, axis=-1).mean())

    def on(self, device: Device | NumpyDevice) -> TrackedScene:
        """Return the scene for a tracker on that device."""
        return TrackedScene(device, self.scene.rig, make_grid(self.shape), self.body)


@lru_cache(maxsize=2)
def make_problem(frames: int, body_name: str = "song31", views: int = VIEWS) -> Problem:
    """Return Song et al.'s setting, on `frames` frames of the synthetic walk, from its true
    joints."""
    scene = make_scene(Device.best(), frames, views=views)
    first = dict(zip(scene.joint_names, scene.joints[0], strict=True))
    body, pose, _ = fit_to_joints(load_body(body_name), first)
    return Problem(scene, body, pose, FilterConfig().scale_to_rate(FPS))


class WholeFrame:
    """Reconstruction, colour and tracking: `estimate, cloud = whole(frame)`, both on the host.

    setup_ms: duration of the setup, which builds the kernels. parts_ms: (3,) of the latest frame:
    reconstruction, tracking and colour by the clock; only the NumPy twins have finished a part
    then.
    """

    def __init__(self, device: Device | NumpyDevice, problem: Problem) -> None:
        started = time.perf_counter()
        scene, grid = problem.scene, make_grid(problem.shape)
        self.device, self.problem = device, problem
        self.reconstruct: Any = make_reconstructor(
            device, scene.rig, grid, scene.background, problem.reconstruction
        )
        self.tracker = make_filter(problem.on(device), problem.config)
        self.tracker.start(problem.pose)
        self.setup_ms = 1e3 * (time.perf_counter() - started)
        self.parts_ms = np.zeros(3)

    def __call__(self, frame: Frame) -> tuple[Estimate, VoxelCloud]:
        clock = [time.perf_counter()]
        voxels = self.reconstruct(frame)
        clock.append(time.perf_counter())
        estimate = self.tracker.step(voxels)
        clock.append(time.perf_counter())
        cloud = voxels.cloud(colour=True)
        clock.append(time.perf_counter())
        self.parts_ms = 1e3 * np.diff(clock)
        return estimate, cloud


def sequence_run(
    whole: WholeFrame, frames: int, seconds: float = np.inf, begin: int = 0
) -> dict[str, Any]:
    """Run once through the sequence, from its first frame. Return ms of each frame, and of its
    parts (NumPy), mean error, surface voxels.

    Ends early, after at least two frames, when `seconds` have passed. Frames before number `begin`
    are reconstructed only, and not reported.
    """
    problem = whole.problem
    whole.tracker.start(problem.pose)
    rows: list[tuple[float, ...]] = []
    for place, frame in enumerate(islice(playing(problem.scene.frames), frames)):
        if place < begin:
            whole.reconstruct(frame)
            continue
        if place > 1 and sum(row[0] for row in rows) > 1e3 * seconds:
            break
        estimate, cloud = whole(frame)
        error = problem.error_mm(place, estimate.pose)
        rows.append((whole.parts_ms.sum(), *whole.parts_ms, error, len(cloud)))
    ms, reconstruction, tracking, colour, errors, voxels = np.array(rows).T
    result: dict[str, Any] = {
        "frames": Timing(tuple(ms)),
        "error_mm": errors.mean(),
        "surface_voxels": np.median(voxels),
    }
    if isinstance(whole.device, NumpyDevice):
        parts = {"reconstruction": reconstruction, "colour": colour, "tracking": tracking}
        result["parts"] = {part: Timing(tuple(ms)) for part, ms in parts.items()}
    return result


def stream_run(
    whole: WholeFrame,
    shown: Sequence[Frame],
    frames: int,
    seconds: float = np.inf,
    coloured: bool = False,
) -> dict[str, Any]:
    """Run once through the images in `shown` as a stream; return ms from one pose to the next, and
    the mean error.

    Each frame is uploaded and reconstructed during the search of the one before; no cloud is
    downloaded. `coloured`: measure from one coloured cloud on the host to the next, each frame
    uploaded while the one before is computed. Ends early when `seconds` have passed.
    """
    whole.tracker.start(whole.problem.pose)
    stream = _stream(whole, islice(playing(shown), frames + 1), coloured)
    poses, clock = [next(stream).pose], [time.perf_counter()]
    for estimate in stream:
        poses.append(estimate.pose)
        clock.append(time.perf_counter())
        if clock[-1] - clock[0] > seconds:
            break
    errors = [whole.problem.error_mm(place, pose) for place, pose in enumerate(poses)]
    return {"frames": Timing(tuple(1e3 * np.diff(clock))), "error_mm": float(np.mean(errors))}


def _stream(whole: WholeFrame, frames: Iterable[Frame], coloured: bool) -> Iterator[Estimate]:
    if not coloured:
        yield from whole.tracker.stream(whole.reconstruct.stream(frames))
        return
    for voxels in whole.reconstruct.stream(frames):
        estimate = whole.tracker.step(voxels)
        voxels.cloud(colour=True)
        yield estimate


def column(
    place: Place, problem: Problem, frames: int, repetitions: int, seconds: float
) -> dict[str, Any]:
    """Measure `repetitions` runs through `frames` frames, each of at most `seconds`, after a
    warm-up."""
    device = place.device()
    whole = WholeFrame(device, problem)
    first = sequence_run(whole, 3)["frames"].samples[0]
    runs = [sequence_run(whole, frames, seconds) for _ in range(repetitions)]
    held = problem.scene.pin(device)
    per_run = len(runs[-1]["frames"].samples)
    return {
        "label": place.label,
        "kind": device.info.kind,
        "cores": place.cores,
        "setup_ms": whole.setup_ms,
        "first_frame_ms": first,
        "runs": runs,
        "to_cloud": stream_run(whole, held, per_run, seconds, coloured=True),
        "to_pose": stream_run(whole, held, per_run, seconds),
    }


def on_cpu(problem: Problem, frames: int, repetitions: int, seconds: float) -> dict[str, Any]:
    """Measure `column` on this process's CPU."""
    return column(cpu_place(), problem, frames, repetitions, seconds)


def on_numpy(
    problem: Problem, frames: int, repetitions: int, seconds: float, begin: int
) -> dict[str, Any]:
    """Measure `column` for the NumPy twins, without a warm-up, because there is nothing to
    compile."""
    cv2.setNumThreads(1)
    whole = WholeFrame(NumpyDevice(), problem)
    runs = [sequence_run(whole, frames, seconds, begin) for _ in range(repetitions)]
    return {"label": "NumPy, 1 thread", "kind": "numpy", "cores": 1, "runs": runs}
