"""C3D, TRC, MOT and CSV files: by independent readers, and those of other programs."""

import csv
from dataclasses import replace
from pathlib import Path

import ezc3d
import numpy as np
import pytest
from helpers import bodies, tracks
from helpers.striders import strider, track_of_poses
from scipy.spatial.transform import Rotation

from apf.body.angles import anatomical_frames
from apf.body.toml import load_body
from apf.formats.angles import opensim_coordinates, write_angle_csv
from apf.formats.c3d import C3dEvent, read_c3d, write_c3d
from apf.formats.trc import JointSeries, read_trc, write_trc
from apf.tracking.track import Track
from cl import InputError


def walk() -> Track:
    """Return a track with a covariance that is lost in frames 3 and 4."""
    track = tracks.lose(strider(10), [3, 4])
    covariance = np.zeros((10, len(track.joint_names), 3, 3))
    covariance[:] = np.diag([0.01, 0.02, 0.03]) ** 2
    covariance[:, track.joint_names.index("l_ankle")] *= 4
    covariance[track.lost] = np.nan
    return replace(track, diagnostics={**track.diagnostics, "covariance": covariance})


def test_ezc3d_reads_points_units_rate_and_residuals(tmp_path: Path) -> None:
    track = replace(walk(), frames=np.arange(20, 30))
    track.save(tmp_path / "a.c3d")
    file = ezc3d.c3d(str(tmp_path / "a.c3d"))
    point = file["parameters"]["POINT"]
    assert point["UNITS"]["value"] == ["mm"] and point["RATE"]["value"][0] == 60
    assert point["X_SCREEN"]["value"] == ["+X"] and point["Y_SCREEN"]["value"] == ["+Z"]
    labels = point["LABELS"]["value"]
    assert labels == list(track.points.joint_names)
    assert {"l_heel", "l_toe", "r_hand"} <= set(labels)
    assert file["header"]["points"]["first_frame"] == 20
    points = file["data"]["points"][:3].transpose(2, 1, 0) / 1000
    np.testing.assert_allclose(points, track.points.joints, atol=1e-6)
    assert np.isnan(points[3:5]).all() and np.isfinite(np.delete(points, [3, 4], 0)).all()
    residuals = dict(zip(labels, file["data"]["meta_points"]["residuals"][0], strict=True))
    away = 1000 * np.sqrt(0.01**2 + 0.02**2 + 0.03**2)
    assert residuals["neck"][0] == pytest.approx(away, abs=1)  # the format rounds them
    assert residuals["l_ankle"][0] == pytest.approx(2 * away, abs=1)
    assert residuals["l_heel"][0] == residuals["l_ankle"][0] > residuals["r_heel"][0]
    assert (residuals["neck"][3:5] == -1).all()


def test_c3d_has_events_as_laboratories_write_them(tmp_path: Path) -> None:
    """At most 255, with more of which it could not be read."""
    events = [C3dEvent("Foot Strike", "Left", 0.25), C3dEvent("Foot Off", "Right", 61.5)]
    write_c3d(tmp_path / "many.c3d", walk().points, 150 * events)
    file = ezc3d.c3d(str(tmp_path / "many.c3d"))
    assert file["parameters"]["EVENT"]["USED"]["value"].tolist() == [255]
    assert len(file["parameters"]["EVENT"]["LABELS"]["value"]) == 255
    assert file["data"]["points"].shape[2] == len(walk())
    write_c3d(tmp_path / "a.c3d", walk().points, events)
    group = ezc3d.c3d(str(tmp_path / "a.c3d"))["parameters"]["EVENT"]
    assert group["USED"]["value"].tolist() == [2]
    assert group["LABELS"]["value"] == ["Foot Strike", "Foot Off"]
    assert group["CONTEXTS"]["value"] == ["Left", "Right"]
    np.testing.assert_allclose(group["TIMES"]["value"], [[0, 1], [0.25, 1.5]])


def test_c3d_goes_on_in_a_file_beside_it_after_so_many_frames_or_points(tmp_path: Path) -> None:
    most = 65534
    points = np.zeros((most + 9, 1, 3))
    points[:, 0, 0] = np.linspace(0, 1, most + 9)
    series = JointSeries(("a",), points, 100.0, np.arange(most + 9))
    strikes = [C3dEvent("Foot Strike", "Left", frame / 100) for frame in (most - 1, most, most + 5)]
    written = write_c3d(tmp_path / "a.c3d", series, strikes)
    assert [path.name for path in written] == ["a.c3d", f"a_frame{most}.c3d"]
    files = [ezc3d.c3d(str(path)) for path in written]
    found = np.concatenate([file["data"]["points"][0, 0] for file in files])
    np.testing.assert_allclose(found, 1000 * points[:, 0, 0], atol=1e-3)
    minutes, seconds = files[1]["parameters"]["EVENT"]["TIMES"]["value"]
    np.testing.assert_allclose(60 * minutes + seconds, [0, 0.05], atol=1e-4)
    assert files[0]["parameters"]["EVENT"]["USED"]["value"].tolist() == [1]
    names = tuple(f"p{number}" for number in range(300))
    points = np.arange(2 * 300 * 3.0).reshape(2, 300, 3)
    written = write_c3d(tmp_path / "a.c3d", JointSeries(names, points, 9.0, np.array([7, 8])))
    assert [path.name for path in written] == ["a.c3d", "a_point255.c3d"]
    found = [read_c3d(path) for path in written]
    assert found[0].joint_names + found[1].joint_names == names
    np.testing.assert_allclose(np.hstack([file.joints for file in found]), points, atol=1e-3)
    assert all(file.frames.tolist() == [7, 8] for file in found)


def test_c3d_has_a_frame_for_each_that_was_left_out(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="too many for a file without times"):
        replace(strider(3), frames=np.array([0, 1, 10**9])).save(tmp_path / "a.c3d")
    assert not list(tmp_path.iterdir())
    track = replace(strider(3), frames=np.array([4, 6, 10]))
    track.save(tmp_path / "a.c3d")
    file = ezc3d.c3d(str(tmp_path / "a.c3d"))
    points = file["data"]["points"][:3].transpose(2, 1, 0) / 1000
    assert file["parameters"]["POINT"]["RATE"]["value"][0] == 30 and len(points) == 4
    np.testing.assert_allclose(points[[0, 1, 3]], track.points.joints, atol=1e-6)
    assert np.isnan(points[2]).all()


@pytest.mark.parametrize("axes", ["y-up", "z-up", "pose2sim"])
def test_trc_has_markers_and_named_axes(tmp_path: Path, axes: str) -> None:
    track = walk()
    track.save(tmp_path / "a.trc", axes=axes)
    again = read_trc(tmp_path / "a.trc", axes)
    assert again.joint_names == track.points.joint_names
    np.testing.assert_allclose(again.joints, track.points.joints, atol=1e-6)
    assert np.isnan(again.joints[3]).all()
    table = np.genfromtxt(tmp_path / "a.trc", delimiter="\t", skip_header=5)  # another reader
    x, y, z = 1000 * np.moveaxis(track.points.joints, -1, 0)
    shown = {"y-up": (x, z, -y), "z-up": (x, y, z), "pose2sim": (y, z, x)}[axes]
    points = table[:, 2:].reshape(10, -1, 3)
    np.testing.assert_allclose(points, np.stack(shown, -1), atol=1e-4)


def read_mot(path: Path) -> dict[str, np.ndarray]:
    header, body = path.read_text().split("endheader\n")
    assert "inDegrees=yes" in header and header.startswith("Coordinates\nversion=1\n")
    lines = body.strip().split("\n")
    table = np.array([line.split("\t") for line in lines[1:]], float)
    assert f"nRows={len(table)}" in header and f"nColumns={table.shape[1]}" in header
    return dict(zip(lines[0].split("\t"), table.T, strict=True))


def test_mot_turns_segments_as_opensim_does(tmp_path: Path) -> None:
    """Its joints turn about Z, X' and Y'' (Rajagopal et al. 2016); knees to positive angles."""
    body = load_body("song31")
    track = track_of_poses(body, bodies.random_poses(body, 15, wild=True))
    track.save(tmp_path / "a.mot")
    table, frames = read_mot(tmp_path / "a.mot"), anatomical_frames(body, track.poses)
    to_y_up = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])

    def turned(*names: str) -> np.ndarray:
        degrees = np.stack([table[name] for name in names], -1)
        return Rotation.from_euler("ZXY", degrees, degrees=True).as_matrix()

    pelvis = turned("pelvis_tilt", "pelvis_list", "pelvis_rotation")
    np.testing.assert_allclose(pelvis, to_y_up @ frames["pelvis"], atol=1e-6)
    thigh = pelvis @ turned("hip_flexion_r", "hip_adduction_r", "hip_rotation_r")
    np.testing.assert_allclose(thigh, to_y_up @ frames["r_thigh"], atol=1e-6)
    torso = pelvis @ turned("lumbar_extension", "lumbar_bending", "lumbar_rotation")
    arm = torso @ turned("arm_flex_r", "arm_add_r", "arm_rot_r")
    np.testing.assert_allclose(arm, to_y_up @ frames["r_upper_arm"], atol=1e-6)
    knee = Rotation.from_euler("z", -table["knee_angle_r"][:, None], degrees=True).as_matrix()
    np.testing.assert_allclose(thigh @ knee, to_y_up @ frames["r_shank"], atol=1e-6)
    place = np.stack([table[f"pelvis_t{axis}"] for axis in "xyz"], -1) @ to_y_up
    np.testing.assert_allclose(place, track.joints[:, 0], atol=1e-7)
    own = np.degrees(track.poses[:, body.dof_names.index("l_thigh.ry")])
    np.testing.assert_allclose(table["hip_flexion_l"], own, atol=1e-6)
    np.testing.assert_allclose(table["time"], track.times, atol=1e-8)


def test_mot_of_lost_frames_and_of_parts_of_bodies(tmp_path: Path) -> None:
    walk().save(tmp_path / "a.mot")
    table = read_mot(tmp_path / "a.mot")
    for values in table.values():  # lost in 3 and 4
        np.testing.assert_allclose(values[2:6], np.linspace(values[2], values[5], 4), atol=1e-6)
    upper = load_body("rymut31_upper")
    assert "knee_angle_r" not in opensim_coordinates(upper, upper.rest_pose[None])


def test_angle_csv(tmp_path: Path) -> None:
    track = replace(walk(), frames=np.arange(50, 60))
    write_angle_csv(tmp_path / "angles.csv", track.angles, track.points)
    with (tmp_path / "angles.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0])[:3] == ["frame", "time_s", "pelvis_rotation_deg"]
    assert rows[2]["frame"] == "52" and float(rows[2]["time_s"]) == pytest.approx(52 / 60, abs=1e-6)
    for name, values in track.angles.items():
        cells = [row[f"{name}_deg"] for row in rows]
        assert cells[3] == cells[4] == ""
        for cell, value in zip(cells, values, strict=True):
            assert cell == "" if np.isnan(value) else abs(float(cell) - value) < 1e-4
    knee = np.degrees(track.poses[:, track.dof_names.index("l_calf.ry")])
    assert np.nanmax(np.abs(track.angles["l_knee_flexion"] - knee)) < 1e-9


def test_points_of_a_track_without_its_body(tmp_path: Path) -> None:
    track = replace(walk(), body=None)
    track.save(tmp_path / "a.trc")
    assert read_trc(tmp_path / "a.trc").joint_names == track.joint_names
    for ending in ("bvh", "mot", "glb"):
        with pytest.raises(InputError, match="does not hold its body"):
            track.save(tmp_path / f"a.{ending}")
    with pytest.raises(InputError, match="does not hold its body"):
        _ = track.angles
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.trc"]


def test_layout_is_what_opensim_reads(tmp_path: Path) -> None:
    points = np.array([[[1.0, 2.0, 3.0], [np.nan] * 3]])
    write_trc(tmp_path / "a.trc", JointSeries(("head top", "b"), points, 50.0, np.array([10])))
    first, heads, *lines = (tmp_path / "a.trc").read_text().split("\n")
    assert first == "PathFileType\t4\t(X/Y/Z)\ta.trc"
    assert heads.startswith("DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate")
    # World (x, y, z) = (1, 2, 3) m: Y up, X = x, Y = z, Z = -y, mm; a missing point is NaN.
    assert lines == [
        "50\t50\t1\t2\tmm\t50\t11\t1",
        "Frame#\tTime\thead_top\t\t\tb\t\t",
        "\t\tX1\tY1\tZ1\tX2\tY2\tZ2",
        "",
        "11\t0.200000\t1000.00000\t3000.00000\t-2000.00000\tNaN\tNaN\tNaN",
        "",
    ]


def test_every_other_frame_has_half_the_rate(tmp_path: Path) -> None:
    points = np.arange(9.0).reshape(3, 1, 3)
    series = JointSeries(("a",), points, 60.0, np.array([4, 6, 8]))
    write_trc(tmp_path / "a.trc", series)
    assert (tmp_path / "a.trc").read_text().split("\n")[2].startswith("30\t60\t3")
    again = read_trc(tmp_path / "a.trc")
    assert again.fps == 60
    np.testing.assert_array_equal(again.frames, [4, 6, 8])
    resampled = again.resample(30.0)
    np.testing.assert_array_equal(resampled.frames, [2, 3, 4])
    np.testing.assert_allclose(resampled.joints, points, atol=1e-7)


def trc(rows: str, unit: str = "m", blank: str = "\n", first: str = "PathFileType\t4") -> str:
    return (
        f"{first}\t(X/Y/Z) C:\\some folder\\a.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\t"
        f"Units\n60.0\t60.0\t1\t2\t{unit}\nFrame#\tTime\tRHip\t\t\tNeck\t\t\t\t\n"
        f"\t\tX1\tY1\tZ1\tX2\tY2\tZ2\t\n{blank}{rows}"
    )


@pytest.mark.parametrize(
    ("convention", "unit", "blank", "end"),
    [("y-up", "m", "", "\n"), ("pose2sim", "mm", "\n", "\r\n"), ("z-up", "m", "\t\t\n", "\r\n")],
)
def test_variants(tmp_path: Path, convention: str, unit: str, blank: str, end: str) -> None:
    text = trc("1\t0.0167\t1\t2\t3\t4\t5\t6\t\n\n", unit, blank, "PathFileType  4")
    (tmp_path / "a.trc").write_bytes(text.replace("\n", end).encode())
    series = read_trc(tmp_path / "a.trc", convention)
    assert series.joint_names == ("RHip", "Neck")
    assert series.fps == 60
    np.testing.assert_array_equal(series.frames, [0])
    world = {"y-up": [1, -3, 2], "pose2sim": [3, 1, 2], "z-up": [1, 2, 3]}[convention]
    np.testing.assert_allclose(series.joints[0, 0], np.array(world) * (1 if unit == "m" else 1e-3))

    # Frames that are counted from zero, and short rows.
    (tmp_path / "a.trc").write_text(trc("0\t0\t1\t2\t3\n1\t0.1\t1\t\t3\t4\t5\t6\n"))
    series = read_trc(tmp_path / "a.trc")
    assert series.frames.tolist() == [0, 1]
    assert np.isnan(series.joints[0, 1]).all() and np.isnan(series.joints[1, 0]).any()
