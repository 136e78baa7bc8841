"""scripts/compare_smoothing.py: figures of a walk whose truth is known."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.shared import ROOT
from helpers.striders import Stride, strider

sys.path.insert(0, str(ROOT / "scripts"))

import compare_smoothing
from peers.figures import measure_travels


def test_figures_of_a_walk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    true, noisy = strider(), strider(noise=0.03)
    noisy.save(tmp_path / "track.npz")
    names = [*true.joint_names, "l_toe", "r_toe"]
    toes = true.points.joints[:, [true.points.joint_names.index(n) for n in names[-2:]]]
    joints = np.concatenate([true.joints, toes], 1)
    np.savez(tmp_path / "truth.npz", joint_names=np.array(names), joints=joints, fps=60.0)
    pair = f"{tmp_path}={tmp_path / 'truth.npz'}"
    monkeypatch.setattr(sys, "argv", ["compare_smoothing.py", pair])
    assert compare_smoothing.main() == 0
    shown = capfd.readouterr().out
    assert "as tracked" in shown and "feet held" in shown
    stands = Stride().stands(len(true))
    travels = {
        name: measure_travels(track.series, stands)
        for name, track in compare_smoothing.variants(noisy, 6.0).items()
    }
    assert measure_travels(true.series, stands) == pytest.approx([0] * 6, abs=1e-6)
    assert max(travels["as tracked"]) > max(travels["feet held"])
    monkeypatch.setattr(sys, "argv", ["compare_smoothing.py", "nothing"])
    assert compare_smoothing.main() == 2
