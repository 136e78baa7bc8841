"""The cost of each cue in a streamed frame: contours, colours of parts, keypoints."""

from __future__ import annotations

from typing import Any

import numpy as np

from apf.body.kinematics import posed_points
from apf.body.model import Joint
from apf.filters.term_weights import KEYPOINTS_ON
from apf.initialisation.from_joints import fit_to_joints
from apf.keypoints.landmarks import locate_points
from apf.likelihood.keypoint_model import KeypointModel
from apf.likelihood.observations import PointObservations
from timings.bench_scene import there_and_back
from timings.measure import Place
from timings.whole_frame import Problem, Sightings, WholeFrame, stream_run

#: The 17 keypoints of COCO, which most pose networks detect.
COCO = ("nose", *(f"{side}_{part}" for part in (
    "eye", "ear", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    for side in ("left", "right")))  # fmt: skip
#: Standard deviation, px, of each of their coordinates.
_ERROR = 3.0
_WITHOUT_CONTOUR, _WITHOUT_COLOUR = {"contour_weight": 0.0}, {"part_colour_weight": 0.0}
#: The changed settings of each variant.
VARIANTS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "without contours": _WITHOUT_CONTOUR,
    "without colours of parts": _WITHOUT_COLOUR,
    "without both": {**_WITHOUT_CONTOUR, **_WITHOUT_COLOUR},
    "with 17 keypoints in each camera": KEYPOINTS_ON,
}


def streamed_cues(
    place: Place, problem: Problem, frames: int, repetitions: int, seconds: float
) -> dict[str, Any]:
    """Return a row per variant: ms from pose to pose of `repetitions` streamed runs of `frames`,
    each of at most `seconds`, the variants in turn; the runs' mean error."""
    device = place.device()
    held = problem.scene.pin(device)
    seen = make_sightings(problem)
    wholes = {}
    for name, changes in VARIANTS.items():
        whole = WholeFrame(device, problem.smaller(**changes))
        wholes[name] = whole, seen if changes is KEYPOINTS_ON else None
    runs: dict[str, list[Any]] = {name: [] for name in wholes}
    for whole, sightings in wholes.values():
        stream_run(whole, held, 3, sightings=sightings)
    for _ in range(repetitions):
        for name, (whole, sightings) in wholes.items():
            runs[name].append(stream_run(whole, held, frames, seconds, sightings=sightings))
    rows = [
        {
            "variant": name,
            "runs": [run["frames"] for run in of],
            "error_mm": float(np.mean([run["error_mm"] for run in of])),
        }
        for name, of in runs.items()
    ]
    return {"label": place.label, "cores": place.cores, "rows": rows}


def make_sightings(problem: Problem) -> Sightings:
    """Return a function that gives the keypoints in all cameras of the frame played at a place: the
    true joints with noise."""
    points = locate_points(problem.body, COCO)
    n_points = len(points)
    own = np.arange(n_points)
    one = np.ones(n_points)
    model = KeypointModel(
        columns=points.columns, bone=points.bones, position=points.offsets,
        partner=np.where(points.partners == own, -1, points.partners),
        confidence=np.array([0.0, 1.0]), error=np.full(2, _ERROR), factor=one,
    )  # fmt: skip
    random = np.random.default_rng(0)
    seen = [_observe(problem, joints, random) for joints in problem.scene.joints]

    def sightings(place: int) -> PointObservations:
        return model.observations(seen[there_and_back(place, len(seen))])

    return sightings


def _observe(problem: Problem, joints: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return keypoints (V, K, 3) of one frame: px and confidence."""
    named = dict(zip(problem.scene.joint_names, joints, strict=True))
    body, pose, _ = fit_to_joints(problem.body, named)
    points = locate_points(body, COCO)
    fixed = [Joint(*of) for of in zip(points.names, points.bones, points.offsets, strict=True)]
    world = posed_points(body, pose[None], fixed)[0]
    seen = np.full((len(problem.scene.rig), len(COCO), 3), np.nan)
    for view, camera in zip(seen, problem.scene.rig, strict=True):
        pixels, _ = camera.project(world)
        view[points.columns, :2] = pixels + random.normal(scale=_ERROR, size=pixels.shape)
        view[points.columns, 2] = 1.0
    return seen
