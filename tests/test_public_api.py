"""What `import psfs` and `import apf` give, and that the README's example runs."""

import inspect
import re
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from helpers.commands import succeed

import apf
import psfs
from psfs.common.files import read_toml

ROOT = Path(__file__).parents[1]
PACKAGES = pytest.mark.parametrize("package", [psfs, apf], ids=["psfs", "apf"])


@PACKAGES
def test_public_names_are_there_documented_and_listed(package: ModuleType) -> None:
    assert package.__doc__ and package.__version__ == version("psfs-apf")
    assert set(package.__all__) <= set(dir(package))
    for name in package.__all__:
        value = getattr(package, name)
        assert inspect.getdoc(value), f"{package.__name__}.{name} has no docstring"
        if callable(value):
            assert value.__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = package.nonsense


def test_types_and_data_files_are_packaged() -> None:
    setup = read_toml(ROOT / "pyproject.toml")["tool"]["setuptools"]
    for package in ("cl", "psfs", "apf"):
        assert (ROOT / package / "py.typed").is_file()
        patterns = setup["package-data"][package]
        assert "py.typed" in patterns
        assert all(list((ROOT / package).glob(pattern)) for pattern in patterns)


def test_reconstruct_gives_the_clouds_of_the_command(small_walk: Path, tmp_path: Path) -> None:
    succeed("psfs", "reconstruct", small_walk, "-o", tmp_path)
    clouds = list(psfs.reconstruct(psfs.open_sequence(small_walk)))  # all kept, none overwritten
    assert len(clouds) == 4
    for frame, cloud in enumerate(clouds):
        written = psfs.read_cloud(tmp_path / "clouds" / f"frame_{frame:06d}.npz")
        np.testing.assert_array_equal(cloud.indices, written.indices)
        np.testing.assert_array_equal(cloud.probability, written.probability)
        assert cloud.colour is not None and written.colour is not None
        np.testing.assert_array_equal(cloud.colour, written.colour)
        assert len(cloud) > 500 and cloud.volume == written.volume


def test_reconstruct_takes_a_volume_frames_and_no_colour(small_walk: Path) -> None:
    sequence = psfs.open_sequence(small_walk, fps=50)
    volume = np.array([-0.9, -0.9, 0.0]), np.array([0.9, 0.9, 1.9])
    (cloud,) = psfs.reconstruct(
        sequence, frames=slice(2, 3), volume=volume, voxel_size=0.05, colour=False, device="cpu"
    )
    assert sequence.fps == 50 and cloud.colour is None and len(cloud)
    assert cloud.grid.voxel_size == 0.05 and cloud.grid.low.tolist() == [-0.9, -0.9, 0.0]


def test_track_gives_the_track_of_the_command(small_walk: Path, tmp_path: Path) -> None:
    truth = small_walk / "truth.npz"
    flags = ["--no-overlay", "--no-report", "--particles", "60", "--layers", "4"]
    succeed("apf", "track", small_walk, "-o", tmp_path, "--init", truth, *flags)
    stages: list[str] = []
    track = apf.track(
        psfs.open_sequence(small_walk),
        init=truth,
        method=apf.Method.create(n_particles=60, n_layers=4),
        progress=stages.append,
    )
    np.testing.assert_array_equal(track.poses, apf.Track.open(tmp_path).poses)
    assert stages == [
        "opening",
        "examining",
        "volume",
        "preparing",
        *4 * ["tracking"],
        *4 * ["tracking back"],
    ]
    assert apf.evaluate(track, apf.load_truth(truth)).mean_error < 0.1
    for ending in ("npz", "trc", "csv", "bvh", "c3d", "glb", "mot"):
        track.save(tmp_path / "out" / f"walk.{ending}")
        assert (tmp_path / "out" / f"walk.{ending}").stat().st_size > 1000


def test_track_takes_a_pose_and_says_what_is_wrong(small_walk: Path) -> None:
    sequence = psfs.open_sequence(small_walk)
    truth = apf.load_truth(small_walk / "truth.npz")
    joints = dict(zip(truth.joint_names, truth.joints[0], strict=True))
    body, pose, _ = apf.fit_to_joints(apf.load_body("song31"), joints)
    method = apf.Method.create(n_particles=30, n_layers=2)
    track = apf.track(sequence, body=body, init=pose, method=method, frames=slice(0, 2))
    assert track.frames.tolist() == [0, 1] and np.isfinite(track.joints).all()
    with pytest.raises(ValueError, match="chooses none of the 4 frames"):
        apf.track(sequence, body=body, init=pose, frames=slice(9, 12))
    with pytest.raises(apf.InputError, match=r"expected \(31,\)"):
        apf.track(sequence, body=body, init=pose[:-1], frames=slice(0, 2))


def test_what_is_not_there_is_a_missing_file(small_walk: Path, tmp_path: Path) -> None:
    """The standard exceptions do: FileNotFoundError, and ValueError for all bad input."""
    for read in (
        lambda: psfs.open_sequence(tmp_path / "nowhere"),
        lambda: psfs.open_sequence(small_walk, calibration=tmp_path / "none.toml"),
        lambda: psfs.read_cloud(tmp_path / "none.npz"),
        lambda: apf.Track.open(tmp_path / "none.npz"),
        lambda: apf.load_body(tmp_path / "none.toml"),
        lambda: apf.load_truth(tmp_path / "none.trc"),
        lambda: apf.load_truth(tmp_path / "none.npz"),
        lambda: apf.track(psfs.open_sequence(small_walk), init=tmp_path / "none.txt"),
    ):
        with pytest.raises(FileNotFoundError, match="no") as error:
            read()
        assert isinstance(error.value, psfs.MissingFileError) and "--" not in str(error.value)
    with pytest.raises(ValueError, match="cinema"):
        psfs.open_sequence(small_walk, background="cinema")


@pytest.mark.usefixtures("quick_start")
def test_readme_example_runs(
    small_walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the folder alone: the start is found, too."""
    (tmp_path / "demo").mkdir()
    (tmp_path / "demo" / "sequence").symlink_to(small_walk)
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    assert blocks
    names: dict[str, Any] = {}
    for block in blocks:
        exec(compile(block, "README.md", "exec"), names)
    assert (tmp_path / "walk.bvh").stat().st_size > 1000
    assert apf.evaluate(names["track"], apf.load_truth(small_walk / "truth.npz")).mean_error < 0.1
