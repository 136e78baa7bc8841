"""Files in the place of folders and the other way round, files of the user in the way, tracks and
clouds that belong to something else, flags that go with nothing."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from helpers import tracks
from helpers.commands import succeed
from helpers.faults import BOX, changed_npz, refused

INFO = ["psfs", "info", "walk", "--no-pictures"]
TRACK = ["apf", "track", "seq", "-o", "new", *BOX, "--init", "pose.txt", "--particles", "40"]
REPORT = ["apf", "report", "full", "--no-overlay"]
BATCH = ["apf", "batch", "takes.toml", "-o", "new", "--workers", "1"]
SYNTH = ["apf", "synth", "-o", "new", "--frames", "2", "--cameras", "2", "--size", "64x48"]
LIVE = ["apf", "live", "walk", "-o", "new", "--init", "pose.txt", "--captures", "a", "b", "c"]


@pytest.fixture(scope="module")
def larger(original: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stock, and full/: what `apf track` made of seq/."""
    folder = Path(shutil.copytree(original, tmp_path_factory.mktemp("places") / "stock"))
    words = [str(folder / w) if w in ("seq", "pose.txt") else w for w in TRACK]
    words[4] = str(folder / "full")
    succeed(*words, "--layers", "2", "--no-overlay", "--no-report")
    return folder


@pytest.fixture
def stock(larger: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it, which is the folder one is in."""
    folder = Path(shutil.copytree(larger, tmp_path / "stock"))
    for summary in folder.rglob("summary.json"):  # which name the sequence in full
        summary.write_text(summary.read_text().replace(str(larger), str(folder)))
    monkeypatch.chdir(folder)
    return folder


Change = Callable[[Path], Any]


def file(name: str, content: bytes | str = "mine") -> Change:
    """Put a file in the place of whatever is there."""

    def change(stock: Path) -> None:
        path = stock / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            shutil.rmtree(path)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())

    return change


def folder(name: str) -> Change:
    """Put a folder in the place of whatever is there."""

    def change(stock: Path) -> None:
        (stock / name).unlink(missing_ok=True)
        (stock / name).mkdir(parents=True)

    return change


def gone(name: str) -> Change:
    return lambda stock: [path.unlink() for path in stock.glob(name)]


def takes(line: str) -> Change:
    """A list of one take."""
    return file("takes.toml", f"[[take]]\nfolder = 'walk'\n{line}")


def only_videos(stock: Path) -> None:
    (stock / "walk").rename(stock / "whole")
    (stock / "whole/videos").rename(stock / "walk")


def two_calibrations(stock: Path) -> None:
    first = (stock / "walk/calibration.toml").rename(stock / "walk/calib1.toml")
    shutil.copy(first, stock / "walk/calib2.toml")


def grid(**values: Any) -> Change:
    right = {"origin": [0.0, 0.0, 0.0], "voxel_size": 0.1, "shape": [5, 5, 5]}
    text = json.dumps({"grid": {**right, **values}})
    return lambda stock: changed_npz(stock / "full/track.npz", provenance=np.array(text))


def arrays(name: str, **values: Any) -> Change:
    return lambda stock: changed_npz(stock / name, **values)


def frames(number: int) -> Change:
    return lambda stock: tracks.walker(number).save(stock / "track/track.npz")


def summary(out: str, *place: str, **values: Any) -> Change:
    def change(stock: Path) -> None:
        path = stock / out / "summary.json"
        document = table = json.loads(path.read_text())
        for step in place:
            table = table[step]
        table.update(values)
        path.write_text(json.dumps(document))

    return change


def true_mask(stock: Path) -> None:
    (stock / "seq/truth_masks").mkdir()
    cv2.imwrite(str(stock / "seq/truth_masks/c3_000001.png"), np.zeros((9, 9), np.uint8))


def edited(name: str, old: str, new: str, into: str = "") -> Change:
    """Replace a text in a file, or in a copy of it."""

    def change(stock: Path) -> None:
        text = (stock / name).read_text()
        assert old in text
        (stock / (into or name)).write_text(text.replace(old, new, 1))

    return change


#: Words, what is done to the stock before, and what the line says.
FAULTS: dict[str, tuple[list[str], Change | None, str]] = {
    "a folder as a calibration": (INFO, folder("walk/calibration.toml"), "calibration.toml"),
    "nothing in a folder": (["psfs", "info", "new"], folder("new"), "no sequence is recognised"),
    "no calibration": (INFO, gone("walk/calibration.toml"), "no calibration"),
    "videos alone": (INFO, only_videos, "no calibration; expected calibration.toml"),
    "no pictures": (INFO, gone("walk/videos/*"), "no pictures"),
    "3 cameras for 2 videos": (INFO, gone("walk/videos/cam01.mp4"), "for 3 cameras"),
    "a background is missing": (INFO, gone("walk/background/cam01.mp4"), "background"),
    "malformed settings": (INFO, file("walk/sequence.toml", "up = "), "sequence.toml: malf"),
    "no masks": (INFO, file("walk/sequence.toml", "background = 'masks'"), "needs masks"),
    "no threshold": (INFO, file("walk/sequence.toml", "background='threshold'"), "`threshold`"),
    "two calibrations": (INFO, two_calibrations, "several calibrations (calib1.toml, calib2.toml)"),
    "a file as videos/": (INFO, file("walk/videos"), "walk"),
    "a camera shifted twice": ([*INFO, "--sync", "cam01=1,cam01=2"], None, "each camera once"),
    "settings of another command": ([*INFO, "--config", "c.toml"], file("c.toml", "debris = 1"),
                                    "debris"),
    "a sheet over the calibration": ([*INFO[:3], "--masks", "walk/calibration.toml"], None,
                                     "calibration.toml"),
    "a log in a folder's place": ([*INFO, "--log-file", "seq"], None, "seq"),
    "converted into itself": (["psfs", "convert", "walk", "-o", "walk/videos"], None, "videos"),
    "a file as clouds/": (["psfs", "reconstruct", "seq", "-o", "new", *BOX], file("new/clouds"),
                          "new/clouds"),
    "a cloud elsewhere": (["psfs", "check", "out", "-q"],
                          arrays("out/clouds/frame_000001.npz", origin=np.full(3, 5.0)),
                          "frame_000001.npz"),
    "a summary of another grid": (["psfs", "check", "out", "-q"],
                                  summary("out", "grid", origin_m=[1.0, 0.0, 0.0]), "frame_00000"),
    "a true mask of another size": (["psfs", "silhouettes", "seq", "-o", "new", "-q"], true_mask,
                                    "c3_000001.png"),
    "a run without its footage": (["psfs", "check", "out"], summary("out", "sequence",
                                  absolute="/gone", relative="gone"), "/gone is gone"),
    "settings of another version": (["psfs", "mesh", "out"], summary("out", "config", "silhouette",
                                    magic=1), "silhouette.magic: no such setting"),
    "a mesh over a cloud": (["psfs", "mesh", "out", "-o", "out/clouds/frame_000001.ply"], None,
                            "frame_000001.ply"),
    "a report of the user": ([*TRACK, "--layers", "2"], file("new/report.html"), "report.html"),
    "a track as keypoints": ([*TRACK, "--keypoints", "track/track.npz"], None, "track.npz"),
    "names twice in a truth": (["apf", "evaluate", "track", "--truth", "truth.npz"],
                               arrays("truth.npz", joint_names=np.array(["pelvis"] * 15)),
                               "truth.npz"),
    "a grid at NaN": (REPORT, grid(origin=[0.0, 0.0, float("nan")]), "full/track.npz"),
    "a huge grid": (REPORT, grid(shape=[99999, 99999, 99999]), "full/track.npz"),
    "numbers as warnings": (REPORT, summary("full", warnings=[1, 2]), "summary.json"),
    "a report without a sequence": (REPORT, summary("full", "sequence", absolute="/no/where",
                                                    relative="nowhere"), "/no/where"),
    "an empty track smoothed": (["apf", "smooth", "track", "-o", "new"], frames(0), "no tracked"),
    "weights without a mesh": (["apf", "render", "walk", "track", "-o", "new", "--shape-weights",
                                "truth.npz"], None, "--shape FILE"),
    "a run and a track exchanged": (["apf", "view", "track", "out"], None, "out"),
    "a negative time of emptiness": ([*LIVE, "--empty", "-3"], None, "--empty"),
    "keypoints of nobody": ([*LIVE, "--objective", "keypoints"], None, "apf live reads none"),
    "a truth in synth's way": (SYNTH, file("new/truth.npz"), "new/truth.npz"),
    "an empty list of takes": (BATCH, file("takes.toml", ""), "takes.toml"),
    "NUL in a list of takes": (BATCH, file("takes.toml", '[[take]]\nfolder = "a\\u0000b"'),
                               "holds the character NUL"),
    "a take outside": (BATCH, takes("name = '../x'"), "'../x'"),
    "a name that is no UTF-8": (["apf", "batch", "a\udcff", "-o", "new", "--workers", "1"],
                                lambda stock: (stock / "walk").rename("a\udcff"), r"a\udcff"),
    **{f"a take named {name}": (BATCH, takes(f"name = '{name}'"), name)
       for name in ("logs", "index.html", "takes.csv", "manifest.txt")},
    **{line: (BATCH, takes(line), "is no setting of apf track")
       for line in ("frob=3", "output='/elsewhere'", "log_file='/elsewhere'", "quiet=true")},
    "100,000 workers": (["apf", "batch", "walk", "-o", "new", "--workers", "100000"], None,
                        "--workers"),
    "parts of no frame": (["apf", "batch", "walk", "-o", "new", "--part-frames", "-5"], None,
                          "--part-frames is -5"),
    "a height that is none": (["psfs", "calibrate", "walk", "--wand", "0.5", "--floor", "0",
                               "--height", "nan", "-o", "new"], None, "--height is nan"),
    "a rate to follow nobody at": ([*TRACK, "--fps", "0.5"], None, "0.5 frames per second"),
    "a swarm's flag": ([*TRACK, "--inertia", "0.5"], None, "only to --method pso"),
    "a flag of triangulation": ([*TRACK, "--low-pass", "6"], None, "only to --method tri"),
    "a flag of image objectives": ([*TRACK, "--edges", "canny"], None, "--edges applies only"),
    "no weight at all": ([*TRACK, "--likelihood", "edge=0"], None, "no term has a weight"),
    "a volume of one voxel": (["psfs", "reconstruct", "seq", "-q", "-o", "new", "--voxel-size",
                               "20", *BOX[1:]], None, "1 x 1 x 1 voxels of 20 m"),
    "a cutoff without smoothing": (["apf", "export", "track", "-o", "new", "--raw", "--cutoff",
                                    "3"], None, "--cutoff applies only to the smoothing"),
    "axes without a TRC": (["apf", "export", "track", "-o", "new", "--to", "bvh", "--axes",
                            "z-up"], None, "--axes applies only to the TRC"),
    "a convention of an NPZ": (["apf", "evaluate", "track", "--truth", "truth.npz", "--convention",
                                "pose2sim"], None, "--convention applies only to a TRC"),
    "a size of a search that is none": (["apf", "track", "walk", "--keypoints", "truth.npz", "-o",
                                         "new", "--method", "triangulate", "--particles", "50"],
                                        None, "--particles applies only to bodies"),
    "markers without a C3D": (["psfs", "calibrate", "walk", "--wand", "0.5", "--markers", "a,b",
                               "-o", "new"], None, "--markers applies only to motion capture"),
    "masks of no pictures": ([*INFO, "--masks", "x.png"], None, "--masks shows pictures"),
    "emptiness of a recording": ([*LIVE[:-4], "--empty", "3"], None, "--empty applies only"),
    "a bone of nothing": ([*TRACK, "--body", "b.toml"], edited("track/body.toml",
                          'parent = "pelvis"', 'parent = ""', "b.toml"),
                          "parent is ''; expected a name of letters"),
    "a pose of another body": (TRACK, edited("pose.txt", "thorax.rz", "tail.rx"),
                               "value 9 is tail.rx, of another body"),
    "one camera alone": ([*TRACK[:-4], "--cameras", "c1", "--frames", "1:"], None,
                         "one camera, c1; expected two or more"),
    "a run over another command's": (["apf", "smooth", "track", "-o", "out"], None,
                                     "holds what `psfs reconstruct` wrote"),
    "a log over a track": (["apf", "export", "track", "-o", "new", "--log-file",
                            "track/track.npz"], None, "track.npz: is no log"),
    "a cutoff above all frames": (["apf", "smooth", "track", "-o", "new", "--cutoff", "31"], None,
                                  "--cutoff is 31 Hz, which smooths nothing"),
    "a take of one": ([*INFO, "--take", "x"], None, "`take` applies only to folders with several"),
    "half a number of frames": (["apf", "evaluate", "track", "--truth", "truth.npz",
                                 "--truth-start", "nan"], None, "--truth-start"),
    "a rate over nothing": ([*INFO, "--fps", "30/0"], None, "'30/0' is no frame rate"),
    "an empty folder": (["psfs", "info", "", "--no-pictures"], None, "FOLDER: is empty"),
    "a camera of no video": (INFO, edited("walk/calibration.toml", '"cam02"', '"gopro"'),
                             "cam02 for cam03, cam03 for gopro"),
    "a mesh's check of the user": (["psfs", "mesh", "out", "--frame", "1", "--check"],
                                   file("out/mesh_check.json"), "out/mesh_check.json: is there"),
    "all meshes in one": (["psfs", "mesh", "out", "--frame", "all", "-o", "m.ply"], None, "m.ply"),
    "a start elsewhere": ([*TRACK, "--init", "far.txt"], edited("pose.txt", "1", "50",
                          "far.txt"), "beyond the volume from"),
    "terms of pictures for masks": ([*TRACK, "--likelihood", "contour"], None,
                                    "has masks, and no pictures for the terms contour"),
    "priors alone": ([*TRACK, "--likelihood", "overlap,posture"], None, "none of these terms"),
    "too many voxels": (["psfs", "reconstruct", "seq", "-o", "new", "--grid", "5000,5000,5000",
                         BOX[1]], None, "expected fewer than 2^31"),
    "a studio in a file": (["apf", "studio", ".", "--no-browser", "-o", "pose.txt"], None,
                           "pose.txt: is a file"),
    "a pose as a scheduler": (["apf", "batch", "walk", "-o", "new", "--scheduler", "pose.txt"],
                              None, "pose.txt: malformed JSON"),
    "a demo of one camera": (["apf", "demo", "-o", "new", "--cameras", "1"], None, "--cameras"),
}  # fmt: skip


@pytest.mark.usefixtures("quick_start")
@pytest.mark.parametrize("fault", FAULTS)
def test_faults(stock: Path, fault: str) -> None:
    words, change, said = FAULTS[fault]
    if change is not None:
        change(stock)
    refused(words, stock, said)


def test_hidden_files_are_no_pictures(stock: Path) -> None:
    """macOS leaves such files beside all others on foreign disks."""
    for name in ("._0001.png", ".DS_Store"):
        (stock / "seq/masks/c3" / name).write_bytes(b"no picture")
    (stock / "walk/videos/._cam01.mp4").write_bytes(b"no video")
    for take in ("seq", "walk"):
        succeed("psfs", "info", take, "--no-pictures")


def test_values_as_other_programs_write_them(stock: Path) -> None:
    names = ["--cameras", "cam01, cam02"]
    said = succeed(*INFO, *names, "--fps", "30000/1001").out
    assert "29.97 per second" in said and "cam03" not in said
