"""What is reported of timings: the results' files, the papers' figures, the page made of them."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers.shared import ROOT

sys.path.insert(0, str(ROOT / "scripts"))

from timings.bench_scene import Scene
from timings.measure import Limits, Timing
from timings.report.laws import karp_flatt
from timings.report.limits import serial_share
from timings.report.machines import read_batches, read_machines
from timings.report.page import write_report
from timings.report.readme import update_page
from timings.results import Results, read_results
from timings.stages import PARTS, find_stage
from timings.streamed_cues import make_sightings
from timings.tables.grid import number
from timings.tables.objective import ROWS, columns
from timings.tables.whole import papers, table_3
from timings.whole_frame import Problem, WholeFrame, sequence_run, stage_times, stream_run

from apf.body import load_body
from apf.filters.config import FilterConfig
from apf.filters.term_weights import KEYPOINTS_ON
from apf.initialisation.from_joints import fit_to_joints
from apf.synthetic.render import SyntheticScene
from apf.synthetic.scene import SceneConfig
from cl import Device, InputError, NumpyDevice
from psfs.background.gaussian import Background
from psfs.sequence import Frame


def arguments(folder: Path, **changes: Any) -> argparse.Namespace:
    given = {"out": folder, "quick": True, "seconds": None, "resume": False, "commit": "abc"}
    return argparse.Namespace(**{**given, **changes})


def times(ms: float, n: int) -> Timing:
    return Timing(tuple(ms + 0.01 * k for k in range(n)))


def column(kind: str, label: str, cores: int | None, ms: float, n: int) -> dict[str, Any]:
    run = {"frames": times(ms, n), "error_mm": 25.0, "surface_voxels": 9000.0}
    if kind == "numpy":
        run["parts"] = {part: times(ms / 3, n) for part in ("reconstruction", "colour", "tracking")}
    made = {"label": label, "kind": kind, "cores": cores, "setup_ms": 900.0,
            "first_frame_ms": 2 * ms, "runs": [run] * 3}  # fmt: skip
    if kind != "numpy":
        made["to_pose"] = {"frames": times(ms / 2, 5), "error_mm": 26.0}
        made["to_cloud"] = {"frames": times(ms, 5), "error_mm": 26.0}
    return made


def measured(folder: Path) -> Path:
    """A folder with results as `compare_timings.py whole` writes them, of made-up times."""
    settings = {"views": 8, "shape": (150, 150, 100), "repetitions": {"opencl": 3, "numpy": 3},
                "filter": {"n_particles": 200, "n_layers": 10}}  # fmt: skip
    results = Results.begin("whole", arguments(folder), settings)
    results.environment["devices"] = [
        {"name": "Some GPU", "platform": "CUDA", "driver": "1", "kind": "gpu", "compute_units": 9},
        {"name": "cpu-x", "platform": "PoCL", "driver": "3", "kind": "cpu", "compute_units": 4},
    ]
    cpu = "cpu-x, 4 cores"
    for kind, label, cores, ms, n in (
        ("gpu", "Some GPU", None, 8.0, 200), ("cpu", cpu, 4, 160.0, 200),
        ("cpu", "cpu-x, 1 core", 1, 400.0, 50), ("numpy", "NumPy, 1 thread", 1, 8000.0, 3),
    ):  # fmt: skip
        made = column(kind, label, cores, ms, n)
        results.section(f"column {'NumPy' if kind == 'numpy' else label}", lambda made=made: made)
    for label, ms in (("Some GPU", 0.5), (cpu, 10.0)):
        stages = {stage: times(ms, 5) for names in PARTS.values() for stage in names}
        section = {"label": label, "limits": Limits(1e11, 1e12), "stages": stages,
                   "work": {"occupancy": (1e7, 5e8), "upload": (7e6, 0)}}  # fmt: skip
        results.section(f"stages {label}", lambda section=section: section)
        for what, values in (("shape", [(75, 75, 50), (150, 150, 100)]), ("cameras", [2, 8]),
                             ("n_particles", [50, 200]), ("n_layers", [1, 10])):  # fmt: skip
            rows = [{"value": value, "frames": times(ms, 3)} for value in values]
            results.section(f"scaling {what}, {label}", lambda rows=rows: rows)
    return folder


def test_every_column_of_songs_table_4_has_the_mean_that_table_2_prints() -> None:
    song = papers()["song2012"]["tables"]
    per_frame = np.array(song["4"]["rows"], dtype=float)
    assert np.array_equal(per_frame[:, 0], np.arange(1, 201))
    printed = [run for row in (0, 1, 3) for run in song["2"]["rows"][row][1:4]]
    # The last run lacks a frame that is not legible.
    np.testing.assert_allclose(np.nanmean(per_frame[:, 1:], 0), printed, rtol=4e-5)
    averages = {name: average for name, *_, average in song["2"]["rows"]}
    ratios = {name: final for name, _, final in song["3"]["rows"]}
    assert ratios["GPU / CPU"] == pytest.approx(averages["CPU"] / averages["GPU (final)"], rel=1e-5)


def test_the_parts_of_the_thesis_table_6_7_add_up() -> None:
    rows = papers()["rymut2016"]["tables"]["6.7"]["rows"]
    for particles in (96, 304, 512):
        mine = [row for row in rows if row[1] == particles]
        parts = np.array([row[2:] for row in mine if not row[0].startswith("g")], dtype=float)
        total = next(row[2:] for row in mine if row[0].startswith("g"))
        np.testing.assert_allclose(np.nansum(parts, 0), total, atol=0.021)


def test_results_come_back_from_their_file_as_they_were(tmp_path: Path) -> None:
    results = Results.begin("whole", arguments(tmp_path), {"shape": (1, 2)})
    value = {"a": Timing((3.0, 1.0, 2.0)), "limits": Limits(1.0, 2.0), "n": np.int64(4)}
    results.section("one", lambda: value)
    back = read_results(tmp_path / "whole.json")
    assert back.sections == {"one": {**value, "n": 4}}
    assert back.settings == {"shape": [1, 2], "quick": True}
    assert (back.sections["one"]["a"].median, back.sections["one"]["a"].least) == (2.0, 1.0)


def test_what_is_missing_is_told_and_measured_when_resumed(tmp_path: Path) -> None:
    def absent() -> None:
        raise ModuleNotFoundError("No module named 'open3d'")

    results = Results.begin("psfs", arguments(tmp_path), {})
    assert results.section("mine", lambda: 1) == 1
    assert results.section("open3d", absent) is None
    assert results.section("growth", lambda: 5, quick=False) is None
    assert results.left_out["growth"] == "not with --quick"
    late = Results.begin("psfs", arguments(tmp_path, resume=True, seconds=-1.0), {})
    assert late.section("late", lambda: 2) is None
    assert late.left_out["late"].startswith("no time left")
    resumed = Results.begin("psfs", arguments(tmp_path, resume=True), {})
    assert resumed.section("mine", lambda: 3) == 1
    assert resumed.section("open3d", lambda: 4) == 4
    assert resumed.left_out == {}
    with pytest.raises(InputError, match=r"settings is .*; expected"):
        Results.begin("psfs", arguments(tmp_path, resume=True), {"views": 3})


@pytest.mark.parametrize("text", ["", "[]", '{"schema": 1}'])
def test_a_file_that_is_no_results_is_told(tmp_path: Path, text: str) -> None:
    (tmp_path / "whole.json").write_text(text)
    with pytest.raises(InputError, match=r"whole\.json: .*results of compare_timings"):
        read_machines([tmp_path])


@pytest.fixture
def empty_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are empty files, in a fifth of the time: `whole_report` has them drawn."""

    def write(figure: Any, path: Path) -> None:
        plt.close(figure)
        path.parent.mkdir(exist_ok=True)
        path.touch()

    monkeypatch.setattr("timings.report.figures.write_figure", write)


@pytest.mark.usefixtures("empty_figures")
def test_the_page_has_the_papers_tables_with_both_figures(tmp_path: Path) -> None:
    machines = read_machines([measured(tmp_path / "some")])
    write_report(machines, tmp_path)
    text = (tmp_path / "report.md").read_text()
    for heading in ("Song table 1", "Song table 2", "Song table 3", "Song table 4", "Roofline"):
        assert f"### {heading}\n" in text
    assert "84.845207" in text  # Song's GPU
    assert "| OpenCL GPU, Some GPU | 9.00 | 9.00 | 9.00 | 9.00 | 200 | 111 | 9,000 |" in text
    assert "399.2868 x" in text
    streamed = "OpenCL GPU, Some GPU, streamed, without colour and download of voxels"
    assert f"| {streamed} | 4.02 | 4.01 | 4.03 | 5 | 249 | 26.0 |" in text
    assert "specification), streamed" not in text
    assert "44.5 x as fast as OpenCL CPU, one core (Song et al., GPU / CPU: 399 x), 17.9 x" in text
    assert (
        "OpenCL CPU, 4 cores (Song et al., GPU / CPU+TBB (4 cores): 113 x), 889 x as fast" in text
    )
    assert "NumPy, one thread (an unoptimised specification). Medians." in text
    rows = {row[0]: row[1] for row in table_3(machines[0].results["whole"]).rows}
    assert rows["OpenCL CPU, 4 cores : OpenCL CPU, one core"] == "2.49 x"
    assert {path.stem for path in (tmp_path / "figures").iterdir()} == {
        "headline", "per_frame", "stages", "amdahl", "roofline", "scaling",
    }  # fmt: skip


def thesis(folder: Path) -> None:
    """Made-up results of `methods` and `objective`, as an ended run leaves them."""
    gpu = {"label": "Some GPU", "cores": None}
    methods = Results.begin("methods", arguments(folder), {"iterations": 10})
    swarm = [{"search": "pso", "particles": n, "frames": times(n / 100, 5), "error_mm": 20.0}
             for n in (100, 300)]  # fmt: skip
    curve = [{"iterations": i, "particles": n, "frames": times(i, 5), "errors_mm": [20.0, 30.0]}
             for i in (5, 10) for n in (100, 300)]  # fmt: skip
    share = [{"particles": 100, "search": times(4.0, 1), "without": times(1.0, 1)}]
    online = [{"particles": 100, "frames": times(40.0, 3), "offline_mm": 20.0, "online_mm": 33.0,
               "share": 0.5}]  # fmt: skip
    planned = {"frames Some GPU": swarm, "opengl frames Some GPU": swarm, "accuracy": swarm,
               "shares opencl, Some GPU": share, "online Some GPU": online,
               "curves Some GPU": curve}  # fmt: skip
    for name, rows in planned.items():
        made = {**gpu, "rows": rows, "renderer": "opencl"}
        methods.plan(name, lambda made=made: made)

    def ended() -> None:
        raise KeyboardInterrupt

    methods.plan("shapes Some GPU", ended)
    with pytest.raises(KeyboardInterrupt):
        methods.measure()
    objective = Results.begin("objective", arguments(folder), {
        "hypotheses": [96], "views": 4, "group_hypotheses": 512, "frames": 3})  # fmt: skip
    kernels = {name: times(0.1, 3) for name in ("pose_cones", "place_parts", "count_pixels")}
    total = {"hypotheses": 96, "total": times(1.0, 3), "whole": times(0.9, 3)}
    parts = ("matrices", "upload", "rendering", "download", "objective")
    by_opengl = {part: times(0.2, 3) for part in parts} | {"total": times(1.5, 3)}
    made = {
        "device Some GPU": {**gpu, "rows": [{**total, "kernels": kernels}]},
        "opengl Some GPU": {**gpu, "renderer": "GL", "rows": [{**total, "parts": by_opengl}]},
        "numpy": {"hypotheses": 8, "matrices": 1.0, "rendering": 90.0, "objective": 9.0},
        "groups of OpenGL, Some GPU": {**gpu, "rows": [{"group": "8 x 8", "frames": times(1, 3)}]},
    }
    for name, section in made.items():
        objective.plan(name, lambda section=section: section)
    objective.measure()


@pytest.fixture(scope="module")
def whole_report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of the machine `some`, with the thesis, and of the takes per minute of `two`."""
    folder = tmp_path_factory.mktemp("report")
    folders = [measured(folder / "some"), folder / "two"]
    thesis(folder / "some")
    takes(folder / "two", 2)
    machines, batches = read_machines(folders), read_batches(folders)
    assert [m.name for m in machines] == ["some"] and [m.name for m in batches] == ["two"]
    write_report(machines, folder, batches)
    return folder


def test_the_thesis_beside_ours_and_what_an_ended_run_lacks(whole_report: Path) -> None:
    machines = read_machines([whole_report / "some"])
    text = (whole_report / "report.md").read_text()
    assert text.count("methods, shapes Some GPU: not reached; --resume measures it._") == 2
    assert "_Missing: Some GPU with" in text
    assert "`compare_timings.py psfs` was not run" in text
    for figure in ("swarm_curves", "objective_shares", "work_groups", "online"):
        assert (whole_report / "figures" / f"{figure}.svg").stat().st_size > 10_000
    assert "| 100 | 25.0 | 25.0 | 199 | 99.8 |" in text  # curves
    assert "| 100 | 4.00 | 1.00 | 75% |" in text  # shares
    assert "| 100 | 40.0 [40.0, 40.0] | 20.0 | 33.0 | 50% |" in text  # online
    results = machines[0].results["objective"]
    for name, column in columns(results, 96).items():
        parts = sum(column.get(part, 0.0) for part in list(ROWS)[:6])
        assert parts == pytest.approx(column["total"]), name
    assert set(columns(results, 96)) == {
        "NumPy (an unoptimised specification)", "OpenCL Some GPU", "OpenCL Some GPU + OpenGL GL",
    }  # fmt: skip
    assert "| overall time | 1,200 | 1.01 | 1.51 |" in text


def test_no_two_rows_share_a_label() -> None:
    """In all tables of the report in this repository."""
    text = (ROOT / "scripts" / "results" / "report.md").read_text()
    tables = [block.splitlines() for block in text.split("\n\n") if block.startswith("|")]
    assert len(tables) > 30
    # Columns that a row's label may go on in.
    more = {"program", "variant", "voxels", "cameras", "kernel", "particles", "iterations",
            "comparison", "section", "vertices", "vertices per part"}  # fmt: skip
    for heads, _, *rows in tables:
        names = heads.split(" | ")
        n = 1
        while n < len(names) and names[n] in more:
            n += 1
        labels = [tuple(row.split(" | ")[:n]) for row in rows]
        assert len(set(labels)) == len(labels), (heads, labels)


def takes(folder: Path, n_gpus: int) -> None:
    """Made-up takes per minute, those of two GPUs left out."""
    results = Results.begin("batch", arguments(folder), {})
    gpu = {"name": "Some GPU", "platform": "CUDA", "driver": "1", "kind": "gpu"}
    results.environment["devices"] = [{**gpu, "compute_units": 9}] * n_gpus
    results.environment["cores"] = 4
    row = {"workers": 1, "gpus": 1, "takes": 4, "frames_per_s": 8.0, "stages": {"reading": 2.0},
           "core_s": 30.0}  # fmt: skip
    for n, rate in ((1, 10.0), (2, 19.0)):
        of = {**row, "per_minute": rate}
        results.section(f"workers 1 GPU, {n} at once", lambda of=of: of)
    results.section("decoding", lambda: {"frames": 3, "ms": 1.0, "core_ms": 5.0})
    results.section("workers 2 GPUs, 2 at once", lambda: 1, quick=False)


def test_takes_per_minute_also_of_a_machine_measured_for_them_alone(whole_report: Path) -> None:
    text = (whole_report / "report.md").read_text()
    assert "### 2 x Some GPU with " in text
    assert "| 1 GPU, 2 at once | 4 | 19.0 | 8.00 | 1.90 x | 190 % | 30.0 | 9.50 |" in text
    assert "_Missing: 2 x Some GPU" in text and "workers 2 GPUs, 2 at once: not with" in text
    assert "4 cores: `compare_timings.py batch` was not run._" in text


@pytest.mark.usefixtures("empty_figures")
def test_what_was_not_measured_is_left_out_of_the_page(tmp_path: Path) -> None:
    results = Results.begin("whole", arguments(tmp_path / "some"), read_results(
        measured(tmp_path / "full") / "whole.json").settings)  # fmt: skip
    results.section("column cpu", lambda: column("cpu", "cpu-x, 4 cores", 4, 160.0, 5))
    results.left_out["scaling shape, cpu-x, 4 cores"] = "no time left; --resume measures it"
    results.write()
    write_report(read_machines([tmp_path / "some"]), tmp_path)
    text = (tmp_path / "report.md").read_text()
    assert "_Not measured._" in text
    assert "scaling shape, cpu-x, 4 cores | no time left" in text
    assert not (tmp_path / "figures" / "scaling.svg").exists()
    (tmp_path / "some" / "whole.json").unlink()
    Results.begin("psfs", arguments(tmp_path / "some"), {}).write()
    with pytest.raises(InputError, match=r"no columns in whole\.json"):
        read_machines([tmp_path / "some"])


def test_the_readmes_table_is_made_between_its_marks(tmp_path: Path) -> None:
    machines = read_machines([measured(tmp_path / "some")])
    readme = tmp_path / "README.md"
    readme.write_text("before\n<!-- timings: begin -->\nold\n<!-- timings: end -->\nafter\n")
    update_page(readme, machines)
    text = readme.read_text()
    assert text.startswith("before\n")
    assert text.endswith("\nafter\n")
    assert "old" not in text
    assert "OpenCL GPU, Some GPU | 9.00 |" in text
    shown = "OpenCL GPU, Some GPU, streamed, coloured voxels downloaded | 8.02 | 125 | 49.9 x | 5 |"
    assert shown in text
    assert (
        "NumPy, one thread (an unoptimised specification) | 8,000 | 0.125 | 0.0500 x | 6 |" in text
    )
    assert "Medians; Song et al.'s are means." in text
    update_page(readme, machines)
    assert readme.read_text() == text
    readme.write_text("no marks")
    with pytest.raises(InputError, match="expected <!-- timings: begin -->"):
        update_page(readme, machines)


def test_amdahls_serial_share_is_found() -> None:
    times = [(n, 80.0 * (0.3 + 0.7 / n)) for n in (1, 2, 4, 16)]
    assert serial_share(times) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "-"), (0.0, "0"), (0.00916, "0.00916"), (9.996, "10.0"), (33877.57, "33,900"),
     (84.845, "84.8"), (1.0, "1.00")],
)  # fmt: skip
def test_numbers_are_shown_with_three_digits(value: float | None, text: str) -> None:
    assert number(value) == text


def small_problem(device: Device) -> Problem:
    """Two frames of a walk before three small cameras."""
    walk = SyntheticScene(SceneConfig(cameras=3, frames=2, size=(160, 120)), device)
    plates = np.stack([walk.background_frame(i) for i in range(6)]).astype(np.float32)
    frames = [Frame(i, *walk.frame(i)[:2]) for i in range(2)]
    background = Background(plates.mean(0), plates.std(0))
    scene = Scene(walk.rig, background, frames, walk.people_joints, tuple(walk.joint_names))
    joints = dict(zip(walk.joint_names, walk.joints[0], strict=True))
    body, pose, _ = fit_to_joints(load_body("song31"), joints)
    return Problem(scene, body, pose, FilterConfig.create(n_particles=30, n_layers=2), (50, 50, 33))


def test_the_whole_frame_on_the_device_agrees_with_the_twins(device: Device) -> None:
    problem = small_problem(device)
    ours = sequence_run(WholeFrame(device, problem), 2)
    twins = sequence_run(WholeFrame(NumpyDevice(), problem), 2)
    assert len(ours["frames"].samples) == len(twins["frames"].samples) == 2
    assert ours["surface_voxels"] == pytest.approx(twins["surface_voxels"], rel=0.02)
    assert ours["error_mm"] == pytest.approx(twins["error_mm"], abs=25)
    held = problem.scene.pin(device)
    streamed = stream_run(WholeFrame(device, problem), held, 3)
    assert len(streamed["frames"].samples) == 3 and min(streamed["frames"].samples) > 0
    assert streamed["error_mm"] == pytest.approx(ours["error_mm"], abs=25)
    with_keypoints = WholeFrame(device, problem.smaller(**KEYPOINTS_ON))
    seen = stream_run(with_keypoints, held, 3, sightings=make_sightings(problem))
    assert seen["error_mm"] != streamed["error_mm"]
    assert seen["error_mm"] < streamed["error_mm"] + 25
    profiled = Device(device.handle, profile=True)
    stages = stage_times(WholeFrame(profiled, problem), 1, warm_up=1)
    busy = {"silhouette", "occupancy", "smoothing", "surface", "colour", "reprojection",
            "likelihood", "annealing", "refinement", "download"}  # fmt: skip
    assert busy <= set(stages)
    assert find_stage("score_poses") == "likelihood"
    assert find_stage("a kernel of another project") == "other"


def test_karp_flatt_finds_the_serial_share_of_amdahls_law() -> None:
    for share in (0.0, 0.1, 0.5):
        for cores in (2, 16):
            gain = 1 / (share + (1 - share) / cores)
            assert karp_flatt(gain, cores) == pytest.approx(share, abs=1e-12)
