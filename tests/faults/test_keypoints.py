"""Keypoints of every format that are damaged, lie, or belong to something else: one line each."""

import json
import os
import pickle
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import faults, footage
from helpers.commands import run
from helpers.faults import WRONG, refused

from apf.keypoints.readers.orders import COCO_17

FRAMES = 4
#: Of `WRONG`, the kinds that JSON has and readers tell apart.
KINDS = ("text", "a number as text", "NaN", "infinity", "a table", "an empty list")
#: Files of a stock of keypoints, by format.
FILES = {"npz": "k.npz", "npy": "k.npy", "json": "json", "csv": "csv", "pkl": "pkl/*"}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A walk of three cameras and its keypoints in every format."""
    folder = footage.native(tmp_path_factory.mktemp("keypoints") / "stock" / "walk", frames=FRAMES)
    faults.stock_keypoints(folder.parent, FRAMES)
    return folder.parent


@pytest.fixture
def keypoints(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "stock"))


def words(stock: Path, kind: str) -> list[str]:
    return ["apf", "track", str(stock / "walk"), "-o", str(stock / "new"), "--method",
            "triangulate", "--no-overlay", "--keypoints", str(stock / FILES[kind])]  # fmt: skip


@pytest.mark.parametrize("kind", FILES)
def test_whole_ones_are_read(keypoints: Path, kind: str) -> None:
    given = words(keypoints, kind)
    done = run(*given[:4], keypoints.parent / kind, *given[5:])
    assert done.code == 0 and "17 points of 3.0 cameras" in done.out, done


def test_json_with_a_wrong_value_anywhere(keypoints: Path) -> None:
    path = keypoints / "json/cam02_json/cam02_000001.json"
    good = json.loads(path.read_text())
    for at in faults.leaves(good):
        if at[:1] in [("version",)] or at[2:3] == ("person_id",):
            continue  # which nobody looks at
        for kind, value in WRONG.items():
            if kind not in KINDS:
                continue
            if kind == "an empty list" and at in [("people",), (*at[:2], "pose_keypoints_2d")]:
                continue  # nobody is there
            if kind == "NaN" and at[3:]:
                continue  # not found
            text = json.dumps(faults.replaced(good, at, value))
            if at == () and '"people"' not in text:
                text = text.replace("[", '[{"people": []}, ', 1)
            path.write_text(text)
            if at[3:] and kind == "infinity":
                refused(words(keypoints, "json"), keypoints, "camera cam02")
            elif not (at[3:] and kind == "a number as text"):  # which counts as a number
                refused(words(keypoints, "json"), keypoints, str(path))


class Evil:
    """Whose pickle runs something."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, ("touch /tmp/pickle_was_run",)


PICKLES: dict[str, bytes] = {
    "nothing": b"",
    "text": b"hello",
    "half": pickle.dumps([[{"pose_keypoints_2d": [1.0] * 51}]] * 9)[:40],
    "code": pickle.dumps([Evil()]),
    "an array": pickle.dumps([[{"pose_keypoints_2d": np.ones(51)}]] * FRAMES),
    "a table": pickle.dumps({"frames": []}),
    "texts": pickle.dumps(["a", "b", "c", "d"]),
    "persons are texts": pickle.dumps([["a"]] * FRAMES),
    "too few frames": pickle.dumps([[{"pose_keypoints_2d": [1.0] * 51}]] * 2),
    "no frames": pickle.dumps([]),
    "ragged": pickle.dumps([[{"pose_keypoints_2d": [1.0] * 50}]] * FRAMES),
    "a claimed length": b"\x80\x05\x8e" + b"\xff" * 8,
}


@pytest.mark.parametrize("fault", PICKLES)
def test_pickles(keypoints: Path, fault: str) -> None:
    (keypoints / "pkl/cam02/x_rotated_pp.pkl").write_bytes(PICKLES[fault])
    refused(words(keypoints, "pkl"), keypoints, "pkl")
    assert not Path("/tmp/pickle_was_run").exists()


def test_arrays_that_are_no_keypoints(keypoints: Path) -> None:
    good = np.load(keypoints / "k.npy").astype(float)
    wrong = {
        "flat": good.ravel(),
        "complex": good + 1j,
        "frames": good[:, :2],
        "no cameras": good[:0],
        "infinite": np.where(good > 10, np.inf, good),
        "nothing found": np.full_like(good, np.nan),
    }
    names = {
        "keypoint_names": np.array(COCO_17),
        "camera_names": np.array(["cam01", "cam02", "cam03"]),
    }
    for fault, array in wrong.items():
        np.save(keypoints / "bad.npy", array)
        np.savez(keypoints / "bad.npz", keypoints=array, **names)
        for ending in ("npy", "npz"):
            given = [*words(keypoints, "npy")[:-1], str(keypoints / f"bad.{ending}")]
            said = "walk" if fault == "nothing found" else f"bad.{ending}"
            refused(given, keypoints, said)
