"""A run that a page shows: the voxels of its frames as points, within a fixed amount of memory, and
its footage.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import scipy

from cl import InputError, UserError
from psfs.common.colours import CLAY
from psfs.common.system import KEPT_BYTES
from psfs.mesh.marching_cubes import make_glb
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.sequence import Sequence
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid

if TYPE_CHECKING:
    import trimesh

#: Colours of confidence, 0 to 1, everywhere: red, yellow, green, as CSS has them. Red is darker
#: than yellow for people who are colour-blind.
CONFIDENCE = ((0.0, "#8e1b1b"), (0.35, "#e08a3c"), (0.5, "#f1dc8a"), (1.0, "#2e8b57"))
#: What a voxel's colour can show.
COLOURINGS = ("colour", "probability", "height")


def colour_voxels(cloud: VoxelCloud, colouring: str = COLOURINGS[0]) -> np.ndarray:
    """Return (N, 3) uint8 RGB of the voxels.

    colouring: one of COLOURINGS. "colour": the pictures' colours, or clay if the cloud has none;
    "probability": CONFIDENCE from the threshold to 1; "height": turbo over the grid's height.
    """
    if colouring == "probability":
        least = OccupancyConfig().threshold
        return _colour_confidence((cloud.probability - least) / (1 - least))
    if colouring == "height":
        low, high = cloud.grid.low[2], cloud.grid.high[2]
        return _colour_height((cloud.centres[:, 2] - low) / (high - low))
    if cloud.colour is None:
        return np.tile(np.rint(255 * np.array(CLAY)).astype(np.uint8), (len(cloud), 1))
    return cloud.colour


def colour_vertices(vertices: np.ndarray, cloud: VoxelCloud, colouring: str) -> np.ndarray:
    """Return (N, 3) uint8 RGB of a mesh's vertices (N, 3) m: those of the nearest voxels."""
    _, nearest = scipy.spatial.cKDTree(cloud.centres).query(vertices)
    return colour_voxels(cloud, colouring)[nearest]


def describe_scale(colouring: str, low: float, high: float) -> tuple[str, list[str]]:
    """Return what the ends of a colouring's scale mean, and its colours from one to the other as
    CSS has them; none if they are the pictures' own. low, high: of the grid, m."""
    if colouring == "probability":
        text, colour = f"{OccupancyConfig().threshold:g} to 1", _colour_confidence
    elif colouring == "height":
        text, colour = f"{low:.3g} to {high:.3g} m", _colour_height
    else:
        return "", []
    steps = colour(np.linspace(0, 1, 9))
    return text, [f"rgb({r},{g},{b})" for r, g, b in steps.tolist()]


def _colour_confidence(values: np.ndarray) -> np.ndarray:
    """Map values 0..1 to (N, 3) uint8 RGB along CONFIDENCE."""
    ends = np.array([[int(css[k : k + 2], 16) for k in (1, 3, 5)] for _, css in CONFIDENCE])
    steps = [step for step, _ in CONFIDENCE]
    channels = [np.interp(values, steps, channel) for channel in ends.T]
    return np.rint(np.stack(channels, -1)).astype(np.uint8)


def _colour_height(values: np.ndarray) -> np.ndarray:
    """Map values 0..1 to (N, 3) uint8 RGB along turbo."""
    levels = np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)
    if not len(levels):
        return np.zeros((0, 3), np.uint8)
    return cv2.applyColorMap(levels[:, None], cv2.COLORMAP_TURBO)[:, 0, ::-1]


#: About the most points that a browser without a graphics chip draws 25 times a second.
FEW = 8_000
#: Blocks k voxels wide of a surface of N voxels, as a share of N / k^2.
_BLOCKS = 1.4


@dataclass(frozen=True, eq=False)
class Points:
    """Voxels as points: (N, 3) float16 m from the grid's centre, and (N, 3) uint8 RGB. size: of a
    point, m. blocks: the same as fewer, larger points; None if these are few."""

    positions: np.ndarray
    colours: np.ndarray
    size: float
    blocks: Points | None = None

    @property
    def nbytes(self) -> int:
        """Size in memory, bytes."""
        own = self.positions.nbytes + self.colours.nbytes
        return own + (self.blocks.nbytes if self.blocks is not None else 0)


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh in place of points, as a GLB file."""

    glb: bytes
    blocks: None = None

    @property
    def nbytes(self) -> int:
        """Size in memory, bytes."""
        return len(self.glb)


class Clouds(ABC):
    """The voxels of frames, by the frames' numbers, in one grid. colourings: what their colour can
    show, those of COLOURINGS."""

    grid: VoxelGrid
    colourings: tuple[str, ...] = COLOURINGS[:1]

    @abstractmethod
    def get(self, frame: int) -> Points | Surface | None:
        """Return the voxels of a frame; None as long as they are not known."""

    @abstractmethod
    def describe(self, frame: int) -> str:
        """Return what is known of a frame's voxels, for the page; empty if there is nothing to
        say."""

    def choose_colouring(self, colouring: str) -> None:  # noqa: B027
        """Have colours show something else from now on, if there is a choice."""

    def close(self) -> None:  # noqa: B027
        """End all work in the background, if there is any."""


def grid_centre(grid: VoxelGrid) -> np.ndarray:
    """Return the centre (3,) m that points are relative to; half floats resolve 1 mm there."""
    return (grid.low + grid.high) / 2


def make_points(cloud: VoxelCloud, colouring: str = COLOURINGS[0]) -> Points:
    """Return a cloud's voxels as points."""
    positions = (cloud.centres - grid_centre(cloud.grid)).astype(np.float16)
    colours = colour_voxels(cloud, colouring)
    blocks = make_blocks(cloud, colours, FEW) if len(cloud) > FEW else None
    return Points(positions, colours, cloud.grid.voxel_size, blocks)


def make_blocks(cloud: VoxelCloud, colours: np.ndarray, most: int) -> Points:
    """Return a surface's voxels, with colours (N, 3) uint8, as cubic blocks, about `most`."""
    grid, width = cloud.grid, choose_block_width(len(cloud), most)
    cells, means = merge_voxels(cloud, colours, width)
    size = width * grid.voxel_size
    centres = grid.low + size * (cells + 0.5)
    return Points((centres - grid_centre(grid)).astype(np.float16), means, size)


def choose_block_width(n_voxels: int, most: int) -> int:
    """Return the width of the blocks, in voxels, that a surface is about `most` of."""
    return max(1, int(np.ceil(np.sqrt(_BLOCKS * n_voxels / most)))) if n_voxels > most else 1


def merge_voxels(
    cloud: VoxelCloud, colours: np.ndarray, width: int
) -> tuple[np.ndarray, np.ndarray]:
    """Merge a cloud's voxels, with colours (N, 3) uint8, into cubic blocks of `width` voxels.

    Returns the blocks' cells (M, 3) int, counted in blocks from the grid's first one, and their
    mean colours (M, 3) uint8.
    """
    grid = cloud.grid
    shape = tuple(-(-n // width) for n in grid.shape)
    cells = [at // width for at in np.unravel_index(cloud.indices, grid.shape)]
    used, of_voxel, counts = np.unique(
        np.ravel_multi_index(cells, shape), return_inverse=True, return_counts=True
    )
    sums = [np.bincount(of_voxel, colours[:, channel], len(used)) for channel in range(3)]
    means = np.rint(np.stack(sums, -1) / counts[:, None]).astype(np.uint8)
    return np.stack(np.unravel_index(used, shape), -1), means


def make_surface(mesh: trimesh.Trimesh, cloud: VoxelCloud, colouring: str) -> Surface:
    """Return a cloud's mesh in the colours of the nearest voxels."""
    coloured: Any = mesh.copy()
    coloured.visual.vertex_colors = colour_vertices(mesh.vertices, cloud, colouring)
    return Surface(make_glb(coloured))


class KeptPoints:
    """The voxels that were used last, up to KEPT_BYTES. It may be used by several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._points: OrderedDict[int, Points | Surface] = OrderedDict()
        self.nbytes = 0

    def __len__(self) -> int:
        return len(self._points)

    def get(self, frame: int) -> Points | Surface | None:
        """Return the voxels of a frame, or None."""
        with self._lock:
            if frame in self._points:
                self._points.move_to_end(frame)
            return self._points.get(frame)

    def put(self, frame: int, points: Points | Surface) -> None:
        """Keep the voxels of a frame in place of those that were not used for longest."""
        with self._lock:
            old = self._points.pop(frame, None)
            self.nbytes += points.nbytes - (old.nbytes if old else 0)
            self._points[frame] = points
            while self.nbytes > KEPT_BYTES and len(self._points) > 1:
                self.nbytes -= self._points.popitem(last=False)[1].nbytes


class StoredClouds(Clouds):
    """The clouds that `psfs reconstruct` wrote, read when they are shown.

    mesher: makes the mesh of a frame's cloud, which is shown in its place.
    """

    colourings = COLOURINGS

    def __init__(
        self,
        run: ReconstructionFolder,
        mesher: Callable[[int], trimesh.Trimesh] | None = None,
    ) -> None:
        self._run, self._mesher = run, mesher
        self._kept, self._colouring = KeptPoints(), COLOURINGS[0]
        self.grid = run.grid
        self._facts = {int(facts["index"]): facts for facts in run.summary["frames"]}

    def get(self, frame: int) -> Points | Surface | None:
        """Return the voxels of a frame; None if it was not reconstructed. Raises InputError."""
        if frame not in self._facts:
            return None
        kept, found = self._kept, self._kept.get(frame)
        if found is None:
            cloud = self._run.cloud(frame)
            if self._mesher is not None and len(cloud):
                found = make_surface(self._mesher(frame), cloud, self._colouring)
            else:
                found = make_points(cloud, self._colouring)
            kept.put(frame, found)
        return found

    def choose_colouring(self, colouring: str) -> None:
        """Have colours show something else from now on."""
        # In this order: what `get` keeps in the new place is coloured so.
        self._colouring, self._kept = colouring, KeptPoints()

    def describe(self, frame: int) -> str:
        """Return the size of a frame's cloud."""
        facts = self._facts[frame]
        return f"{facts['surface_voxels']:,} voxels, {1e3 * facts['volume_m3']:.3g} l"


class CarvedClouds(Clouds):
    """The clouds of a track's frames, carved again by a thread from the first frame on.

    carve: returns an iterator over frames' numbers and clouds in `grid`; its first step may take
    seconds. known: called after each frame.
    """

    def __init__(
        self,
        grid: VoxelGrid,
        n_frames: int,
        carve: Callable[[], Iterator[tuple[int, VoxelCloud]]],
        known: Callable[[int], object],
    ) -> None:
        self.grid, self._n_frames = grid, n_frames
        self._carve, self._known, self._kept = carve, known, KeptPoints()
        self._ended, self._wanted, self._error = threading.Event(), threading.Event(), ""
        self._n_done = 0
        self._thread = threading.Thread(target=self._work, daemon=True, name="carving")
        self._thread.start()

    def get(self, frame: int) -> Points | Surface | None:
        """Return the voxels of a frame; None as long as they are not carved, or if those of later
        frames took their place."""
        return self._kept.get(frame)

    def want(self, wanted: bool) -> None:
        """Begin or go on carving; or pause."""
        (self._wanted.set if wanted else self._wanted.clear)()

    def describe(self, frame: int) -> str:
        """Return how many frames are carved; empty if all are, and there is room for this one's."""
        if self._error:
            return self._error
        if self._n_done < self._n_frames:
            return f"voxels are being computed: {self._n_done} of {self._n_frames} frames so far"
        if self._kept.get(frame) is not None:
            return ""
        return f"no voxels: memory holds those of {len(self._kept)} of {self._n_frames} frames"

    def close(self) -> None:
        """End carving, after the frame that is being carved."""
        self._ended.set()
        self._wanted.set()
        self._thread.join(timeout=30)

    def _work(self) -> None:
        self._wanted.wait()
        if self._ended.is_set():
            return
        try:
            with closing(self._carve()) as frames:  # type: ignore[type-var]
                for frame, cloud in frames:
                    self._kept.put(frame, make_points(cloud))
                    self._n_done += 1
                    self._known(frame)
                    self._wanted.wait()
                    if self._ended.is_set():
                        return
        except UserError as error:
            self._error = f"no voxels: {error}"
            self._known(-1)


@dataclass(frozen=True, eq=False)
class Opened:
    """A run that is watched.

    frames: (F,) numbers, ascending. box: lowest and highest corner (3,) m of what is shown, which
    the floor lies under. sequence: the footage; None if it is gone. remarks: warnings, for the
    page.
    """

    folder: Path
    frames: np.ndarray
    fps: float
    box: tuple[np.ndarray, np.ndarray]
    sequence: Sequence | None
    clouds: Clouds | None
    remarks: tuple[str, ...] = ()
    voxels_shown: bool = True
    """Whether voxels are shown before the user chooses."""

    def close(self) -> None:
        """End all work in the background."""
        if self.clouds is not None:
            self.clouds.close()


def open_voxels(folder: Path, mesher: Callable[[int], trimesh.Trimesh] | None = None) -> Opened:
    """Open a run of `psfs reconstruct`; mesher: see `StoredClouds`. Raises InputError, or
    MissingFileError."""
    run = ReconstructionFolder.open(folder)
    remarks: list[str] = []
    run.warn_if_unfinished(remarks.append)
    if not run.indices:
        raise InputError(f"{folder}: holds no reconstructed frame; expected at least one")
    sequence = try_footage(run.sequence, remarks)
    fps = float(run.summary["sequence"].get("fps") or 25.0)
    frames, box = np.array(run.indices), (run.grid.low, run.grid.high)
    return Opened(folder, frames, fps, box, sequence, StoredClouds(run, mesher), tuple(remarks))


def try_footage(open_footage: Callable[[], Sequence], remarks: list[str]) -> Sequence | None:
    """Return the footage, or add a remark why there is none."""
    try:
        return open_footage()
    except UserError as error:
        remarks.append(f"no pictures: {error}")
        return None
