"""Furniture is found where one camera denies what the others see, and nowhere else."""

import numpy as np
from helpers import scenes

from psfs.cameras.camera import CameraRig
from psfs.diagnostics.occluders import find_hidden_in_box

RIG = scenes.ring(6, (240, 180))
LOW, HIGH = np.array([-0.9, -0.9, 0.0]), np.array([0.9, 0.9, 1.8])
LIMITS = 50_000, 1  # voxels, and a margin, px
#: Counts of evidence, Song et al. eq. (5)-(9): a camera denies more than seven confirm.
CONFIRMS, DENIES = 19, -127


def walking(rig: CameraRig, n: int = 7) -> list[np.ndarray]:
    """Evidence maps (V, H, W) of the test body on its way."""
    shifts = np.linspace(-0.3, 0.3, n)[:, None] * [1, 0.5, 0]
    shown = [scenes.masks_of(rig, shift) > 0 for shift in shifts]
    return [np.where(masks, CONFIRMS, DENIES).astype(np.int8) for masks in shown]


def behind(frames: list[np.ndarray], table: np.ndarray, view: int) -> list[np.ndarray]:
    """The same, what is behind a table (H, W) bool being denied by one camera."""
    spoilt = [maps.copy() for maps in frames]
    for maps in spoilt:
        maps[view, table] = DENIES
    return spoilt


def some_table(frames: list[np.ndarray], view: int) -> np.ndarray:
    """(H, W) bool before the lower part of the body."""
    rows, _ = np.nonzero(np.any([maps[view] > 0 for maps in frames], 0))
    table = np.zeros((RIG.height, RIG.width), bool)
    table[int(np.quantile(rows, 0.6)) : int(np.quantile(rows, 0.85))] = True
    return table


def test_a_table_is_found_in_the_camera_that_it_stands_before() -> None:
    frames = walking(RIG)
    table = some_table(frames, 1)
    hidden = find_hidden_in_box(RIG, behind(frames, table, 1), LOW, HIGH, *LIMITS)
    assert hidden is not None
    assert hidden[1].sum() > 3 * hidden[[0, 2, 3, 4, 5]].sum((1, 2)).max()  # beside the body
    crossed = table & (np.sum([maps[1] > 0 for maps in frames], 0) >= 3)
    assert (hidden[1] & crossed).sum() > 0.7 * crossed.sum()
    beside = hidden[1] & ~table
    assert beside.sum() < 0.2 * hidden[1].sum()


def test_furniture_before_all_but_the_head_hides_nothing_from_the_others() -> None:
    frames = walking(RIG)
    rows = np.flatnonzero(np.any([maps[1] > 0 for maps in frames], (0, 2)))
    boxes = np.zeros((RIG.height, RIG.width), bool)
    boxes[rows[len(rows) // 10] :] = True
    hidden = find_hidden_in_box(RIG, behind(frames, boxes, 1), LOW, HIGH, *LIMITS)
    assert hidden is not None and not hidden[[0, 2, 3, 4, 5]].any()
    often = boxes & (np.mean([maps[1] > 0 for maps in frames], 0) > 0.5)
    assert (hidden[1] & often).sum() > 0.9 * often.sum()


def test_clean_footage_has_none() -> None:
    assert find_hidden_in_box(RIG, walking(RIG), LOW, HIGH, *LIMITS) is None


def test_a_limb_that_is_lost_once_is_no_furniture() -> None:
    frames = walking(RIG)
    spoilt = frames.copy()
    spoilt[3] = behind(frames[3:4], some_table(frames, 1), 1)[0]
    assert find_hidden_in_box(RIG, spoilt, LOW, HIGH, *LIMITS) is None


def test_a_camera_that_shows_nobody_is_not_hidden_behind_furniture() -> None:
    frames = walking(RIG)
    everything = np.ones((RIG.height, RIG.width), bool)
    assert find_hidden_in_box(RIG, behind(frames, everything, 1), LOW, HIGH, *LIMITS) is None
