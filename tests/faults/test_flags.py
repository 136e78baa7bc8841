"""Flags with values that nobody can mean, and paths that no file has."""

import os
from pathlib import Path

import pytest
from helpers import faults
from helpers.commands import run, succeed
from helpers.faults import BOX, refused

#: What no flag for a number takes.
NUMBERS = ("nan", "-inf", "1e300", "many", "", "9" * 401)

#: Commands with all that they need, flags of numbers, and numbers out of their bounds.
COMMANDS: dict[str, tuple[list[str], dict[str, tuple[str, ...]]]] = {
    "reconstruct": (
        ["psfs", "reconstruct", "seq", "-o", "new"],
        {
            "--voxel-size": ("0", "-1", "1e-300", "1e-9"),
            "--debris": ("-0.1", "1.1"),
            "--fps": ("0", "-1", "1e-300"),
            "--threshold": ("-1", "2"),
            "--unit": ("0", "-1", "1e-300", "inch"),
            "--volume": ("0,1,0,1,0", "0,0,0,1,0,1", "nan,1,0,1,0,1", "-1e9,1e9,0,1,0,1"),
            "--grid": ("0,1,1", "1,1", "-1,5,5", "99999,99999,99999", "1.5,1,1"),
            "--frames": ("1:2:0", "-1", "9:12", "a:b", "2:1"),
        },
    ),
    "mesh": (["psfs", "mesh", "out"], {"--smooth": ("-1", "1001", "999999999", "1.5"),
                                       "--frame": ("-1", "99", "2.5")}),
    "view": (["psfs", "view", "out", "--png", "x.png"], {"--frame": ("-1", "99", "2.5")}),
    "page": (["psfs", "view", "out"], {"--port": ("70000", "-1")}),
    "track": (
        ["apf", "track", "seq", "-o", "new", "--all-cameras"],
        {
            "--particles": ("0", "1", "-5", "1000001", "1.5"),
            "--layers": ("0", "-1", "1001", "1.5"),
            "--noise": ("-1", "0", "101"),
            "--seed": ("-1", "1.5", str(2**64)),
            "--surface-weight": ("-1",),
            "--overlap-weight": ("-1",),
            "--edge-weight": ("-1",),
            "--silhouette-weight": ("-1",),
            "--height": ("0", "0.4", "2.6", "178", "17"),
            "--seeds": ("0", "-1", "1.5", "100000"),
            "--trunk-layers": ("-1",),
            **dict.fromkeys(("--method", "--objective", "--background"), ("", "magic")),
        },
    ),
    "track pictures": (
        ["apf", "track", "seq", "-o", "new", "--objective", "sp"], {"--shape": ("3", "5", "9")}
    ),
    "smooth": (
        ["apf", "smooth", "track", "-o", "new"],
        {"--cutoff": ("0", "-1", "1e-300"), "--lag": ("-1", "1.5")},
    ),
    "render": (["apf", "render", "seq", "track", "-o", "new"], {"--shape": ("3", "-8", "9")}),
    "synth": (
        ["apf", "synth", "-o", "new"],
        {
            "--cameras": ("0", "-1", "65", "1.5"),
            "--frames": ("0", "-1", "1000001", "1.5"),
            "--fps": ("0", "-1", "1e-300", "1001"),
            "--size": ("0x0", "31x480", "100000x100000", "640", "ax480", "-640x480"),
            "--seed": ("-1", "1.5"),
            "--noise": ("-1", "51"),
            "--height": ("0", "17", "-1.7"),
        },
    ),
    "live": (
        ["apf", "live", "seq", "-o", "new", "--init", "pose.txt"],
        {"--scale": ("0", "-1", "1.1"), "--fps": ("0", "-1", "1001")},
    ),
}  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_numbers(original: Path, command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is written, so that all use one stock."""
    monkeypatch.chdir(original)
    words, flags = COMMANDS[command]
    for number, (flag, values) in enumerate(flags.items()):
        for value in (*NUMBERS[: 2 if number else None], *values):  # all of them for one flag
            try:
                said = "" if flag == "--shape" and value in NUMBERS else flag[2:]  # may be a file
                refused([*words, f"{flag}={value}"], original, said)
            except AssertionError as error:
                raise AssertionError(f"{flag}={value}: {error}") from None


#: Words, and what the line says.
WORDS = {
    "psfs": "required: COMMAND",
    "psfs nonsense": "invalid choice: 'nonsense'",
    "apf track seq": "required: -o/--output",
    "psfs info seq --nonsense": "unrecognized arguments: --nonsense",
    "psfs info seq --up w": "up axis 'w'",
    "psfs info seq --background x": "argument --background: invalid choice: 'x'",
    "psfs info seq --cameras c1,c99": "seq: no camera c99; the rig has c0,",
    "psfs info seq --device abacus": "no OpenCL device matches abacus",
    "psfs check seq": "seq/summary.json: no such file",
    "psfs mesh track": "track/summary.json: no such file",
    "psfs mesh out -o x.png": "x.png: expected a name that ends in .ply",
    "psfs view out --png x.nonsense": "x.nonsense: unknown picture format",
    "apf track seq seq -o new": "seq is given twice",
    "apf track seq -o new --likelihood edge=nan": "edge_weight is nan",
    "apf track seq -o new --body nobody": "nobody: no body model",
    "apf track seq -o new --init nowhere.txt": "nowhere.txt: no such file",
    "apf evaluate out --truth truth.npz": "out/track.npz: no such file",
    "apf smooth track -o track": "which is read",
    "apf smooth nowhere -o new": "nowhere: no such file",
    "apf export track -o new --to fbx": "argument --to: invalid choice: 'fbx'",
    "apf export track -o new --axes up": "argument --axes: invalid choice: 'up'",
    "apf render seq track -o seq": "which is read",
    "apf track seq -o seq": "which is read",
    "psfs reconstruct walk -o walk": "which is read",
    "apf live seq -o seq --init pose.txt": "which is read",
    "apf live seq -o new --init pose.txt --device numpy": "--device numpy is no device for live",
    "apf live seq -o new --init pose.txt --captures /no/a /no/b /no/c /no/d /no/e": "/no/a: ",
    "apf live seq -o new --init pose.txt --captures /no/a": "1 captures (/no/a); expected 5",
    "apf synth -o pose.txt": "pose.txt: is a file",
    "apf synth -o / --frames 2 --cameras 2": "has no name of its own",
    "apf synth -o new --size 65x49": "expected even sides",
    "psfs reconstruct seq -o pose.txt": "pose.txt: is a file",
}


@pytest.mark.parametrize("words", WORDS)
def test_words(original: Path, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(original)
    refused(words.split(), original, WORDS[words])


LOOP = "loop"
PATHS = {
    "300 characters": "x" * 300,
    "5000 characters": "/".join(["x" * 100] * 50),
    "a loop": LOOP,
    "NUL": "a\0b",
    "brackets": "[bold][/][red]",
    "a line break": "a\nb",
    "an escape": "a\x1b[31mb",
    "no UTF-8": os.fsdecode(b"\xff\xfe"),
    "empty": "",
    "a device": "/dev/null",
    "a process's file": "/proc/self/mem",
    "below a file": "pose.txt/x",
}
#: How lines show those that they do not show as they are.
SHOWN = {
    "5000 characters": "x" * 100,
    "NUL": "holds the character NUL",
    "a line break": "a b",
    "an escape": r"a\x1b[31mb",
    "no UTF-8": r"\udcff\udcfe",
    "empty": "is empty",
    "a process's file": "/mem",
}
TAKERS = [
    ["psfs", "info", "{}"],
    ["psfs", "reconstruct", "{}", "-o", "new"],
    ["psfs", "check", "{}"],
    ["psfs", "mesh", "{}"],
    ["psfs", "view", "{}"],
    ["psfs", "silhouettes", "{}", "-o", "new"],
    ["psfs", "info", "seq", "--calibration", "{}"],
    ["psfs", "info", "seq", "--config", "{}"],
    ["apf", "track", "{}", "-o", "new"],
    ["apf", "track", "seq", "-o", "new", "--init", "{}"],
    ["apf", "track", "seq", "-o", "new", "--body", "{}"],
    ["apf", "evaluate", "{}", "--truth", "truth.npz"],
    ["apf", "evaluate", "track", "--truth", "{}"],
    ["apf", "smooth", "{}", "-o", "new"],
    ["apf", "export", "{}", "-o", "new"],
    ["apf", "render", "seq", "{}", "-o", "new"],
    ["apf", "render", "seq", "track", "-o", "new", "--shape", "{}"],
    ["apf", "render", "seq", "track", "-o", "new", "--shape-pose", "{}", "--shape", "truth.trc"],
]


@pytest.mark.parametrize("kind", PATHS)
def test_paths_that_are_read(stock: Path, kind: str) -> None:
    (stock / LOOP).symlink_to(stock / LOOP)
    for number, words in enumerate(TAKERS):
        if (number + list(PATHS).index(kind)) % 2:
            continue  # half of the pairs do
        if kind == "a device" and "--config" in words:
            continue  # no settings
        if kind == "empty" and words[1] in ("check", "mesh", "view", "smooth", "export"):
            continue  # the folder one is in
        refused([w.format(PATHS[kind]) for w in words], stock, SHOWN.get(kind, PATHS[kind]))


WRITERS = [
    ["psfs", "reconstruct", "seq", *BOX[:2], "-o"],
    ["apf", "smooth", "track", "-o"],
    ["apf", "export", "track", "-o"],
    ["apf", "evaluate", "track", "--truth", "truth.npz", "--json", "-o"],
    ["psfs", "view", "out", "--frame", "1", "--png"],
]
NAMES = {
    **{kind: PATHS[kind] for kind in ("brackets", "a line break", "an escape", "no UTF-8")},
    "spaces": " a b ",
    "a percent": "%s %d {x}",
    "a minus": "./-x",
    "200 characters": "x" * 200,
}


@pytest.mark.parametrize("kind", NAMES)
def test_strange_names_are_written(stock: Path, kind: str) -> None:
    for words in WRITERS if kind == "no UTF-8" else WRITERS[1:]:
        name = NAMES[kind] + words[1] + (".png" if words[-1] == "--png" else "")
        outcome = succeed(*words, name)
        assert Path(name).exists() and "\x1b[31m" not in outcome.out + outcome.err


@pytest.mark.parametrize("kind", [k for k in PATHS if k not in NAMES and k != "empty"])
def test_names_that_cannot_be_written(stock: Path, kind: str) -> None:
    (stock / LOOP).symlink_to(stock / LOOP)
    there = kind in ("a loop", "a device", "a process's file")
    for words in WRITERS[1:]:  # the slow one is tried with folders
        ending = ".png" if words[-1] == "--png" and not there else ""
        refused([*words, PATHS[kind] + ending], stock, SHOWN.get(kind, PATHS[kind]))


def test_a_sequence_of_strange_names(stock: Path) -> None:
    """Videos in a folder whose name is no UTF-8, on which OpenCV crashes."""
    for name in NAMES.values():
        folder = stock / f"take {name.replace('/', '')}"
        (stock / "walk").rename(folder)
        succeed("psfs", "info", folder, "--no-pictures")
        folder.rename(stock / "walk")


def test_what_is_left_is_reported(
    stock: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("psfs.cli.info.SequenceInfo", lambda sequence: {}["a fault of ours"])
    outcome = run("psfs", "info", str(stock / "walk"), "--no-pictures")
    assert outcome.code == 70 and outcome.err.count("\n") == 1
    assert "please report" in outcome.err
    log = next(tmp_path.glob("psfs-*.log"))
    assert str(log) in outcome.err and "a fault of ours" in log.read_text()
    assert faults.state(stock)
