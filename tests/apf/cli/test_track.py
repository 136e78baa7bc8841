"""`apf track` from the command line: what it writes, and what it says of bad input."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from helpers.commands import fail, succeed

from apf.body.toml import load_body
from apf.cli.batch import make_jobs
from apf.evaluation.evaluate import evaluate
from apf.evaluation.truth import load_truth
from apf.request import BatchRequest
from apf.tracking.track import Track
from psfs.output.video import count_frames

FRAMES = 3
SMALL = ["--particles", "60", "--layers", "5", "--voxel-size", "0.04"]
FEW = ["--frames", "0:3", "--no-overlay", "--no-report"]


def track(folder: Path, out: Path, *more: str) -> list[str]:
    truth = ["--init", str(folder / "truth.npz")]
    return ["apf", "track", str(folder), "-o", str(out), *SMALL, *truth, *more]


def test_all_is_written_and_judged_and_reports_made_again(walk: Path, tmp_path: Path) -> None:
    """The last lines say what summary.json holds; `apf report` gives the same again."""
    out = tmp_path / "out"
    said = succeed(*track(walk, out, "--frames", f"0:{FRAMES}")).out.splitlines()
    names = {path.name for path in out.iterdir()}
    assert names == {
        "manifest.txt", "track.npz", "joints.trc", "joints.csv", "body.toml", "start.txt",
        "settings.toml", "overlay.mp4", "summary.json", "report.html",
    }  # fmt: skip
    found = Track.open(out)
    assert len(found) == FRAMES and found.poses.shape == (FRAMES, 32)
    assert found.diagnostics["ess"].shape == (FRAMES, 5)
    assert json.loads(found.provenance)["filter"]["n_particles"] == 60
    assert evaluate(found, load_truth(walk / "truth.npz")).mean_error < 0.08
    assert load_body(out / "body.toml").joint_names == list(found.joint_names)
    assert count_frames(out / "overlay.mp4") == FRAMES

    summary = json.loads((out / "summary.json").read_text())
    assert said[-1] == f"wrote {', '.join(summary['files'])}"
    assert said[1:-1] == summary["says"] and said[1].startswith("the track l")
    assert names - {"manifest.txt"} == set(summary["files"])
    assert summary["complete"] and summary["frames"] == FRAMES
    assert set(summary["quality"]["body_iou"]) == {"cam01", "cam02", "cam03", "cam04"}
    assert summary["body"]["height_m"] == pytest.approx(1.75, abs=0.15)

    page = (out / "report.html").read_bytes()
    (out / "report.html").unlink()
    (out / "overlay.mp4").unlink()
    said = succeed("apf", "report", out).out
    assert said.splitlines()[-1] == f"wrote {out / 'report.html'}"
    again = json.loads((out / "summary.json").read_text())
    assert again["quality"] == summary["quality"]
    assert (out / "overlay.mp4").exists()
    # the encoder of the video in the page does not promise the same bytes
    assert len((out / "report.html").read_bytes()) == pytest.approx(len(page), rel=1e-3)


def test_several_seeds_at_once(walk: Path, tmp_path: Path) -> None:
    """Each as alone, so that the same seed gives the same track and another one another, in a
    folder of its own; how far they differ and err is said."""
    said = succeed(*track(walk, tmp_path / "all", *FEW, "--seed", "3", "--seeds", "2")).out
    assert "2 runs: joints lie" in said and "mean error:" in said
    succeed(*track(walk, tmp_path / "alone", *FEW, "--seed", "4"))
    folders = ("all/seed3", "all/seed4", "alone")
    other, together, alone = (Track.open(tmp_path / name) for name in folders)
    np.testing.assert_array_equal(together.poses, alone.poses)
    assert together.provenance == alone.provenance
    assert np.any(other.poses != alone.poses)


def test_a_body_of_frusta_and_a_mesh_of_the_person(walk: Path, tmp_path: Path) -> None:
    box = trimesh.creation.box((0.3, 0.5, 1.7)).subdivide().subdivide()
    box.vertices[:, 2] += 0.85
    box.export(tmp_path / "box.ply")
    few = ["--method", "pso", "--objective", "sp", "--body", "song31", *FEW]
    succeed(*track(walk, tmp_path / "mesh", *few, "--shape", f"{tmp_path}/box.ply"))
    again = ["--config", str(tmp_path / "mesh" / "settings.toml"), "-o", str(tmp_path / "again")]
    succeed("apf", "track", str(walk), *again, "--shape", "18")  # a flag beats the file
    mesh, frusta = (Track.open(tmp_path / name) for name in ("mesh", "again"))
    assert not np.array_equal(mesh.poses, frusta.poses)
    looks = [json.loads(found.provenance)["image"] for found in (mesh, frusta)]
    assert [look["mesh_file"] for look in looks] == [str(tmp_path / "box.ply"), ""]
    assert [look["vertices_per_part"] for look in looks] == [4, 18]
    for flags, message in (
        (["--shape", "no.ply"], "no.ply: no such file; expected a mesh"),
        (["--shape-pose", "rest.txt"], "--shape-pose applies only to a mesh"),
        (["--shape", "8", "--objective", "voxel"], "--shape applies only to image objectives"),
    ):
        assert message in fail(*track(walk, tmp_path / "bad", *few, *flags))


def test_takes_are_a_batch(walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[BatchRequest] = []
    monkeypatch.setattr("apf.cli.batch.run", asked.append)
    days = [tmp_path / day / "walk" for day in ("monday", "tuesday")]
    for day in days:
        shutil.copytree(walk, day)
    words = [*map(str, days), "-o", str(tmp_path / "out"), "--particles", "40"]
    succeed("apf", "track", *words)
    assert asked[0].to == ()
    jobs = make_jobs(asked[0])
    assert [job.name for job in jobs] == ["monday_walk", "tuesday_walk"]
    assert jobs[0].request.method.filter.search.n_particles == 40


def test_what_several_takes_cannot_be_asked(walk: Path, tmp_path: Path) -> None:
    words = [str(walk / "videos"), "--init", str(walk / "truth.npz")]
    lines = fail("apf", "track", walk, *words, "-o", tmp_path / "out").strip().splitlines()
    assert len(lines) == 1 and "--init is the first pose of one take" in lines[0], lines
    assert not (tmp_path / "out").exists()
