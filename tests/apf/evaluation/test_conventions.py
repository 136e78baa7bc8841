"""Truths whose axes or unit are not what was stated."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import tracks

from apf.cli import main
from apf.evaluation.conventions import axes_that_fit
from apf.evaluation.evaluate import evaluate
from apf.formats.trc import CONVENTIONS, JointSeries, write_trc

TRACK = tracks.walker(20)


def said(truth: JointSeries, convention: str = "z-up") -> str | None:
    return axes_that_fit([(TRACK, truth)], evaluate(TRACK, truth).mean_error, convention)


@pytest.mark.parametrize("written", CONVENTIONS)
@pytest.mark.parametrize("read", CONVENTIONS)
def test_the_command_names_the_convention(
    written: str, read: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    TRACK.save(tmp_path / "track.npz")
    write_trc(tmp_path / "truth.trc", tracks.truth_of(TRACK), written)
    flags = ["--truth", str(tmp_path / "truth.trc"), "--convention", read, "--csv"]
    assert main(["evaluate", str(tmp_path / "track.npz"), *flags]) == 0
    text = capsys.readouterr().out
    named = f"m with --convention {written}" in text
    assert named == (written != read) and ("warning" in text) == named


@pytest.mark.parametrize("written", CONVENTIONS)
def test_the_axes_of_a_trc_are_found(
    written: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    TRACK.save(tmp_path / "track.npz")
    write_trc(tmp_path / "truth.trc", tracks.truth_of(TRACK), written)
    flags = ["--truth", str(tmp_path / "truth.trc"), "--json"]
    assert main(["evaluate", str(tmp_path / "track.npz"), *flags]) == 0
    text = capsys.readouterr().out
    assert (f"read with --convention {written}" in text) == (written != "y-up")
    assert "warning" not in text
    summary = json.loads((tmp_path / "evaluation.json").read_text())
    assert summary["mean_error_mm"] < 1


def test_units_and_axes_without_a_name() -> None:
    truth = tracks.truth_of(TRACK)
    assert said(truth) is None
    assert "coordinates times 0.001" in str(said(replace(truth, joints=1000 * truth.joints)))
    turned = np.array([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])
    words = str(said(replace(truth, joints=truth.joints @ turned.T)))
    assert "m with world axes (x, y, z) = (-Z, X, -Y) of the file" in words
    mirrored = replace(truth, joints=truth.joints * [1, 1, -1])
    assert "which is mirrored" in str(said(mirrored))


def test_another_take_fits_nothing() -> None:
    truth = tracks.truth_of(TRACK)
    noise = np.random.default_rng(0).uniform(-2, 2, truth.joints.shape)
    assert "is it of this take" in str(said(replace(truth, joints=noise)))
