"""`apf timings`: a table and a picture of what each device takes for a frame."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from helpers.commands import fail, succeed

from apf.cli import timings
from apf.timings.measure import Timing


def made(kind: str, cores: int | None, ms: float) -> dict[str, Any]:
    run = {"frames": Timing((3 * ms, ms, ms)), "error_mm": 25.0}
    column: dict[str, Any] = {"kind": kind, "cores": cores, "runs": [run]}
    if kind != "numpy":
        column["to_pose"] = {"frames": Timing((ms / 2,))}
    return column


def test_devices_beside_one_core(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of every device in turn; the first frame, which is worked on twice, does not count."""
    monkeypatch.setattr(timings, "make_problem", lambda frames: None)
    monkeypatch.setattr(timings, "column", lambda place, *_: made("gpu", None, 2.0))
    times = {"on_cpu": made("cpu", 1, 100.0), "on_numpy": made("numpy", 1, 8000.0)}
    monkeypatch.setattr(timings, "apart", lambda environ, work, *_: times[work.__name__])
    place = SimpleNamespace(label="GPU, 2 cores", cores=2)
    monkeypatch.setattr(timings, "places", lambda: [place])
    monkeypatch.setattr(timings, "cpu_place", lambda: place)
    out = tmp_path / "out"
    said = succeed("apf", "timings", "-o", out).out
    rows = json.loads((out / "timings.json").read_text())["rows"]
    assert [row["ms"] for row in rows] == [8000, 100, 2]
    assert rows[-1]["times_one_core"] == 50 and rows[-1]["streamed_ms"] == 1
    assert (out / "timings.png").read_bytes().startswith(b"\x89PNG")
    assert "NumPy" in said and "50.00" in said
    fail("apf", "timings", "--seconds", "0", "-o", tmp_path / "no")
