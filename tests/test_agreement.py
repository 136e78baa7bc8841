"""Cameras that disagree with the others are named, with the likely reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import shared_data

from psfs.agreement import suspects
from psfs.sequence import Frame, Sequence


class Spoilt:
    """A sequence one of whose cameras shows something else."""

    def __init__(self, sequence: Sequence, kind: str, view: int = 2) -> None:
        self._sequence, self._kind, self._view = sequence, kind, view

    def __getattr__(self, name: str):
        return getattr(self._sequence, name)

    def __len__(self) -> int:
        return len(self._sequence)

    def read(self, index: int) -> Frame:
        frame = self._sequence.read(index)
        assert frame.images is not None
        images, view = frame.images.copy(), self._view
        if self._kind == "noise":
            images[view] = np.random.default_rng(index).integers(0, 256, images[view].shape)
        elif self._kind == "black":
            images[view] = 0
        elif self._kind == "late":
            before = self._sequence.read(max(0, index - 10)).images
            assert before is not None
            images[view] = before[view]
        return replace(frame, images=images)


@pytest.fixture(scope="module")
def walk() -> Sequence:
    return Sequence.open(shared_data("synth_walk_8cam"))


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("noise", "looks like foreground"),
        ("black", "one colour, 0 grey"),
        ("late", "about 10 frames late"),
    ],
)
def test_a_spoilt_camera_is_named(walk: Sequence, device, kind: str, reason: str) -> None:
    (suspect,) = suspects(Spoilt(walk, kind), device=device)
    assert suspect.camera == "cam03" and reason in suspect.reason
    assert suspect.iou < 0.5 < suspect.others and "cam03" in str(suspect)


@pytest.mark.parametrize("name", ["synth_walk_8cam", "utrecht_seated"])
def test_good_cameras_are_not_named(device, name: str) -> None:
    assert suspects(Sequence.open(shared_data(name)), device=device) == []
