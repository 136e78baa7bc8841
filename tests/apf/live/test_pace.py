"""A live run: how large a search a frame's time allows, its speed, its trace, its latency."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from apf.evaluation.joint_names import EVALUATED_JOINTS
from apf.filters.method import Method
from apf.formats.trc import JointSeries
from apf.live.config import LiveConfig
from apf.live.pace import expect_pace
from apf.live.session import STAGES, Governor, list_sizes, resize_search
from apf.live.sources import ACQUISITION
from apf.live.timeline import Span, Timeline, live_errors


def test_what_is_to_be_expected() -> None:
    def pace(rate: float, processing: float, searching: float, scale: float) -> tuple[bool, str]:
        governor = SimpleNamespace(costs=[searching], chosen=0)
        live = SimpleNamespace(
            expected_rate=rate, processing_time=processing, governor=governor, scale=scale
        )
        return expect_pace(live, 30.0)  # type: ignore[arg-type]

    keeps_up, slow = pace(4.0, 0.2, 0.05, 0.5)
    assert not keeps_up and "about 4.0 poses per second" in slow
    assert "; faster with smaller pictures (--scale 0.25), a smaller search" in slow
    assert "; faster with a smaller search" in pace(4.0, 0.05, 0.2, 0.5)[1]
    assert pace(28.0, 0.02, 0.01, 1.0)[0]


def test_errors_of_frames_and_of_when_poses_are_known() -> None:
    """Joints that move by 1 m/s at 10 frames/s, tracked 5 mm above: late by their way."""
    names, frames = EVALUATED_JOINTS, np.arange(20)
    joints = np.zeros((20, len(names), 3))
    joints[..., 0] = frames[:, None] / 10
    truth = JointSeries(names, joints, 10.0, frames)
    track = replace(truth, joints=joints[::4] + np.array([0, 0, 0.005]), frames=frames[::4])
    errors = live_errors(track, truth, np.array([0.12, 0.12, 0.0, 0.24, 9.0]))
    assert errors["error_mm"] == pytest.approx(5)
    late = [np.hypot(way, 5) for way in (120, 120, 0, 240)]  # the last has no truth
    assert errors["error_when_known_mm"] == pytest.approx(np.mean(late), abs=0.01)
    assert live_errors(track, truth, np.full(5, 9.0))["error_when_known_mm"] is None


def test_timeline_and_its_picture(tmp_path: Path) -> None:
    timeline = Timeline(STAGES)
    for frame in range(20):
        start = 0.1 * frame
        for number, stage in enumerate(STAGES):
            begin = start + 0.03 * number
            timeline.add(Span(stage, frame, begin, begin + 0.03))
        timeline.add_result(frame, start, start + 0.09)
    timeline.drop("processing", 3)
    summary = timeline.summary()
    assert summary["fps"] == pytest.approx(10, abs=0.01) and summary["results"] == 20
    assert summary["latency_ms"] == {"mean": 90.0, "p95": 90.0, "max": 90.0}
    assert summary["latency_frames"] == pytest.approx(0.9)
    assert summary["dropped"] == {ACQUISITION: 0, "processing": 1, "tracking": 0}
    timeline.plot(tmp_path / "timeline.png")
    picture = cv2.imread(str(tmp_path / "timeline.png"))
    coloured = np.ptp(picture.astype(int), axis=-1) > 60
    assert 0.05 < coloured.mean() < 0.8
    Timeline(STAGES).plot(tmp_path / "empty.png")  # a run without results has one, too


SIZES = LiveConfig()


def count_evaluations(method: Method) -> int:
    """Return how many poses the search of one frame evaluates."""
    return method.filter.search.n_particles * method.filter.search.n_layers


def test_a_search_of_any_size() -> None:
    counts = [SIZES.fewest, 900, 3000, SIZES.most]
    sizes = [resize_search(Method.create("pso", "sp"), count) for count in counts]
    np.testing.assert_allclose([count_evaluations(size) for size in sizes], counts, rtol=0.15)
    n_layers = [size.filter.search.n_layers for size in sizes]
    assert n_layers[0] >= 6 and n_layers[1] < n_layers[2] and n_layers[3] <= 15
    assert resize_search(Method.create("sir", "sp"), 2000).filter.search.n_layers == 1
    sizes = list_sizes(Method())
    counts = [count_evaluations(size) for size in sizes]
    assert counts == sorted(counts)
    np.testing.assert_allclose(counts[:: len(counts) - 1], [SIZES.fewest, SIZES.most], rtol=0.1)
    trunk = [m.filter.search.trunk_layers / m.filter.search.n_layers for m in sizes]
    assert all(0.25 < share < 0.4 for share in trunk)


COSTS = [0.01, 0.02, 0.03, 0.04]


def test_the_search_takes_what_processing_leaves_and_shrinks_and_grows() -> None:
    assert Governor(0.06, COSTS, 0.02).chosen == 2  # 0.85 * 0.06 - 0.02
    assert Governor(0.06, COSTS, 0.02, overlaps=True).chosen == 3
    assert Governor(0.03, COSTS, 0.025).chosen == 0  # there is nothing smaller
    # Without a rate to be kept it may take as long as the processing.
    assert Governor(0.03, COSTS, 0.025, generous=True).chosen == 1
    assert Governor(1.0, COSTS, 0.02, generous=True).chosen == 3
    # What takes too long shrinks, and grows again.
    governor = Governor(0.05, COSTS, 0.01)

    def chosen_after(slower: float, processing: float = 0.01) -> int:
        """The search chosen after many frames that took so many times their cost."""
        for _ in range(40):
            governor.update(processing, slower * COSTS[governor.chosen])
        return governor.chosen

    assert governor.chosen == 2
    assert chosen_after(1.1) == 2
    assert chosen_after(2.0) == 0  # as on a busy machine
    assert chosen_after(1.0) == 1
    assert chosen_after(0.9, processing=0.0) == 2
    # One size is never left.
    single = Governor(0.05, COSTS[-1:], 0.01)
    assert not any(single.update(0.01, seconds) for seconds in (5.0, 1e-6) for _ in range(30))
