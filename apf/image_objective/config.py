"""Settings of the image features and of the objectives over them (Rymut 2016, chapters 2 and 4)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from apf.body.mesh import FRUSTUM_VERTICES, BodyMesh, cone_mesh, load_mesh
from apf.body.model import BodyModel
from apf.formats.pose import read_pose
from cl import InputError
from psfs.cameras.camera import CameraRig
from psfs.cameras.names import listed
from psfs.common.ranges import check_range

#: Where edges come from: the pictures' gradient, OpenCV's Canny, or the silhouette's outline
#: where there are no pictures.
EDGE_KINDS = ("sobel", "canny", "outline")
#: How the distance to the nearest edge becomes proximity, Rymut 2016 eq. (4.26)-(4.28).
PROXIMITIES = ("impulse", "proportional", "exponential")
#: Distances in a picture, Rymut 2016 eq. (2.18) and (2.20).
METRICS = ("euclidean", "chessboard")
#: Rymut 2016 eq. (4.46)-(4.50): weighted sum, smoothed product, per-camera averages of either,
#: and the product over cameras.
OBJECTIVE_KINDS = ("ws", "sp", "aows", "aosp", "posp")
#: What draws and counts the hypotheses: kernels, or hardware rendering (Rymut 2016, 5.2 and 5.3).
RENDERERS = ("opencl", "opengl")
#: The width, px, of the pictures that lengths of these settings are stated for.
STATED_WIDTH = 640


@dataclass(frozen=True)
class ProximityConfig:
    """How the distance d to the nearest edge becomes proximity in [0, 1].

    It is 1 up to `nearest` and 0 from `farthest` on; between them the `function` decides. Rymut's
    eq. (4.28) has d_max for d_min in its first case, and a growing exponential: both are taken for
    misprints. Lengths are pixels of pictures 640 wide.
    """

    function: str = "exponential"
    """One of PROXIMITIES. impulse: 1 on the edge, else 0 (eq. 4.26). proportional: 1 - span
    (d - nearest) / (farthest - nearest) (eq. 4.27). exponential: 1 - span + span
    exp(-decay (d - nearest)) (eq. 4.28), which discriminates more sharply (Rymut 2016, 4.5)."""
    nearest: float = 0.0
    """d_min, px. Set by hand, as Rymut does for every camera setup: only the edge counts fully."""
    farthest: float = 20.0
    """d_max, px. Set by hand."""
    span: float = 1.0
    """Drop of proximity from `nearest` to `farthest`, in (0, 1]. Set by hand: all of it."""
    decay: float = 0.25
    """Of the exponential, 1/px. Set by hand: exp(-1) of it is left 4 px from the edge."""
    metric: str = "euclidean"
    """One of METRICS; Rymut 2016, 2.1 has the chessboard's."""

    def __post_init__(self) -> None:
        if self.function not in PROXIMITIES:
            raise InputError(f"proximity is {self.function!r}; expected {listed(PROXIMITIES)}")
        if self.metric not in METRICS:
            raise InputError(f"the metric is {self.metric!r}; expected {listed(METRICS)}")
        if not (0 <= self.nearest < self.farthest <= 1000 and 0 < self.span <= 1 < 1 + self.decay):
            raise InputError(
                f"proximity from {self.nearest} to {self.farthest} px, span {self.span}, decay "
                f"{self.decay}; expected 0 <= nearest < farthest <= 1000, span in (0, 1], decay > 0"
            )

    def table(self, rig: CameraRig) -> np.ndarray:
        """Return (reach^2 + 2,) uint8: 255 proximity by squared distance, px^2 of the rig's
        pictures; the last entry is 0."""
        unit = rig.width / STATED_WIDTH
        reach = 0 if self.function == "impulse" else math.ceil(self.farthest * unit)
        distance = np.sqrt(np.arange(reach**2 + 2)) / unit
        beyond = distance - self.nearest
        if self.function == "impulse":
            values = np.where(distance == 0, 1.0, 0.0)
        elif self.function == "proportional":
            values = 1 - self.span * beyond / (self.farthest - self.nearest)
        else:
            values = 1 - self.span + self.span * np.exp(-self.decay * np.maximum(beyond, 0))
        if self.function != "impulse":
            values = np.where(beyond <= 0, 1.0, np.where(distance >= self.farthest, 0.0, values))
        values[-1] = 0.0
        return np.rint(255 * values).astype(np.uint8)


@dataclass(frozen=True)
class FeatureConfig:
    """Which edges are found, and where they count; lengths in pixels of pictures 640 wide."""

    edges: str = "sobel"
    """One of EDGE_KINDS. Canny's track no better and take longer, Rymut 2016, 2.1."""
    threshold: float = 60.0
    """Least magnitude of Sobel's gradient, eq. (2.8), of the grey picture in grey levels: a step of
    h levels has 4 h, blurred about 3 h. Set by hand: steps of 20 levels."""
    canny_low: float = 40.0
    """Canny's lower threshold, of the same magnitude. Set by hand."""
    canny_high: float = 100.0
    """Canny's upper threshold. Set by hand, in the ratio of 2 to 3 that Canny 1986 recommends."""
    dilation: float = 3.0
    """Edges count up to so far, px, from the silhouette (Rymut 2016, 2.1). Set by hand."""
    margin: float = 10.0
    """Of the region of interest around the silhouette, px (Rymut 2016, 4.5). Set by hand."""
    cell: int = 8
    """Side, px of the pictures themselves, of the cells that the region consists of. Set by hand:
    small against a limb."""
    cell_pixels: int = 16
    """A cell counts that holds so many pixels of silhouette. Set by hand: specks of noise are
    smaller."""
    blobs: int = 0
    """Where positive, only so many of the largest connected parts of the silhouette make the
    region: four in Rymut 2016, 5.5. By default all that are no specks: what is carved into more
    pieces keeps its hands."""
    proximity: ProximityConfig = field(default_factory=ProximityConfig)
    """How near to an edge is near."""

    def __post_init__(self) -> None:
        if self.edges not in EDGE_KINDS:
            raise InputError(f"edges is {self.edges!r}; expected {listed(EDGE_KINDS)}")
        check_range("the edge threshold", self.threshold, 0, 1500)
        if not 0 < self.canny_low <= self.canny_high:
            raise InputError(
                f"Canny's thresholds are {self.canny_low} and {self.canny_high}; "
                "expected 0 < low <= high"
            )
        check_range("dilation", self.dilation, 0, 100, ends=True)
        check_range("margin", self.margin, 0, ends=True)
        check_range("cell", self.cell, 1, ends=True)
        check_range("cell_pixels", self.cell_pixels, 1, self.cell**2, ends=True)
        check_range("blobs", self.blobs, 0, 100, ends=True)

    def pixels(self, length: float, rig: CameraRig) -> int:
        """Return a length stated for pictures 640 wide in whole pixels of the rig's."""
        return round(length * rig.width / STATED_WIDTH)

    @property
    def squared_threshold(self) -> int:
        """Least squared magnitude in the kernel's whole numbers, 16 times Sobel's."""
        return math.ceil((16 * self.threshold) ** 2)


@dataclass(frozen=True)
class ObjectiveConfig:
    """What an image objective is made of."""

    kind: str = "sp"
    """One of OBJECTIVE_KINDS. The smoothed product is Kwolek & Rymut 2016 eq. (1)."""
    silhouette_weight: float = 0.5
    """w1 of Rymut 2016 eq. (4.46)-(4.50): a factor for the weighted kinds, where w1 + w2 = 1, and
    an exponent for the others. Set by hand: silhouettes and edges count alike."""
    edge_weight: float = 0.5
    """w2 of the same equations. Set by hand."""
    balance: float = 0.5
    """beta of eq. (4.41): share of the image's silhouette against the model's. Set by hand."""
    vertices_per_part: int = 4
    """Shape model, table 6.5: 4 draws cones as trapezoids, more as frusta. Trapezoids track
    best and fastest there."""
    mesh_file: str = ""
    """A mesh of the person instead, metres, for trimesh, in the rest pose of the body."""
    mesh_weights: str = ""
    """npz of how the bones move it, see `load_mesh`; by default the nearest cone's bone does."""
    mesh_pose: str = ""
    """Text file of the pose that the mesh shows, if it is not the rest pose."""
    round_ends: bool = False
    """Whether trapezoids have the round ends of the voxels' likelihood; Rymut's have none."""
    renderer: str = "opencl"
    """One of RENDERERS; OpenGL draws no round ends. Kernels store no pictures."""

    def __post_init__(self) -> None:
        if self.kind not in OBJECTIVE_KINDS:
            raise InputError(f"the objective is {self.kind!r}; expected {listed(OBJECTIVE_KINDS)}")
        if self.renderer not in RENDERERS:
            raise InputError(f"the renderer is {self.renderer!r}; expected {listed(RENDERERS)}")
        if self.renderer == "opengl" and self.round_ends:
            raise InputError("OpenGL draws no round ends; expected them off, or OpenCL")
        w1, w2 = self.silhouette_weight, self.edge_weight
        if not (w1 >= 0 and w2 >= 0 and 0 < w1 + w2 < np.inf):
            raise InputError(f"the objective's weights are {w1} and {w2}; expected numbers from 0")
        if self.kind in ("ws", "aows") and abs(w1 + w2 - 1) > 1e-6:
            raise InputError(f"the weights of {self.kind} are {w1} and {w2}; expected a sum of 1")
        check_range("the balance", self.balance, 0, 1, ends=True)
        known = (4, *FRUSTUM_VERTICES)
        if self.vertices_per_part not in known:
            raise InputError(
                f"{self.vertices_per_part} vertices per part; expected {listed(map(str, known))}"
            )

    def mesh(self, body: BodyModel) -> BodyMesh | None:
        """Return the shape of `body`; None stands for the flat model. Raises InputError where the
        mesh's files are not what they should be."""
        if self.mesh_file:
            pose = read_pose(Path(self.mesh_pose), body) if self.mesh_pose else body.rest_pose
            return load_mesh(self.mesh_file, body, pose, self.mesh_weights or None)
        return cone_mesh(body, self.vertices_per_part) if self.vertices_per_part > 4 else None
