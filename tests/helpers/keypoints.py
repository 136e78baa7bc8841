"""Keypoints of a known body, as a network without errors would detect them."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from apf.body.model import BodyModel
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import locate_points
from apf.keypoints.readers.orders import MEDIAPIPE
from psfs.cameras.camera import CameraRig


def of_poses(
    rig: CameraRig,
    body: BodyModel,
    poses: np.ndarray,
    names: tuple[str, ...] = MEDIAPIPE,
    noise: float = 0.0,
    seed: int = 0,
) -> Keypoints:
    """Keypoints of `body` in poses (F, D), at their prior places, `noise` px from where they are
    seen; those that the body has no point for are missing."""
    random = np.random.default_rng(seed)
    places = world_points(body, poses, names)
    points = np.full((len(rig), len(poses), len(names), 3), np.nan)
    for view, camera in enumerate(rig):
        pixels, depth = camera.project(places)
        seen = (depth > 0) & np.isfinite(places).all(-1)
        pixels += random.normal(0, noise, pixels.shape)
        score = random.uniform(0.5, 1, seen.shape)
        points[view][seen] = np.column_stack([pixels[seen], score[seen]])
    return Keypoints(points, names, tuple(rig.names))


def world_points(body: BodyModel, poses: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Return the keypoints' positions (F, K, 3) m; NaN for those that the body lacks."""
    on = locate_points(body, names)
    places = np.full((len(poses), len(names), 3), np.nan)
    places[:, on.columns] = on.place(body, poses)
    return places


def list_person(points: np.ndarray) -> dict[str, Any]:
    """Return keypoints (K, 3) as OpenPose lists them, with zeros for missing ones."""
    values = np.nan_to_num(points.astype(float))
    return {"person_id": [-1], "pose_keypoints_2d": values.ravel().tolist()}


def pose2sim_path(camera: str, frame: int) -> str:
    return f"{camera}_json/{camera}_{frame:06d}.json"


def write_openpose(
    folder: Path, *people: Keypoints, path_of: Callable[[str, int], str] = pose2sim_path
) -> Path:
    """Write the JSON files of several persons."""
    for view, camera in enumerate(people[0].camera_names):
        for frame in range(people[0].n_frames):
            path = folder / path_of(camera, frame)
            path.parent.mkdir(parents=True, exist_ok=True)
            found = [list_person(one.points[view, frame]) for one in people]
            path.write_text(json.dumps({"version": 1.3, "people": found}))
    return folder


def write_deeplabcut(folder: Path, written: Keypoints, individuals: bool = False) -> list[Path]:
    """Write a table of each camera; return their paths."""
    folder.mkdir(exist_ok=True)
    parts = [name for name in written.names for _ in range(3)]
    head = [["scorer", *["DLC_net"] * len(parts)]]
    head += [["individuals", *["one"] * len(parts)]] if individuals else []
    head += [["bodyparts", *parts], ["coords", *["x", "y", "likelihood"] * len(written.names)]]
    paths = []
    for camera, points in zip(written.camera_names, written.points, strict=True):
        paths.append(folder / f"{camera}DLC_resnet50_walkJan1shuffle1_100000.csv")
        rows = points.reshape(len(points), -1).astype(float)
        cells = [["" if np.isnan(value) else value for value in row.tolist()] for row in rows]
        with paths[-1].open("w", newline="") as file:
            csv.writer(file).writerows([*head, *([k, *row] for k, row in enumerate(cells))])
    return paths
