"""Bodies for the tests of the tracker."""

import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt

from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel
from apf.body.toml import load_body
from psfs.common.cones import CONE_FLOATS, cone_distances
from psfs.voxels.grid import VoxelGrid

#: Small and awkward: a root away from the origin, free axes whose order in the pose is not that
#: of the file, inverted ones, a slider after a hinge, a turned bone, elliptic sections, a cone that
#: is not looked for in images, and a second root that cannot move at all.
STICK = """
name = "stick"
edges = [["base", "tip"]]
apart = [["lower", "post"], ["post", "upper"]]

[[bone]]
name = "l_lower"
offset = [0.1, -0.2, 0.3]
axes = [
    { axis = "-tx", sigma = 0.01, dof = 3, limits = [-0.5, 0.5] },
    { axis = "rz", sigma = 0.02, dof = 1 },
    { axis = "ty", sigma = 0.0, dof = 4, rest = 0.05 },
]

[[bone]]
name = "upper"
parent = "l_lower"
offset = [0.0, 0.05, 0.6]
rest = [[0.0, -0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, 0.6]]
axes = [
    { axis = "-ry", sigma = 0.05, dof = 0, limits = [-0.1, 0.2], name = "bend" },
    { axis = "rx", sigma = 0.03, dof = 2, limits = [-2.0, 2.0], rest = 0.3 },
]

[[bone]]
name = "ground"
offset = [0.0, 0.0, 0.05]

[[cone]]
name = "lower"
bone = "l_lower"
start = [0.0, 0.0, 0.0]
end = [0.02, 0.03, 0.6]
radii = [0.2, 0.1]
side = [0.3, 1.0, 0.2]
scale = [1.4, 0.6]

[[cone]]
name = "upper"
bone = "upper"
start = [0.0, 0.1, 0.0]
end = [0.5, 0.1, 0.1]
radii = [0.08, 0.08]

[[cone]]
name = "post"
bone = "ground"
start = [0.0, 0.0, 0.0]
end = [0.0, 0.0, 0.8]
radii = [0.05, 0.15]
in_images = false

[[joint]]
name = "base"
bone = "l_lower"
position = [0.01, 0.02, 0.03]

[[joint]]
name = "tip"
bone = "upper"
position = [0.5, 0.1, 0.1]
"""


def from_text(text: str) -> BodyModel:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "body.toml"
        path.write_text(text)
        return load_body(path)


def named(name: str) -> BodyModel:
    """Return `stick`, or a shipped body."""
    return from_text(STICK) if name == "stick" else load_body(name)


def random_poses(body: BodyModel, n: int, seed: int = 0, wild: bool = False) -> np.ndarray:
    """Draw poses (n, D) around rest; wild: anywhere within the limits, else +-3."""
    random = np.random.default_rng(seed)
    if wild:
        low, high = np.maximum(body.lower, -3), np.minimum(body.upper, 3)
        return random.uniform(low, high, (n, body.n_dof))
    poses = body.rest_pose + random.normal(0, 0.15, (n, body.n_dof))
    return np.clip(poses, body.lower, body.upper)


def bent(body: BodyModel, pose: np.ndarray | None = None, **changes: npt.ArrayLike) -> np.ndarray:
    """Return poses (..., D), by default the one of rest, with other values of these degrees of
    freedom (. as __): by how much they differ."""
    poses = np.array(body.rest_pose if pose is None else pose)
    for name, change in changes.items():
        poses[..., body.dof_names.index(name.replace("__", "."))] += change
    return poses


def surface_points(body: BodyModel, pose: np.ndarray, n: int) -> np.ndarray:
    """Return points (n, 3) on the sides of the cones of `pose`, equally many on each."""
    random = np.random.default_rng(5)
    cones = posed_cones(body, pose[None])[0][random.integers(len(body.cones), size=n)]
    t, angle = random.uniform(0.05, 0.95, (n, 1)), random.uniform(0, 2 * np.pi, (n, 1))
    x, y = (cones[:, k : k + 3] for k in (8, 12))
    radius = cones[:, 3:4] + t * (cones[:, 7:8] - cones[:, 3:4])
    circle = np.cos(angle) * x / np.sum(x * x, -1, keepdims=True)
    circle += np.sin(angle) * y / np.sum(y * y, -1, keepdims=True)
    return cones[:, 0:3] + t * (cones[:, 4:7] - cones[:, 0:3]) + radius * circle


def voxels_of(body: BodyModel, pose: np.ndarray, grid: VoxelGrid) -> tuple[np.ndarray, np.ndarray]:
    """Return whether voxels (V,) lie in a posed body, and the indices of those at its surface."""
    distances = cone_distances(grid.centres(), posed_cones(body, pose[None])[0]).min(1)
    return distances < 0, np.flatnonzero((distances < 0) & (distances > -1.2 * grid.voxel_size))


def crossing() -> np.ndarray:
    """Return a pose of song31 whose left forearm lies across the belly."""
    return bent(named("song31"), l_upper_arm__ry=0.4, l_upper_arm__rz=-1.2, l_forearm__ry=1.3)


def cone(
    start: npt.ArrayLike,
    end: npt.ArrayLike,
    radii: tuple[float, float] = (0.1, 0.1),
    side: npt.ArrayLike | None = None,
    scale: tuple[float, float] = (1, 1),
) -> np.ndarray:
    """Return a posed cone (CONE_FLOATS,) whose section is scaled along `side` and across it."""
    row = np.zeros(CONE_FLOATS)
    row[0:3], row[3], row[4:7], row[7] = start, radii[0], end, radii[1]
    axis = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
    x = np.eye(3)[np.abs(axis).argmin()] if side is None else np.asarray(side, float)
    x = x - axis * (x @ axis)
    x /= np.linalg.norm(x)
    row[8:11], row[12:15] = x / scale[0], np.cross(axis, x) / scale[1]
    return row


def scattered_poses(body: BodyModel, n: int) -> np.ndarray:
    """Return float32 poses (n, D) in front of cameras, at their sides, around and behind them."""
    poses = random_poses(body, n, wild=True)
    places = [i for i, name in enumerate(body.dof_names) if name[-3:] in (".tx", ".ty")]
    poses[:, places] = np.random.default_rng(n).normal(0, 2.5, (n, len(places)))
    poses[: n // 2, places] *= 0.1
    return np.clip(poses, body.lower, body.upper).astype(np.float32)
