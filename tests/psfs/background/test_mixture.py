"""Silhouettes by a mixture of Gaussians."""

from pathlib import Path

import numpy as np
import pytest
from helpers import footage

from psfs.background.mixture import Mixture
from psfs.sequence import Sequence


def test_what_differs_from_the_plate_is_the_person(tmp_path: Path) -> None:
    folder = footage.native(tmp_path)
    footage.write_video(folder / "videos/cam02.mp4", [101] * 12)  # as its plate
    sequence = Sequence.open(folder, background="mog")
    frame = sequence.read(0)
    assert sequence.background is None and frame.masks is not None
    assert (frame.masks[0] == 255).all() and not frame.masks[1].any()


def test_an_adaptive_mixture_forgets_who_stands_still(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = footage.native(tmp_path)
    sequence = Sequence.open(folder, background="mog-adaptive")
    kept = Sequence.open(folder, background="mog")
    person = sequence.read(0).images
    assert person is not None
    monkeypatch.setattr("psfs.background.mixture._RATE", 0.02)
    mixture = Mixture(sequence.footage.background, True, adaptive=True)
    seen = [mixture(0, person[0]).mean() for _ in range(30)]
    assert seen[0] == 255 and seen[-1] == 0  # what stays is scene (Rymut 2016, 2.1)
    for one, other in zip(sequence.frames(), sequence.frames(), strict=True):
        np.testing.assert_array_equal(one.masks, other.masks)  # each reader begins anew
    np.testing.assert_array_equal(sequence.read(5).masks, kept.read(5).masks)
    with sequence.reader(learning=False) as read:
        for index in range(6):
            np.testing.assert_array_equal(read(index).masks, kept.read(index).masks)


def test_a_plain_mixture_takes_shadows_for_the_person(tmp_path: Path) -> None:
    folder = footage.native(tmp_path)
    footage.write_video(folder / "videos/cam01.mp4", [75] * 12)  # three quarters of its plate's 100
    as_shadow, as_person = (
        Sequence.open(folder, background=kind).read(0).masks[0]  # type: ignore[index]
        for kind in ("mog-adaptive", "mog-plain")
    )
    assert not as_shadow.any() and (as_person == 255).all()
