"""What silhouettes learn from the frame before, on every OpenCL device against the NumPy twin."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from helpers import scenes
from helpers.shared import shared_data

from cl import Device, NumpyDevice
from psfs.cameras.rig_geometry import floor_points
from psfs.reconstructor import ReconstructionConfig, Reconstructor
from psfs.reference.appearance import NumpyForeground
from psfs.reference.reconstructor import NumpyReconstructor
from psfs.sequence import Sequence
from psfs.silhouettes.appearance import BINS
from psfs.silhouettes.config import AppearanceConfig, SilhouetteConfig
from psfs.voxels.grid import VoxelGrid


def scene():
    rig = scenes.ring(3, size=(201, 153))
    frame, background = scenes.pictures_of(rig)
    return rig, frame, background


def test_learning_agrees_with_the_twin(device: Device) -> None:
    rig, frame, background = scene()
    ours = Reconstructor(device, rig, scenes.small_grid(), background)
    twin = NumpyReconstructor(NumpyDevice(), rig, scenes.small_grid(), background)
    for index in (0, 1, 9):
        cloud = ours(replace(frame, index=index)).cloud()
        expected = twin(replace(frame, index=index)).cloud()
        common = np.intersect1d(cloud.indices, expected.indices)
        assert len(common) >= 0.98 * max(len(cloud), len(expected))
        learnt, learner = ours.silhouette.foreground, twin.foreground
        assert learnt is not None and learner is not None
        assert (learnt.prior.location.get() != learner.location).mean() < 0.02
        difference = np.abs(learnt.prior.colours.get().astype(int) - learner.colours)
        assert (difference > 2).mean() < 1e-3 and difference.max() < 20


@pytest.mark.parametrize(("look_again", "lessons"), [(True, [5, 6, 8]), (False, [5, 6, 7])])
def test_a_second_look(device: Device, monkeypatch, look_again: bool, lessons: list[int]) -> None:
    """The first frame always gets one, a frame far from the one before if wanted."""
    rig, frame, background = scene()
    config = ReconstructionConfig(
        silhouette=SilhouetteConfig(appearance=AppearanceConfig(look_again=look_again))
    )
    ours = Reconstructor(device, rig, scenes.small_grid(), background, config)
    learnt: list[object] = []
    monkeypatch.setattr(ours.silhouette.foreground, "learn", learnt.append)
    counts = []
    for index in (0, 1, 40):
        ours(replace(frame, index=index))
        counts.append(len(learnt))
    assert counts == lessons


def test_the_persons_colour_is_learnt_and_nobody_elses_and_where_the_person_stood() -> None:
    rig, frame, background = scene()
    twin = NumpyReconstructor(NumpyDevice(), rig, scenes.small_grid(), background)
    twin(frame)
    learner = twin.foreground
    assert learner is not None
    colours = learner.colours.reshape((BINS,) * 3)
    own = 128 * BINS // 256
    assert np.unravel_index(colours.argmax(), colours.shape) == (own, own, own)
    never_seen = SilhouetteConfig().evidence.ratio_steps * np.log(0.1)
    assert colours.min() >= np.floor(never_seen)
    likely = (learner.location > 0).repeat(4, 1).repeat(4, 2)[:, : rig.height, : rig.width]
    masks = frame.masks > 0
    assert (likely & masks).sum() > 0.95 * masks.sum()
    assert (likely & masks).sum() > 0.6 * likely.sum()
    learner.forget_location()
    assert not learner.location.any()


def test_a_picture_full_of_foreground_teaches_no_colours() -> None:
    rig, frame, _ = scene()
    learner = NumpyForeground(rig, SilhouetteConfig())
    grid = VoxelGrid(np.array([-2.0, -2.0, 0.0]), 0.1, (40, 40, 30))
    shape = (len(rig), rig.height, rig.width)
    learner.learn(frame.images, np.full(shape, 9, np.int8), grid, np.arange(grid.size))
    assert not learner.colours.any()


def test_the_floor_is_where_rays_meet_it() -> None:
    rig, _, _ = scene()
    points = floor_points(rig, 0.1)
    there = np.isfinite(points[..., 0])
    assert there.any() and not there.all()
    for view, camera in enumerate(rig):
        rows, columns = np.nonzero(there[view])
        where = np.column_stack([points[view, rows, columns], np.full(len(rows), 0.1)])
        pixels, depth = camera.project(where)
        assert (depth > 0).all()
        np.testing.assert_allclose(pixels, 4 * np.column_stack([columns, rows]) + 1.5, atol=1e-2)


def test_silhouettes_of_a_walk_match_the_truth(device: Device) -> None:
    """Measured with all frames: 0.930 (8 cameras), 0.921 (4)."""
    folder = shared_data("synth_walk_4cam")
    sequence = Sequence.open(folder)
    grid = VoxelGrid.covering(np.array([-2.5, -1.0, -0.05]), np.array([2.5, 1.2, 1.95]), 0.03)
    frames = list(sequence.frames(slice(39, 41)))
    scores = {}
    for learn in (False, True):
        config = ReconstructionConfig(
            silhouette=SilhouetteConfig(appearance=AppearanceConfig(learn=learn))
        )
        ours = Reconstructor(device, sequence.rig, grid, sequence.background, config)
        for frame in frames:
            ours(frame)
        shown = ours.silhouette.evidence.get() > 0
        truth = [
            cv2.imread(str(folder / f"truth_masks/{name}_000040.png"), cv2.IMREAD_GRAYSCALE)
            for name in sequence.rig.names
        ]
        person = np.stack(truth) > 0
        union = (shown | person).sum(axis=(1, 2))
        scores[learn] = ((shown & person).sum(axis=(1, 2)) / union).mean()
    assert scores[True] > 0.92 and scores[True] > scores[False] + 0.01
