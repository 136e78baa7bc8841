"""Settings of the image features and of the objectives over them (Rymut 2016, chapters 2 and 4)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, get_args

from pydantic import model_validator

from cl import InputError
from psfs.common.config import Config, fraction, nonnegative, part, setting

if TYPE_CHECKING:
    import numpy as np

    from apf.body.mesh import BodyMesh
    from apf.body.model import BodyModel
    from psfs.cameras.camera import CameraRig

#: Where edges come from: the pictures' gradient, OpenCV's Canny, or the silhouette's outline
#: where there are no pictures.
EdgeKind = Literal["sobel", "canny", "outline"]
#: How the distance to the nearest edge becomes proximity, Rymut 2016 eq. (4.26)-(4.28).
ProximityKind = Literal["impulse", "proportional", "exponential"]
#: Rymut 2016 eq. (4.46)-(4.50): weighted sum, smoothed product, per-camera averages of either,
#: and the product over cameras.
ObjectiveKind = Literal["ws", "sp", "aows", "aosp", "posp"]
OBJECTIVE_KINDS: tuple[str, ...] = get_args(ObjectiveKind)
#: The width, px, of the pictures that lengths of these settings are stated for.
STATED_WIDTH = 640


class ProximityConfig(Config):
    """Conversion of the distance d to the nearest edge into a proximity in [0, 1].

    Proximity is 1 up to `nearest`, 0 from `farthest` on, and follows `function` in between. Rymut's
    eq. (4.28) has d_max instead of d_min in its first case and a growing exponential; both are
    treated as misprints. Lengths are pixels of pictures 640 wide.
    """

    SOURCE: ClassVar = "by hand"

    function: ProximityKind = setting(
        "exponential",
        "Function of the distance. impulse: 1 on the edge, else 0 (eq. 4.26). proportional: 1 - "
        "span s (eq. 4.27) with s = (d - nearest) / (farthest - nearest). exponential: 1 - span + "
        "span exp(-5 s) (eq. 4.28), which is all but gone at `farthest`.",
        "it discriminates more sharply (Rymut 2016, 4.5)",
        flag="--proximity",
        flag_help="image objectives: function of the distance to edges",
    )
    nearest: float = setting(
        0.0,
        "Distance d_min up to which proximity is 1.",
        "by hand, as Rymut does for every camera setup: only the edge counts fully",
        "px of 640",
        least=0,
        most=1000,
    )
    farthest: float = setting(
        20.0,
        "Distance d_max from which on proximity is 0; above `nearest`.",
        unit="px of 640",
        above=0,
        most=1000,
        flag="--edge-reach",
        flag_help="image objectives: px of 640 at which it is 0",
    )
    span: float = setting(
        1.0,
        "Drop of proximity from `nearest` to `farthest`.",
        "by hand: all of it",
        above=0,
        most=1,
    )
    metric: Literal["euclidean", "chessboard"] = setting(
        "euclidean",
        "Distance in a picture, Rymut 2016 eq. (2.18) and (2.20), who has the chessboard's.",
    )

    @model_validator(mode="after")
    def _ascend(self) -> ProximityConfig:
        if not self.nearest < self.farthest:
            raise InputError(
                f"proximity from {self.nearest} to {self.farthest} px; expected nearest < farthest"
            )
        return self

    def table(self, rig: CameraRig) -> np.ndarray:
        """Return (reach^2 + 2,) uint8: 255 proximity by squared distance, px^2 of the rig's
        pictures; the last entry is 0."""
        import numpy as np

        unit = rig.width / STATED_WIDTH
        reach = 0 if self.function == "impulse" else math.ceil(self.farthest * unit)
        distance = np.sqrt(np.arange(reach**2 + 2)) / unit
        beyond = distance - self.nearest
        share = beyond / (self.farthest - self.nearest)
        if self.function == "impulse":
            values = np.where(distance == 0, 1.0, 0.0)
        elif self.function == "proportional":
            values = 1 - self.span * share
        else:
            values = 1 - self.span + self.span * np.exp(-5 * np.maximum(share, 0))
        if self.function != "impulse":
            values = np.where(beyond <= 0, 1.0, np.where(distance >= self.farthest, 0.0, values))
        values[-1] = 0.0
        return np.rint(255 * values).astype(np.uint8)


class FeatureConfig(Config):
    """Detection of edges, and the region where they count. Lengths: pixels of pictures 640 wide."""

    SOURCE: ClassVar = "by hand"

    edges: EdgeKind = setting(
        "sobel",
        "Where edges come from.",
        "Canny's track no better and take longer, Rymut 2016, 2.1",
        flag="--edges",
        flag_help="image objectives: where edges come from",
    )
    threshold: float = setting(
        60.0,
        "Least magnitude of Sobel's gradient, eq. (2.8), of the grey picture: a step of h levels "
        "has 4 h, blurred about 3 h.",
        "by hand: steps of 20 levels",
        "grey levels",
        above=0,
        below=1500,
    )
    dilation: float = setting(
        3.0,
        "Distance from the silhouette up to which edges count (Rymut 2016, 2.1).",
        unit="px of 640",
        least=0,
        most=100,
    )
    margin: float = nonnegative(
        10.0,
        "Margin of the region of interest around the silhouette (Rymut 2016, 4.5).",
        unit="px of 640",
    )
    blobs: int = setting(
        0,
        "Number of largest connected parts of the silhouette that make up the region; four in "
        "Rymut 2016, 5.5; 0 for all parts except specks.",
        "by hand: a silhouette in more pieces keeps its hands",
        least=0,
        most=100,
    )
    proximity: ProximityConfig = part(ProximityConfig)

    def pixels(self, length: float, rig: CameraRig) -> int:
        """Convert a length for pictures 640 wide to whole pixels of the rig's pictures."""
        return round(length * rig.width / STATED_WIDTH)

    @property
    def squared_threshold(self) -> int:
        """Least squared magnitude in the kernel's whole numbers, 16 times Sobel's."""
        return math.ceil((16 * self.threshold) ** 2)


class ObjectiveConfig(Config):
    """Settings of an image objective."""

    SOURCE: ClassVar = "by hand"

    kind: ObjectiveKind = setting(
        "sp", "Kind of objective.", "the smoothed product is Kwolek & Rymut 2016 eq. (1)"
    )
    silhouette_weight: float = nonnegative(
        0.5,
        "Weight w1 of Rymut 2016 eq. (4.46)-(4.50): a factor for the weighted kinds, where "
        "w1 + w2 = 1, and an exponent for the others.",
        "by hand: silhouettes and edges count alike",
        flag="--silhouette-weight",
    )
    edge_weight: float = nonnegative(0.5, "Weight w2 of the same equations.", flag="--edge-weight")
    balance: float = fraction(
        0.5, "Share of the image's silhouette against the model's, beta of eq. (4.41)."
    )
    vertices_per_part: Literal[4, 8, 18, 34, 66, 130, 258, 514] = setting(
        4,
        "Number of vertices per part, table 6.5: 4 draws cones as trapezoids, more as frusta.",
        "trapezoids track best and fastest there",
    )
    mesh_file: str = setting(
        "", "Mesh of the person instead, metres, that trimesh reads, in the rest pose of the body."
    )
    mesh_weights: str = setting(
        "",
        "File (npz) of how the bones move the mesh, see `load_mesh`; by default the nearest cone's "
        "bone does.",
        flag="--shape-weights",
        flag_help="how the bones move the mesh: weights, vertices x bones",
        metavar="NPZ",
    )
    mesh_pose: str = setting(
        "",
        "Text file of the pose that the mesh shows, if it is not the rest pose.",
        flag="--shape-pose",
        flag_help="pose that the mesh shows, a text file",
        metavar="P",
    )
    round_ends: bool = setting(
        False,
        "Whether trapezoids have the round ends of the voxels' likelihood; Rymut's have none.",
        flag="--round-ends",
        flag_help="trapezoids with the cones' round ends",
    )
    renderer: Literal["opencl", "opengl"] = setting(
        "opencl",
        "What draws and counts the hypotheses: kernels, which store no pictures, or hardware "
        "rendering, which draws no round ends (Rymut 2016, 5.2 and 5.3).",
        flag="--renderer",
        flag_help="image objectives: what draws the hypotheses",
    )

    @model_validator(mode="after")
    def _fit(self) -> ObjectiveConfig:
        if self.renderer == "opengl" and self.round_ends:
            raise InputError("OpenGL draws no round ends; expected them off, or OpenCL")
        w1, w2 = self.silhouette_weight, self.edge_weight
        if not w1 + w2 > 0:
            raise InputError(
                f"the objective's weights are {w1} and {w2}; expected one of them above 0"
            )
        if self.kind in ("ws", "aows") and abs(w1 + w2 - 1) > 1e-6:
            raise InputError(f"the weights of {self.kind} are {w1} and {w2}; expected a sum of 1")
        return self

    def mesh(self, body: BodyModel) -> BodyMesh | None:
        """Return the mesh of `body`; None if cones are drawn as flat trapezoids. Raises InputError
        if a file of the mesh is invalid."""
        from apf.body.mesh import cone_mesh, load_mesh
        from apf.formats.pose import read_pose

        if self.mesh_file:
            pose = read_pose(Path(self.mesh_pose), body) if self.mesh_pose else body.rest_pose
            return load_mesh(self.mesh_file, body, pose, self.mesh_weights or None)
        return cone_mesh(body, self.vertices_per_part) if self.vertices_per_part > 4 else None
