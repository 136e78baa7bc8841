"""Motion-capture markers as truth: their places on the body, and the errors of a track's virtual
markers (Rymut 2016, 6.1)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from apf.body.kinematics import bone_matrices
from apf.evaluation import MARKER_SETS
from apf.evaluation.evaluate import Evaluation, common_frames, evaluate_points
from apf.formats.trc import JointSeries
from apf.keypoints.landmarks import Landmark, locate_points, parse_landmarks
from apf.tracking.track import Track
from cl import InputError
from psfs.cameras.names import join_names
from psfs.common.files import read_toml
from psfs.common.ranges import check_number


@dataclass(frozen=True, eq=False)
class MarkerSet:
    """Points of the body with markers. stature: m, of the person that the offsets refer to."""

    name: str
    markers: tuple[Landmark, ...]
    stature: float


def load_markers(source: str | Path) -> MarkerSet:
    """Read a marker set: the name of a shipped one, or a TOML file with [[marker]] tables, whose
    keys are those of `landmarks.toml`, and optionally `stature`. Raises InputError."""
    path = MARKER_SETS.get(str(source), Path(source))
    if path.suffix.lower() != ".toml":
        shipped = join_names(MARKER_SETS)
        raise InputError(f"markers {source}: expected a TOML file or one of {shipped}")
    values = read_toml(path)
    stature = values.pop("stature", 1.75)
    entries = values.pop("marker", [])
    if values or not isinstance(entries, list) or not isinstance(stature, int | float):
        contents = join_names(values) if values else "another kind of value"
        raise InputError(f"{path}: {contents}; expected [[marker]] tables, and perhaps stature, m")
    check_number(f"{path}: stature, m,", float(stature), 0.3, 3)
    # The spread of a marker is not needed here, because nothing is fitted to it.
    spread = {"spread": 0.01}
    tables = [spread | entry if isinstance(entry, dict) else entry for entry in entries]
    return MarkerSet(path.stem, parse_landmarks(tables, path, "marker"), float(stature))


def evaluate_markers(track: Track, markers: MarkerSet, truth: JointSeries) -> Evaluation:
    """Return the distances of the virtual markers on a track's body from the physical ones, eq.
    (6.1); their means over frames and markers are eq. (6.2) and (6.3).

    Labels may be prefixed with the subject's name and a colon. Raises InputError if there is no
    common frame or marker.
    """
    body, truth = track.its_body, truth.at_rate(track.fps)
    labels = [name.split(":")[-1] for name in truth.joint_names]
    try:
        points = locate_points(body, labels, markers.markers, markers.stature)
    except InputError:
        wanted = join_names(marker.name for marker in markers.markers)
        raise InputError(
            f"no marker in common: the truth has {join_names(truth.joint_names)}; the set "
            f"{markers.name} has {wanted} on joints that {body.name} may lack"
        ) from None
    frames, rows, true_rows = common_frames(track, truth)
    offsets = points.place(body, track.poses[rows]) - truth.joints[true_rows][:, points.columns]
    axes = bone_matrices(body, track.poses[rows])[0][:, points.bones]
    result = evaluate_points(track, truth, (frames, rows), points.names, offsets, axes)
    unused = sorted(set(range(len(labels))) - set(points.columns.tolist()))
    return replace(
        result,
        unmatched_track=tuple(m.name for m in markers.markers if m.name not in points.names),
        unmatched_truth=tuple(truth.joint_names[k] for k in unused),
    )
