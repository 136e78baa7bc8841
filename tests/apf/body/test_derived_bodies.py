"""Bodies that begin from another one, and the command that checks them."""

from pathlib import Path

import numpy as np
import pytest

from apf.body.kinematics import posed_cones
from apf.body.stature import lowest_point, stature
from apf.body.toml import format_body, load_body, parse_body
from apf.cli import main
from apf.synthetic.roaming import roam
from apf.synthetic.walk import Walk
from cl import InputError

OTHERS = ("blade", "child", "dog", "one_arm", "wheelchair")


@pytest.mark.parametrize("name", OTHERS)
def test_other_bodies_are_bodies(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    body = load_body(name)
    assert parse_body(format_body(body), name).dof_names == body.dof_names
    assert np.all((body.lower <= body.rest_pose) & (body.rest_pose <= body.upper))
    for action in ("show", "check"):
        assert main(["body", action, name]) == 0
    said = capsys.readouterr().out
    assert f"{name}: {len(body.bones)} bones" in said and "no automatic start" not in said


@pytest.mark.parametrize("name", OTHERS)
def test_bodies_roam_within_their_limits_on_the_floor(name: str) -> None:
    body = load_body(name)
    poses = roam(body, Walk(), np.arange(40) / 30, 1)
    assert np.all((poses >= body.lower - 1e-9) & (poses <= body.upper + 1e-9))
    lowest = [lowest_point(cones) for cones in posed_cones(body, poses)]
    np.testing.assert_allclose(lowest, 0, atol=1e-9)
    assert np.all(np.ptp(poses[:, body.sigma > 0.009], axis=0) > 0.05)


def test_what_a_file_says_replaces_the_base() -> None:
    song, child, one_arm = (load_body(name) for name in ("song32", "child", "one_arm"))
    assert stature(child) == pytest.approx(1.1, abs=0.01)
    assert "l_forearm" not in [*one_arm.cone_names, *(bone.name for bone in one_arm.bones)]
    assert set(song.joint_names) - set(one_arm.joint_names) == {"l_wrist"}
    assert len(one_arm.edges) == len(song.edges) - 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('base = "nobody"\nname = "a"', "nobody: no body model; expected"),
        ('base = "song32"\nname = "a"\nwithout = ["wing"]', "no bone named 'wing'"),
        ('base = "song32"\nname = "a"\nlengths = { wing = 2.0 }', "lengths: no 'wing'"),
        ('base = "song32"\nname = "a"\nscale = 5.0', "measures"),
        ('base = "song32"\nname = "a"\nwings = 2', "wings"),
    ],
)
def test_wrong_files_are_named(
    tmp_path: Path, text: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        load_body(path)
    assert main(["body", "check", str(path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_base_may_be_a_file_beside_it(tmp_path: Path) -> None:
    (tmp_path / "first.toml").write_text('base = "song32"\nname = "first"\nscale = 0.5')
    (tmp_path / "second.toml").write_text('base = "first.toml"\nname = "second"\nscale = 2.0')
    first, again = load_body("song32"), load_body(tmp_path / "second.toml")
    np.testing.assert_allclose(again.rest_pose, first.rest_pose)
    np.testing.assert_allclose(again.cones[3].end, first.cones[3].end)
