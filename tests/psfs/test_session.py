"""A session computes once what several stages need, and each stage gets what a new one would."""

from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

import psfs.session
from cl import Device, InputError, NumpyDevice
from psfs.backend import make_evidence_function, make_reconstructor
from psfs.background.gaussian import Background
from psfs.sequence import Sequence
from psfs.session import CarvedFrame, Session, SessionSettings
from psfs.silhouettes.hidden import UNKNOWN
from psfs.volume import Volume, automatic_grid, find_volume
from psfs.voxels.grid import VoxelGrid


@pytest.fixture
def session(small_walk: Path, device: Device) -> Session:
    """The small walk before its background: silhouettes learn, the background drifts."""
    return Session(Sequence.open(small_walk), device, SessionSettings(voxel_size=0.05))


def carved_anew(session: Session, grid: VoxelGrid, indices: range) -> list[CarvedFrame]:
    """The frames by a reconstructor that nobody else has used."""
    reconstruct = make_reconstructor(session.device, session.rig, grid, session.sequence.background)
    found = []
    for frame in session.sequence.select_frames(indices):
        voxels = reconstruct(frame)
        evidence, cloud = reconstruct.evidence(), voxels.cloud(True)
        found.append(CarvedFrame(frame.index, evidence > 0, evidence != UNKNOWN, cloud))
    return found


def carve(session: Session, grid: VoxelGrid, wanted: Iterable[int]) -> None:
    """Carve all frames, as a stage after which some are wanted again."""
    session.keep_carved(wanted)
    reconstruct = session.reconstructor(grid)
    for frame in session.sequence:
        session.record_carved(frame.index, reconstruct(frame))


def with_furniture(session: Session, rows: int) -> Session:
    """Return a session whose first camera does not see so many upper rows."""
    hidden = np.zeros((len(session.rig), session.rig.height, session.rig.width), bool)
    hidden[0, :rows] = True
    return session.with_sequence(session.sequence.with_rig(session.rig.with_hidden(hidden)))


def assert_same(found: list[CarvedFrame], expected: list[CarvedFrame]) -> None:
    np.testing.assert_equal([*map(asdict, found)], [*map(asdict, expected)])


def test_each_stage_gets_a_reconstructor_that_has_seen_no_frame(session: Session) -> None:
    grid = automatic_grid(session)
    first = session.reconstructor(grid)
    for frame in session.sequence:
        first(frame)
    moved = VoxelGrid(grid.origin + 0.02, grid.voxel_size, grid.shape)
    for other in (moved, grid):
        found = list(session.iterate_carved(other, range(3)))
        assert session.reconstructor(other) is first  # the device's memory is used again
        assert_same(found, carved_anew(session, other, range(3)))


def test_frames_carved_by_one_stage_are_kept_for_the_next(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid, wanted = automatic_grid(session), [0, 2, 3]
    carve(session, grid, wanted)
    every = carved_anew(session, grid, range(4))
    with monkeypatch.context() as patch:
        patch.setattr(Session, "reconstructor", None)  # nothing is reconstructed
        assert_same(list(session.iterate_carved(grid, wanted)), [every[index] for index in wanted])
    assert [one.index for one in session.iterate_carved(grid, [0, 1])] == [0, 1]  # 1 was not kept
    elsewhere = VoxelGrid(grid.origin + 0.1, grid.voxel_size, grid.shape)
    (one,) = session.iterate_carved(elsewhere, [0])
    assert one.cloud.grid.equals(elsewhere)


def test_kept_frames_take_a_bounded_memory(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(psfs.session, "KEPT_BYTES", 1)
    grid = automatic_grid(session)
    carve(session, grid, range(4))
    assert_same(list(session.iterate_carved(grid, range(2))), carved_anew(session, grid, range(2)))


def test_what_is_hidden_is_known_of_kept_frames(session: Session) -> None:
    session = with_furniture(session, session.rig.height // 2)
    grid = automatic_grid(session)
    carve(session, grid, range(2))
    kept = list(session.iterate_carved(grid, range(2)))
    assert_same(kept, carved_anew(session, grid, range(2)))
    assert not kept[0].known[0].all() and kept[0].known[1].all()


def test_a_corrected_rig_has_the_frames_that_were_kept(session: Session) -> None:
    session.sequence.keep_frames()
    expected = [frame.images for frame in session.sequence]
    other = with_furniture(session, 0)
    assert other is not session
    assert all(map(np.array_equal, (frame.images for frame in other.sequence), expected))


def test_evidence_is_computed_once(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    evidence_of = make_evidence_function(
        session.device, session.rig, session.background, session.reconstruction.silhouette
    )
    expected = [evidence_of(session.sequence.read(index)) for index in (3, 0, 3)]
    assert all(map(np.array_equal, session.evidence([3, 0, 3]), expected))
    with monkeypatch.context() as patch:
        patch.setattr(Sequence, "reader", None)  # nothing is read
        assert all(map(np.array_equal, session.evidence([0, 3]), expected[1:]))
    monkeypatch.setattr(psfs.session, "KEPT_BYTES", 1)
    assert all(map(np.array_equal, session.evidence([1, 3, 0, 3])[1:], expected))


def test_a_stage_can_revise_the_background(session: Session) -> None:
    (before,) = session.evidence([0])
    frame = session.sequence.read(0)
    assert frame.images is not None and session.background is not None
    shown = Background(frame.images.astype(np.float32), session.background.std)
    session.revise_background(shown)
    (after,) = session.evidence([0])
    assert (before > 0).any() and not (after > 0).any()


def test_results_are_kept_and_can_be_replaced(small_walk: Path) -> None:
    session = Session(Sequence.open(small_walk), NumpyDevice())
    stated = Volume(np.zeros(3), np.array([1.0, 2.0, 3.0]))
    session.replace_result(find_volume, stated)
    grid = automatic_grid(session)
    np.testing.assert_allclose(grid.high, stated.high)
    assert automatic_grid(session) is grid
    other = session.with_sequence(session.sequence.with_cameras(session.rig.names[:2]))
    assert len(other.rig) == 2 and other.settings is session.settings
    assert session.with_sequence(session.sequence) is session


def test_no_selected_frame(small_walk: Path) -> None:
    settings = replace(SessionSettings(), selection=slice(90, None))
    with pytest.raises(InputError, match="selected frames are none of 4"):
        find_volume(Session(Sequence.open(small_walk), NumpyDevice(), settings))
