"""The library called with something else than it takes: what was found and what was expected."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import apf
import psfs

#: What is called with an open sequence, and what the error says.
FAULTS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "a path to open": (lambda s: psfs.open_sequence(None), "folder is None, of type NoneType"),
    "a list to open": (lambda s: psfs.open_sequence([s.folder]), "of type list; expected str"),
    "a path as a sequence": (lambda s: psfs.reconstruct("walk/"), "psfs.open_sequence(folder)"),
    "a path to track": (lambda s: apf.track("walk/"), "psfs.open_sequence(folder)"),
    "a number as frames": (lambda s: psfs.reconstruct(s, frames=3), "expected slice"),
    "a pair as frames": (lambda s: apf.track(s, frames=(0, 3)), "expected slice"),
    "frames backwards": (lambda s: apf.track(s, frames=slice(3, 0, -1)), "step of frames is -1"),
    "a number as a device": (lambda s: psfs.reconstruct(s, device=0), "device is 0, of type int"),
    "a flat volume": (lambda s: psfs.reconstruct(s, volume=[[0, 0], [1, 1]]), "volume = [[0, 0]"),
    "debris of 2": (lambda s: psfs.reconstruct(s, debris=2), "debris is 2"),
    "a text as a size": (lambda s: psfs.reconstruct(s, voxel_size="0.05"), "voxel_size, m, is"),
    "a table as a config": (lambda s: psfs.reconstruct(s, config={}), "ReconstructionConfig"),
    "a name as a method": (lambda s: apf.track(s, method="pso"), "apf.Method.create()"),
    "a table as a search": (lambda s: apf.Method.from_dict({"search": {}}), "search is {}"),
    "a list as a pose": (lambda s: apf.track(s, init=[0.0] * 31), "of type list; expected ndarray"),
    "centimetres": (lambda s: apf.track(s, height=178), "height, m, is 178"),
    "an array as keypoints": (lambda s: apf.track(s, keypoints=np.zeros(3)), "expected Keypoints"),
    "a key of another background": (lambda s: psfs.open_sequence(s.folder, key="#00ff00"), "`key`"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_arguments(original: Path, fault: str) -> None:
    call, said = FAULTS[fault]
    sequence = psfs.open_sequence(original / "seq")
    with pytest.raises(psfs.InputError) as error:
        call(sequence)
    assert said in str(error.value) and "\n" not in str(error.value)
