"""Readers given generated files: they give what was written, or one clear error."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from helpers import bodies, footage, tracks
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from apf.body import load_body, save_body
from apf.evaluation.evaluate import load_truth
from apf.formats.pose import read_pose
from apf.formats.trc import read_trc
from apf.tracking.track import Track
from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.cameras.camera import Camera, CameraRig
from psfs.common.names import LONGEST_NAME, check_name, escape_unprintable
from psfs.common.pictures import read_picture
from psfs.footage.settings import SequenceSettings
from psfs.voxels.clouds import read_cloud, write_npz
from psfs.voxels.grid import VoxelCloud, VoxelGrid

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

QUICK = settings(
    max_examples=60,
    deadline=None,
    database=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
NUMBER = st.one_of(
    st.floats(), st.integers(), st.booleans(), st.text(max_size=5), st.just(10**400), st.none()
)
VALUE = st.recursive(NUMBER, lambda inner: st.lists(inner, max_size=4), max_leaves=12)


def plain(value: Any) -> Any:
    """What TOML can hold."""
    if isinstance(value, list):
        return [plain(entry) for entry in value if entry is not None]
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 2**63:
        return float("inf")
    return 0 if value is None else value


def clear(read: Any, *arguments: Any) -> Any:
    """Return what a reader returns, or None where it raises one clear line."""
    try:
        return read(*arguments)
    except InputError as error:
        assert str(error) and "\n" not in escape_unprintable(str(error))
        return None


@QUICK
@given(
    key=st.sampled_from(["matrix", "size", "rotation", "translation", "distortions", "name"]),
    value=VALUE,
)
def test_calibrations(tmp_path: Path, key: str, value: Any) -> None:
    path = tmp_path / "calibration.toml"
    tables = footage.tables(footage.rig(2))
    tables["cam01"][key] = plain(value)
    path.write_text(tomli_w.dumps(tables))
    rig = clear(read_calibration, path)
    if rig is not None:
        for camera in rig:
            assert np.isfinite(camera.packed()).all()
            check_name(camera.name, "it")


angle = st.floats(-3, 3)


@QUICK
@given(
    focal=st.floats(1, 1e5), skew=st.floats(-5, 5), centre=st.tuples(angle, angle, angle),
    turn=st.tuples(angle, angle, angle), width=st.integers(1, 4000), height=st.integers(1, 4000),
)  # fmt: skip
def test_calibrations_come_back(
    tmp_path: Path, focal: float, skew: float, centre: tuple, turn: tuple, width: int, height: int
) -> None:
    import cv2

    R = cv2.Rodrigues(np.array(turn))[0]
    K = np.array([[focal, skew, width / 2], [0, focal * 1.1, height / 2], [0, 0, 1]])
    camera = Camera("a", K, np.zeros(5), R, np.array(centre), (width, height))
    path = tmp_path / "calibration.toml"
    path.write_text(tomli_w.dumps(footage.tables(CameraRig((camera,)))))
    found = read_calibration(path)[0]
    np.testing.assert_allclose(found.K, K)
    np.testing.assert_allclose(found.R, R, atol=1e-9)
    pixels = np.array([[0.0, 0.0], [width - 1.0, height - 1.0]])
    ahead = found.centre + 2 * found.rays(pixels)
    np.testing.assert_allclose(found.project(ahead)[0], pixels, atol=1e-5 * focal)


@QUICK
@given(values=st.dictionaries(st.sampled_from([*SequenceSettings.model_fields, "x"]), VALUE))
def test_settings(values: dict) -> None:
    clear(SequenceSettings.from_dict, values)


@QUICK
@given(
    place=st.sampled_from([
        ("name",), ("edges",), ("bone", 1, "offset"), ("bone", 1, "rest"), ("bone", 1, "parent"),
        ("bone", 1, "axes", 0, "sigma"), ("bone", 1, "axes", 0, "limits"), ("cone", 0, "radii"),
        ("cone", 0, "end"), ("cone", 0, "scale"), ("joint", 0, "position"), ("joint", 0, "bone"),
    ]),
    value=VALUE,
)  # fmt: skip
def test_bodies(tmp_path: Path, place: tuple, value: Any) -> None:
    path = tmp_path / "body.toml"
    entry = table = tomllib.loads(bodies.STICK)
    for step in place[:-1]:
        if isinstance(entry, dict):
            assume(step in entry)
        entry = entry[step]
    entry[place[-1]] = plain(value)
    path.write_text(tomli_w.dumps(table))
    body = clear(load_body, path)
    if body is not None:
        assert np.isfinite(body.sigma).all() and np.isfinite(body.rest_pose).all()
        save_body(tmp_path / "copy.toml", body)
        assert load_body(tmp_path / "copy.toml").dof_names == body.dof_names


@QUICK
@given(content=st.binary(max_size=300), suffix=st.sampled_from(
    [".toml", ".yml", ".xml", ".json", ".cal", ".txt", "_par.txt"]))  # fmt: skip
def test_calibrations_of_noise(tmp_path: Path, content: bytes, suffix: str) -> None:
    path = tmp_path / f"x{suffix}"
    path.write_bytes(content)
    clear(read_calibration, path, None, (64, 48))


WORDS = st.lists(
    st.one_of(st.floats().map(str), st.sampled_from(["cam01", "1", "3", "x", "nan", "\t", "\n"])),
    max_size=60,
).map(" ".join)


@QUICK
@given(text=WORDS)
def test_texts_of_numbers(tmp_path: Path, text: str) -> None:
    for name in ("a.cal", "a_par.txt", "a.txt"):
        (tmp_path / name).write_text(text)
        clear(read_calibration, tmp_path / name, None, (64, 48))
    pose = clear(read_pose, tmp_path / "a.txt", bodies.named("stick"))
    assert pose is None or np.isfinite(pose).all()
    (tmp_path / "a.trc").write_text(f"PathFileType\t4\n{text}")
    clear(read_trc, tmp_path / "a.trc")


def damaged(content: bytes, places: list[tuple[float, int]], cut: float) -> bytes:
    data = bytearray(content)
    for share, value in places:
        data[min(int(share * len(data)), len(data) - 1)] = value
    return bytes(data[: math.ceil(cut * len(data))])


PLACES = st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), max_size=8)
CUT = st.one_of(st.just(1.0), st.floats(0, 1))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A file of each kind."""
    import cv2

    folder = tmp_path_factory.mktemp("whole")
    track = tracks.walker(3)
    track.save(folder / "track.npz")
    track.save(folder / "joints.trc")
    grid = VoxelGrid(np.zeros(3), 0.1, (5, 5, 5))
    cloud = VoxelCloud(grid, np.arange(9, dtype=np.int32), np.ones(9, np.float32))
    write_npz(cloud, folder / "cloud.npz")
    picture = np.random.default_rng(1).integers(0, 255, (24, 32, 3), np.uint8)
    for suffix in (".png", ".jpg", ".bmp", ".tiff", ".ppm"):
        cv2.imwrite(str(folder / f"picture{suffix}"), picture)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


READERS = {
    "track.npz": Track.open, "joints.trc": load_truth, "cloud.npz": read_cloud,
    "picture.png": read_picture, "picture.jpg": read_picture, "picture.bmp": read_picture,
    "picture.tiff": read_picture, "picture.ppm": read_picture,
}  # fmt: skip


@pytest.mark.parametrize("name", READERS)
@settings(QUICK, max_examples=40)
@given(places=PLACES, cut=CUT)
def test_damaged_files(
    tmp_path: Path, whole: dict[str, bytes], name: str, places: list, cut: float
) -> None:
    path = tmp_path / name
    path.write_bytes(damaged(whole[name], places, cut))
    found = clear(READERS[name], path)
    if isinstance(found, Track):
        assert np.isfinite(found.poses).all()
    if isinstance(found, VoxelCloud) and len(found):
        assert 0 <= found.indices.min() <= found.indices.max() < found.grid.size


@settings(QUICK, max_examples=200)
@given(name=st.text(max_size=120))
def test_names(name: str) -> None:
    """A name that passes is a file's inside a folder, and prints as it is."""
    if clear(check_name, name, "a camera") is not None:
        assert 0 < len(name) <= LONGEST_NAME and escape_unprintable(name) == name
        assert Path("folder", name).parent == Path("folder") and name not in ("", ".", "..")


@settings(QUICK, max_examples=200)
@given(text=st.text())
def test_what_is_printed_is_one_line(text: str) -> None:
    assert escape_unprintable(text).isprintable()
