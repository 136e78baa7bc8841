"""What a page may open: folders inside of those given, by their kinds."""

from pathlib import Path

import pytest
from helpers.studio import save_track, save_voxels

from apf.studio.folders import Roots, find_kind
from cl import InputError, MissingFileError


def test_folders_are_found_by_their_kind(tmp_path: Path) -> None:
    save_track(tmp_path / "a" / "track")
    save_voxels(tmp_path / "voxels")
    take = tmp_path / "take"
    take.mkdir()
    for folder in (take, tmp_path / "other"):  # the other one has cameras alone
        folder.mkdir(exist_ok=True)
        (folder / "calibration.toml").write_text("")
    for name in ("cam1.mp4", "cam2.mp4"):
        (take / name).touch()
    found = {one.name: one.kind for one in Roots(tmp_path).find()}
    assert found == {"a/track": "track", "take": "take", "voxels": "voxels"}
    assert find_kind(tmp_path / "other") is None


def test_nothing_outside_is_opened(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    secret = save_track(tmp_path / "secret")
    (inside / "link").symlink_to(secret)
    roots = Roots(inside)
    assert roots.find() == []
    for path in (secret, inside / ".." / "secret", inside / "link", Path("/etc")):
        with pytest.raises(InputError, match="outside of the folders"):
            roots.check(path)
    assert roots.check(inside / "later") == inside.resolve() / "later"
    with pytest.raises(MissingFileError):
        Roots(tmp_path / "gone")
