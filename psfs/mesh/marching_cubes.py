"""Extract closed surfaces by marching cubes, smooth, colour and write them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from cl import Device, InputError, NumpyDevice
from psfs.backend import AnyReconstructor, make_reconstructor
from psfs.common.colours import CLAY
from psfs.common.files import write_atomically
from psfs.common.numbers import FROM_Y_UP
from psfs.common.regions import fill_holes, keep_large_regions
from psfs.mesh.config import FORMATS, SMOOTHING
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.reconstructor import Reconstructor
from psfs.sequence import Sequence
from psfs.voxels.config import DEBRIS_SHARE, OccupancyConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid

if TYPE_CHECKING:
    import trimesh

# Taubin 1995: each step towards the neighbours by _LAMBDA is followed by one back by _MU. Features
# of spatial frequency below 1 / _LAMBDA - 1 / _MU = 0.11 are kept, so that nothing shrinks.
_LAMBDA, _MU = 0.5, 0.53
#: Probability at which the surface lies.
THRESHOLD = OccupancyConfig().threshold
_COMMENT = "psfs-apf surface; unit metre; right-handed, Z up"
_TO_Y_UP = np.eye(4)
_TO_Y_UP[:3, :3] = FROM_Y_UP.T


def extract_surface(
    probability: np.ndarray,
    grid: VoxelGrid,
    threshold: float = THRESHOLD,
    smoothing: int = SMOOTHING,
    debris: float = DEBRIS_SHARE,
    cloud: VoxelCloud | None = None,
) -> trimesh.Trimesh:
    """Extract the surface, m, where the smoothed probability (nx, ny, nz) crosses `threshold`.

    The surface is closed, also where the grid's border cuts the body, and faces outwards. Connected
    regions with less than the share `debris` of the largest one's voxels are removed, and cavities
    are filled, since no silhouette can show one. smoothing: steps after Taubin 1995, which do not
    shrink. cloud: its colours, if any, are taken over by the nearest vertices. Raises InputError if
    no voxel is above the threshold.
    """
    import trimesh  # takes a while to load

    vertices, faces = extract_mesh(probability, grid, threshold, smoothing, debris)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    if cloud is not None and cloud.colour is not None and len(cloud):
        _, nearest = scipy.spatial.cKDTree(cloud.centres).query(mesh.vertices)
        _paint(mesh, cloud.colour[nearest])
    return mesh


def extract_mesh(
    probability: np.ndarray, grid: VoxelGrid, threshold: float, smoothing: int, debris: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices (M, 3) m and the faces (T, 3) of `extract_surface`."""
    from skimage.measure import marching_cubes  # takes a while to load

    solid = _clean(np.asarray(probability, np.float32), threshold, debris)
    # A layer of zeros closes the mesh; voxel centres lie half a voxel from the corner.
    vertices, faces, _, _ = marching_cubes(np.pad(solid, 1), threshold, gradient_direction="ascent")
    vertices = grid.origin + (vertices.astype(np.float64) - 0.5) * grid.voxel_size
    first, second = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).T
    shares = 1 / np.bincount(first, minlength=len(vertices))[first]
    mean = scipy.sparse.csr_matrix((shares, (first, second)), shape=2 * [len(vertices)])
    for step in range(smoothing):
        vertices += (-_MU if step % 2 else _LAMBDA) * (mean @ vertices - vertices)
    return vertices, faces


def _clean(probability: np.ndarray, threshold: float, debris: float) -> np.ndarray:
    """Return `probability` with debris set to 0 and cavities to 1."""
    occupied = probability > threshold
    if not occupied.any():
        raise InputError(f"no voxel has a probability above {threshold:g}; expected a body")
    kept = keep_large_regions(occupied, debris)
    cavities = fill_holes(kept) & ~kept
    cleaned: np.ndarray = np.where(occupied & ~kept, np.float32(0), probability)
    cleaned[cavities] = 1
    return cleaned


class Mesher:
    """Makes the mesh of a frame of a finished run: `mesher(index)`.

    The clouds on disk hold surface voxels only. The probability is therefore computed again from
    the frame's pictures, in the box of the cloud, and determines where between two voxels the
    surface passes. Which voxels lie inside is taken from the cloud, since silhouettes that depend
    on earlier frames may differ a little for a single frame.
    """

    def __init__(
        self,
        device: Device | NumpyDevice,
        run: ReconstructionFolder,
        sequence: Sequence,
        smoothing: int = SMOOTHING,
    ) -> None:
        self.device, self.run, self.sequence, self.smoothing = device, run, sequence, smoothing
        self._config = run.config
        self._reconstructor: Reconstructor | None = None

    def __call__(self, index: int) -> trimesh.Trimesh:
        """Return the mesh of a frame. Raises InputError if its cloud is empty."""
        cloud = self.run.cloud(index)
        if not len(cloud):
            raise InputError(f"{self.run.out}: the cloud of frame {index} is empty")
        box, threshold = occupied_box(cloud), self._config.occupancy.threshold
        probability = match_solid(self.probability(index, box), fill_cloud(cloud, box), threshold)
        return extract_surface(probability, box, threshold, self.smoothing, 0.0, cloud)

    def probability(self, index: int, box: VoxelGrid) -> np.ndarray:
        """Return the probability (nx, ny, nz) in the box, cut out of a reconstructor's larger
        grid."""
        frame, (nx, ny, nz) = self.sequence.read(index), box.shape
        probability = self._covering(box)(frame).probability
        if not isinstance(probability, np.ndarray):
            probability = probability.get()
        return probability[:nx, :ny, :nz]

    def _covering(self, box: VoxelGrid) -> AnyReconstructor:
        """Return a reconstructor whose grid begins with `box`.

        One that is large enough is reused, since another grid shape needs other kernels.
        """
        room = (0, 0, 0) if self._reconstructor is None else self._reconstructor.grid.shape
        if self._reconstructor is not None and np.all(np.array(box.shape) <= room):
            self._reconstructor.move_to(VoxelGrid(box.origin, box.voxel_size, room))
            return self._reconstructor
        nx, ny, nz = (-(-max(n, m) // 16) * 16 for n, m in zip(box.shape, room, strict=True))
        grid = VoxelGrid(box.origin, box.voxel_size, (nx, ny, nz))
        reconstructor = make_reconstructor(
            self.device, self.sequence.rig, grid, self.sequence.background, self._config
        )
        if isinstance(reconstructor, Reconstructor):  # the NumPy twin has nothing to rebuild
            self._reconstructor = reconstructor
        return reconstructor


def occupied_box(cloud: VoxelCloud) -> VoxelGrid:
    """Return the part of the cloud's grid that holds it, with a margin of one voxel inside the
    grid."""
    ijk = np.stack(np.unravel_index(cloud.indices, cloud.grid.shape))
    low = np.maximum(ijk.min(1) - 1, 0)
    nx, ny, nz = np.minimum(ijk.max(1) + 2, cloud.grid.shape) - low
    origin = cloud.grid.origin + low * cloud.grid.voxel_size
    return VoxelGrid(origin, cloud.grid.voxel_size, (nx, ny, nz))


def fill_cloud(cloud: VoxelCloud, box: VoxelGrid) -> np.ndarray:
    """Return (nx, ny, nz) bool: voxels of `box` that the cloud's surface encloses, itself
    included."""
    low = np.rint((box.origin - cloud.grid.origin) / box.voxel_size).astype(int)
    i, j, k = np.unravel_index(cloud.indices, cloud.grid.shape)
    surface = np.zeros(box.shape, bool)
    surface[i - low[0], j - low[1], k - low[2]] = True
    return fill_holes(surface)


def match_solid(probability: np.ndarray, solid: np.ndarray, threshold: float) -> np.ndarray:
    """Set voxels of `probability` that contradict `solid` to the other side of the threshold."""
    agrees = (probability > threshold) == solid
    moved = np.where(solid, np.float32((threshold + 1) / 2), np.float32(threshold / 2))
    return np.where(agrees, probability, moved)


def write_mesh(mesh: trimesh.Trimesh, path: Path) -> None:
    """Write PLY (binary), OBJ or GLB, by the suffix, with normals and the vertices' colours.

    PLY: metres, Z up, which a comment says. OBJ and GLB: metres, +Y up, as their readers expect;
    GLB with linear colours, as glTF 2.0 requires (3.4, 3.9.2). Raises InputError for another
    suffix.
    """
    suffix = path.suffix.lower().lstrip(".")
    if suffix not in FORMATS:
        endings = ", ".join(f".{name}" for name in FORMATS)
        raise InputError(f"{path}: unknown mesh format; expected a name that ends in {endings}")
    content = {"ply": _ply, "glb": make_glb, "obj": _obj}[suffix](mesh)
    with write_atomically(path) as temporary:
        temporary.write_bytes(content)


def _ply(mesh: trimesh.Trimesh) -> bytes:
    content: Any = mesh.export(file_type="ply", vertex_normal=True)
    first, rest = content.split(b"\ncomment ", 1)
    return b"%s\ncomment %s\ncomment %s" % (first, _COMMENT.encode(), rest)


def _obj(mesh: trimesh.Trimesh) -> bytes:
    header = _COMMENT.replace("Z up", "Y up")
    turned = mesh.copy().apply_transform(_TO_Y_UP)
    text = turned.export(file_type="obj", include_normals=True, digits=6, header=header)
    return str(text).encode()


def make_glb(mesh: trimesh.Trimesh) -> bytes:
    """Return the mesh as a GLB file: +Y up, in its vertices' colours, matte."""
    turned = mesh.copy()
    turned.apply_transform(_TO_Y_UP)
    colours = vertex_colours(mesh)
    base = to_linear(np.array(CLAY))
    if colours is not None:
        base = np.ones(3)
        linear = np.rint(255 * to_linear(colours / 255)).astype(np.uint8)
        _paint(turned, linear)

    def matte(tree: dict[str, Any]) -> None:
        """Add a matte material: without one glTF means polished metal."""
        surface = {"baseColorFactor": [*base.tolist(), 1.0], "metallicFactor": 0.0}
        tree["materials"] = [{"pbrMetallicRoughness": surface | {"roughnessFactor": 0.9}}]
        for part in tree["meshes"]:
            for primitive in part["primitives"]:
                primitive["material"] = 0

    scene: Any = turned.scene()
    return bytes(scene.export(file_type="glb", include_normals=True, tree_postprocessor=matte))


def vertex_colours(mesh: trimesh.Trimesh) -> np.ndarray | None:
    """Return (N, 3) uint8 RGB of the vertices, or None if the mesh has no colours."""
    visual: Any = mesh.visual
    return np.asarray(visual.vertex_colors)[:, :3] if visual.kind == "vertex" else None


def _paint(mesh: trimesh.Trimesh, colours: np.ndarray) -> None:
    visual: Any = mesh.visual
    visual.vertex_colors = colours


def to_linear(srgb: np.ndarray) -> np.ndarray:
    """Convert sRGB values 0..1 to linear light (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
