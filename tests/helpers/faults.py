"""Run commands with invalid input and check their errors; small data to corrupt."""

import io
import os
import pickle
import stat
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from apf.body.toml import load_body, save_body
from apf.formats.pose import write_pose
from apf.formats.trc import write_trc
from apf.keypoints.readers.orders import COCO_17
from apf.tracking.settings import DEFAULT_BODY
from helpers import footage, scenes, tracks
from helpers.commands import run, succeed
from helpers.keypoints import list_person, of_poses, write_deeplabcut, write_openpose

#: Flags of a coarse reconstruction of the masks.
BOX = ["--voxel-size=0.08", "--volume=-0.6,0.6,-0.6,0.6,0,1.9", "--all-cameras"]
#: What may stand in a file of tables for something else.
WRONG: dict[str, Any] = {
    "text": "many",
    "empty text": "",
    "a number as text": "1.5",
    "NaN": float("nan"),
    "infinity": float("inf"),
    "1e300": 1e300,
    "401 digits": 10**400,
    "true": True,
    "a table": {"a": 1.0},
    "an empty list": [],
    "a list of texts": ["a", "b", "c"],
    "a long list": [1.0] * 1000,
    "a date": date(2026, 1, 1),
    "nested lists": [[[[[[[[1.0]]]]]]]],
}


def state(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Return what changes if a file below a folder is written or replaced, by its path: reading all
    of them took a tenth of these tests' time."""
    found = {}
    for own, _, names in os.walk(folder):
        for name in names:
            facts = os.lstat(f"{own}/{name}")
            if stat.S_ISREG(facts.st_mode):
                found[f"{own}/{name}"] = facts.st_ino, facts.st_size, facts.st_mtime_ns
    return found


def refused(words: list[str], folder: Path, *said: str) -> None:
    """Assert that the command ends with exit code 2 and one clear line, in which `said` occur, and
    leaves the files in `folder` as they were."""
    before = state(folder)
    outcome = run(*words)
    line = outcome.err.strip()
    assert outcome.code == 2, (outcome.code, line)
    assert ": error: " in line, line
    assert "Traceback" not in line and "please report" not in line, line
    assert len(line) < 2000 and line.isprintable(), line
    for words_said in said:
        assert words_said in line, (words_said, line)
    assert state(folder) == before


def masks_folder(folder: Path, frames: int = 3) -> Path:
    """Write a sequence of a standing body as masks of five cameras; the first frame is empty."""
    rig = scenes.ring(5, size=(160, 120))
    masks = [[mask * np.uint8(k > 0) for k in range(frames)] for mask in scenes.masks_of(rig)]
    return footage.write_take(folder, rig, masks)


def stock(folder: Path) -> Path:
    """Write all that commands read, small: walk/ (videos), seq/ (masks), out/ (of seq), track/,
    truth files."""
    footage.native(folder / "walk", frames=20)
    masks_folder(folder / "seq")
    succeed("psfs", "reconstruct", folder / "seq", "-o", folder / "out", *BOX[:2])
    track = tracks.walker(6, body_name=DEFAULT_BODY)
    track.save(folder / "track/track.npz")
    assert track.body is not None
    save_body(folder / "track/body.toml", track.body)
    write_pose(folder / "pose.txt", track.poses[0], track.body)
    truth = tracks.truth_of(track)
    write_trc(folder / "truth.trc", truth)
    np.savez(folder / "truth.npz", joint_names=np.array(truth.joint_names), joints=truth.joints,
             fps=truth.fps, frames=truth.frames)  # fmt: skip
    return folder


def stock_keypoints(stock: Path, frames: int = 4) -> None:
    """Write the keypoints of somebody before three cameras in every format."""
    rig, body = footage.rig(3), load_body("song31")
    found = of_poses(rig, body, np.tile(body.rest_pose, (frames, 1)), COCO_17)
    np.save(stock / "k.npy", found.points)
    np.savez(
        stock / "k.npz", keypoints=found.points, keypoint_names=COCO_17, camera_names=rig.names
    )
    write_openpose(stock / "json", found)
    write_deeplabcut(stock / "csv", found)
    for camera, view in zip(rig.names, found.points, strict=True):
        path = stock / "pkl" / camera / "x_rotated_pp.pkl"
        path.parent.mkdir(parents=True)
        path.write_bytes(pickle.dumps([[list_person(points)] for points in view]))


def npy(shape: tuple[int, ...], dtype: str = "<f8", data: bytes = b"") -> bytes:
    """Return an npy that claims a shape."""
    file = io.BytesIO()
    about = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, about)
    return file.getvalue() + data


def changed_npz(path: Path, **changes: Any) -> None:
    """Write an npz again with other arrays; None leaves one out."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    arrays |= changes
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


def leaves(document: Any, at: tuple = ()) -> Iterator[tuple]:
    """Yield the places of all values of nested tables and lists; of lists those of the first two
    entries."""
    yield at
    if isinstance(document, dict):
        for key, value in document.items():
            yield from leaves(value, (*at, key))
    elif isinstance(document, list):
        for index, value in enumerate(document[:2]):
            yield from leaves(value, (*at, index))


def replaced(document: Any, at: tuple, value: Any) -> Any:
    """Return the document with another value at a place."""
    if not at:
        return value
    copy = dict(document) if isinstance(document, dict) else list(document)
    copy[at[0]] = replaced(document[at[0]], at[1:], value)
    return copy
