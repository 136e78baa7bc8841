"""Of two people each gets masks of their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from helpers import footage, scenes

from cl import NumpyDevice
from psfs.background.config import UNKNOWN, EvidenceConfig
from psfs.cameras.camera import CameraRig
from psfs.cameras.footprints import voxel_footprints
from psfs.people.contact import SplitCloud, find_contacts, split_cloud
from psfs.people.people import People, Person
from psfs.people.separation import FAR, MARGIN, Attribution, MaskStore, draw, separate
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings
from psfs.volume import find_volume
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid

SIZE = 0.05
GRID = VoxelGrid.covering(np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, 1.8]), SIZE)


def block(x: float) -> np.ndarray:
    """Flat indices of the voxels of somebody at x, y = 0."""
    beside = np.abs(GRID.centres()[:, :2] - [x, 0]).max(1) < 0.15
    return np.flatnonzero(beside & (GRID.centres()[:, 2] < 1.5))


def rig() -> CameraRig:
    """A camera that sees both side by side, and one that sees them behind one another."""
    target, size = np.array([0.0, 0.0, 0.8]), (120, 120)
    aside = scenes.looking_at("aside", np.array([0.0, -4.0, 0.8]), target, size, 140)
    before = scenes.looking_at("before", np.array([4.0, 0.0, 0.8]), target, size, 140)
    return scenes.without_distortion(CameraRig((aside, before)))


def test_voxels_belong_to_the_nearest_and_far_ones_to_nobody() -> None:
    left, right, far = block(-0.5), block(0.5), np.array([GRID.size - 1])
    voxels = np.sort(np.concatenate([left, right, far]))
    cloud = VoxelCloud(GRID, voxels.astype(np.int32), np.ones(len(voxels), np.float32))
    both = (Person(np.array([7]), {7: left}), Person(np.array([7]), {7: right}))
    split = split_cloud(cloud, People(range(8), GRID, both), 7)
    clouds = split.clouds
    assert split.sole is clouds and not any(map(len, split.near))  # they do not touch
    assert [len(points) for points in clouds] == [len(left), len(right), 1]
    assert clouds[0][:, 0].max() < 0 < clouds[1][:, 0].min()


def test_pixels_of_the_other_are_background_or_unknown() -> None:
    cameras, config = rig(), ReconstructionConfig()
    footprints = voxel_footprints(cameras, SIZE)
    clouds = [GRID.centres(block(x)) for x in (-0.5, 0.5)]  # the second is nearer to `before`
    evidence = np.full((2, 120, 120), -60, np.int8)
    covered = []
    for view, camera in enumerate(cameras):
        depths = [draw(camera, points, footprints[view], (120, 120))[0] for points in clouds]
        covered.append(np.array(depths) < FAR)
        evidence[view][covered[-1].any(0)] = 12
    attribute = Attribution(cameras, config)
    empty = clouds[0][:0]
    first, second = attribute(evidence, SplitCloud(clouds, clouds, [empty, empty]), footprints)
    table = config.silhouette.evidence.replace(unknown_mask=128)
    counts = [table.mask_counts(masks) for masks in (first, second)]
    own, other = covered[0]
    assert (counts[0][0][own & ~other] > 8).all()
    assert (counts[0][0][other & ~own] < -90).all()
    assert (counts[1][0][other & ~own] > 8).all()
    behind, before = covered[1]
    assert (counts[1][1][before] > 8).all()
    hidden = behind & before
    assert hidden.sum() > 500
    assert (counts[0][1][hidden] == UNKNOWN).all()
    assert (counts[0][1][behind & ~before] != UNKNOWN).all()


def test_arms_of_people_who_touch_are_foreground_of_both() -> None:
    """Both reach out and touch in the middle; the first one's trunk says nothing to the second."""
    cameras, centres = rig(), GRID.centres()
    arms = (np.abs(centres[:, 1]) < 0.06) & (np.abs(centres[:, 2] - 1.1) < 0.06)
    left, right = (np.abs(centres[:, 0] - x) < 0.3 for x in (-0.3, 0.3))
    first = np.union1d(block(-0.4), np.flatnonzero(arms & left))
    second = np.union1d(block(0.4), np.flatnonzero(arms & right & ~left))
    voxels = np.union1d(first, second)
    cloud = VoxelCloud(GRID, voxels.astype(np.int32), np.ones(len(voxels), np.float32))
    both = (Person(np.array([7]), {7: first}), Person(np.array([7]), {7: second}))
    people = People(range(8), GRID, both)
    assert not any(find_contacts(people, 10).values())  # a frame of two is too short
    split = split_cloud(cloud, people, 7, find_contacts(people, 5)[7])
    assert split.clouds[0][:, 0].max() > 0.05 and split.clouds[1][:, 0].min() < -0.05
    assert split.sole[0][:, 0].max() < 0 < split.sole[1][:, 0].min()
    assert all(len(near) and near[:, 2].min() > 0.6 for near in split.near)
    footprints, camera = voxel_footprints(cameras, SIZE), cameras[0]
    evidence = np.full((2, 120, 120), -60, np.int8)
    evidence[0][draw(camera, cloud.centres, footprints[0], (120, 120))[0] < FAR] = 12
    masks = Attribution(cameras, ReconstructionConfig())(evidence, split, footprints)[:, 0]
    pixels, _ = camera.project(np.array([[-0.05, 0, 1.1], [0.05, 0, 1.1], [-0.25, 0, 1.1]]))
    column, row = pixels.round().astype(int).T
    assert (masks[:, row[:2], column[:2]] > 200).all()
    assert masks[0, row[2], column[2]] > 200 and masks[1, row[2], column[2]] == 128


def test_masks_say_nothing_at_one_value_only_if_it_is_stated() -> None:
    masks = np.arange(256)
    plain = EvidenceConfig().mask_counts(masks)
    stated = EvidenceConfig(unknown_mask=128).mask_counts(masks)
    assert (plain != UNKNOWN).all()
    assert np.flatnonzero(stated != plain).tolist() == [128]
    assert stated[128] == UNKNOWN


def test_stored_masks_come_back() -> None:
    store = MaskStore(2, 5, 7)
    masks = np.random.default_rng(1).integers(0, 256, (2, 5, 7)).astype(np.uint8)
    store.add(0, 3, masks)
    store.add(1, 3, masks[::-1].copy())
    assert (store.get(0, 3) == masks).all()
    assert (store.get(1, 3) == masks[::-1]).all()
    assert not store.get(0, 4).any()


def test_sessions_of_frames_from_the_last_to_the_first(tmp_path: Path) -> None:
    """The footage shows nobody: without surface voxels the coarse ones are what is known."""
    sequence = Sequence.open(footage.native(tmp_path / "s", frames=4))
    settings = SessionSettings(selection=slice(None, None, -1), voxel_size=0.2)
    session = Session(sequence, NumpyDevice(), settings)
    persons = [
        Person(np.array(seen), {index: block(x) for index in seen})
        for x, seen in ((-0.5, [0, 1, 2]), (0.5, [1, 3]))
    ]
    people = People(session.frames, GRID, tuple(persons))
    assert people.counts.tolist() == [1, 1, 2, 1]
    nobody = People(session.frames, GRID, ())
    assert nobody.counts.tolist() == [0, 0, 0, 0]
    for own, person in zip(separate(session, people), persons, strict=True):
        first, last = person.frames[[0, -1]]
        assert list(own.frames) == list(range(last, first - 1, -1))
        low, high = People(session.frames, GRID, (person,)).box(MARGIN)
        box = find_volume(own)
        np.testing.assert_allclose([box.low, box.high], [low, high])
    space = own.sequence.read(2).space
    assert space is not None
    trunks = np.array([[0.5, 0.05, 1.0], [-0.5, 0.05, 1.0]])  # of the person, and of the other
    assert space(trunks).tolist() == [True, False]


def test_space_of_others_who_stand_is_no_persons_unless_they_touch(tmp_path: Path) -> None:
    """They stand apart in the first frame and touch in the others."""
    sequence = Sequence.open(footage.native(tmp_path / "s", frames=8))
    session = Session(sequence, NumpyDevice(), SessionSettings(voxel_size=0.2))
    near = np.abs(GRID.centres() - [0, 0, 1.1]) < [0.25, 0.06, 0.06]
    arms = np.flatnonzero(near.all(1))
    left, right = Person(np.arange(8), {}), Person(np.arange(8), {})
    for person, x in ((left, -0.4), (right, 0.4)):
        touching = np.union1d(block(x), arms)
        person.voxels.update({0: block(x)} | dict.fromkeys(range(1, 8), touching))
    trunks = np.array([[-0.4, 0.05, 1.0], [0.4, 0.05, 1.0]])
    people = People(session.frames, GRID, (left, right))
    for number, own in enumerate(separate(session, people)):
        space = own.sequence.read(0).space
        assert space is not None
        assert space(trunks).tolist() == [number == 0, number == 1]
        assert own.sequence.read(1).space is None
    (alone,) = separate(session, People(session.frames, GRID, (left,), objects=1))
    assert alone.sequence.read(0).space is None
