"""`apf render` from the command line."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import footage, tracks
from helpers.commands import fail, succeed

from apf.body.toml import load_body
from apf.image_objective.renderer import draw_hypotheses
from apf.scene import Scene
from cl import Device


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a sequence `seq` of 12 frames and a track `track` of frames 2 to 6."""
    folder = tmp_path_factory.mktemp("render")
    footage.native(folder / "seq")
    tracks.walker(5, start=2).save(folder / "track" / "track.npz")
    return folder


def render(recorded: Path, *more: str) -> list[str]:
    return ["apf", "render", str(recorded / "seq"), str(recorded / "track"), *more]


def test_pictures_show_what_is_counted(recorded: Path, tmp_path: Path) -> None:
    succeed(*render(recorded, "-o", str(tmp_path), "--frames", "3:5"))
    names = {f"cam{k:02d}_{frame:06d}.png" for k in (1, 2, 3) for frame in (3, 4)}
    for kind in ("silhouettes", "edges", "overlay"):
        assert {path.name for path in (tmp_path / kind).iterdir()} == names
    body, track = load_body("song31"), tracks.walker(5, start=2)
    drawn = draw_hypotheses(Scene(Device.best(), footage.rig(), None, body), track.poses[1:2])[0, 1]
    silhouette = cv2.imread(str(tmp_path / "silhouettes" / "cam02_000003.png"), 0)
    edges = cv2.imread(str(tmp_path / "edges" / "cam02_000003.png"), 0)
    overlay = cv2.imread(str(tmp_path / "overlay" / "cam02_000003.png"))
    assert np.count_nonzero(silhouette) > 50
    # The calibration went through text.
    assert np.count_nonzero((silhouette > 0) != (drawn[..., 0] > 0)) <= 1
    assert np.count_nonzero((edges > 0) != (drawn[..., 1] > 0)) <= 1
    assert (overlay[edges > 0] == 255).all()
    untouched = overlay[(silhouette == 0) & (edges == 0)].astype(int)
    assert np.abs(untouched - footage.grey(3, 1)).max() <= footage.LOSS


@pytest.mark.parametrize("shape", [["--device", "numpy"], ["--round-ends"]])
def test_other_shapes_and_the_twin(recorded: Path, tmp_path: Path, shape: list[str]) -> None:
    succeed(*render(recorded, "-o", str(tmp_path), "--frames", "3:4", *shape))
    assert cv2.imread(str(tmp_path / "silhouettes" / "cam02_000003.png"), 0).any()


def test_bad_input_is_one_line(recorded: Path, tmp_path: Path) -> None:
    for more, message in (
        (["--frames", "0:2"], "has none of the frames 0 to 1"),
        (["--opengl", "--round-ends"], "--round-ends is OpenCL's"),
    ):
        assert message in fail(*render(recorded, "-o", str(tmp_path / "out"), *more))
