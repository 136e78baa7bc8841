"""TRC files: writing, and reading those of other programs."""

from pathlib import Path

import numpy as np
import pytest
from helpers.shared import shared_data

from apf.formats.trc import JointSeries, read_trc, write_trc


def test_layout_is_what_opensim_reads(tmp_path: Path) -> None:
    points = np.array([[[1.0, 2.0, 3.0], [np.nan] * 3]])
    write_trc(tmp_path / "a.trc", JointSeries(("head top", "b"), points, 50.0, np.array([10])))
    lines = (tmp_path / "a.trc").read_text().split("\n")
    assert lines[0] == "PathFileType\t4\t(X/Y/Z)\ta.trc"
    assert lines[1].startswith("DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate")
    assert lines[2] == "50\t50\t1\t2\tmm\t50\t11\t1"
    assert lines[3] == "Frame#\tTime\thead_top\t\t\tb\t\t"
    assert lines[4] == "\t\tX1\tY1\tZ1\tX2\tY2\tZ2"
    assert lines[5] == ""
    # World (x, y, z) = (1, 2, 3) m: Y up, X = x, Y = z, Z = -y, mm; a missing point is NaN.
    assert lines[6] == "11\t0.200000\t1000.00000\t3000.00000\t-2000.00000\tNaN\tNaN\tNaN"
    assert lines[7:] == [""]
    assert np.isnan(read_trc(tmp_path / "a.trc").joints[0, 1]).all()


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


def test_frames_counted_from_zero_and_short_rows(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_text(trc("0\t0\t1\t2\t3\n1\t0.1\t1\t\t3\t4\t5\t6\n"))
    series = read_trc(tmp_path / "a.trc")
    np.testing.assert_array_equal(series.frames, [0, 1])
    assert np.isnan(series.joints[0, 1]).all()
    assert np.isnan(series.joints[1, 0]).any()


@pytest.mark.parametrize("kind", ["", "_filt_butterworth_LSTM"])
def test_pose2sim_files(kind: str) -> None:
    folder = shared_data("pose2sim_balance") / "truth"
    series = read_trc(folder / f"S00_P00_T01_BalancingTrial_0-100{kind}.trc", "pose2sim")
    assert series.joints.shape == (100, 64 if "LSTM" in kind else 21, 3)
    assert series.fps == 60
    head = series.joints[:, series.joint_names.index("Head")]
    assert np.all((head[:, 2] > 1.4) & (head[:, 2] < 1.9))  # Z up, metres
