"""What all commands share: versions, completion, settings as a file, messages, the log."""

from __future__ import annotations

import argparse
import shutil
import subprocess
from pathlib import Path

import pytest
from apf.cli.method_flags import METHOD_FLAGS, add_method_flags, select_method
from psfs.cli.program.command import Command
from psfs.cli.settings import add_configs, write_settings

import apf.cli
import psfs.cli
from cl import InputError
from psfs.cli.commandline import frame_range, stdout, warn
from psfs.cli.program import run_program
from psfs.settings import Settings
from psfs.voxels.config import ReconstructionConfig


class Walk(Command):
    """A command with a flag of each kind, that keeps what it was given."""

    args = argparse.Namespace()

    def add_flags(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("folder")
        parser.add_argument("-o", "--output", type=Path, required=True)
        size = parser.add_mutually_exclusive_group()
        size.add_argument("--grid", type=frame_range)
        size.add_argument("--voxel-size", type=float)
        parser.add_argument("--names", nargs="+")
        parser.add_argument("--no-overlay", action="store_true")
        parser.add_argument("--no-pictures", dest="pictures", action="store_false")
        parser.add_argument("--count", type=int, choices=(1, 2), default=1)
        parser.add_argument("--init", type=Path)
        add_method_flags(parser)
        add_configs(parser, Settings, "reconstruction")

    def run(self, args: argparse.Namespace) -> None:
        Walk.args = args
        stdout.print("a result")
        warn("a warning", stdout)
        if args.folder == "bad":
            raise InputError("bad: not good")
        method = select_method(args)
        reconstruction = args.configs.get("reconstruction", ReconstructionConfig())
        tables = {"method": method, "reconstruction": reconstruction}
        write_settings(args.output, args, tables, METHOD_FLAGS)


def walk(out: Path, *flags: str, folder: str = "somewhere") -> tuple[int, argparse.Namespace]:
    command = Walk("walk", "walk somewhere", flags="", work="")
    argv = ["walk", folder, "-o", str(out), *flags]
    return run_program("walker", "walks", [command], argv), command.args


def test_settings_given_back_are_the_same(tmp_path: Path) -> None:
    """Every kind of flag, and all settings without one."""
    flags = ["--voxel-size", "0.03", "--names", "a", "b", "--no-overlay", "--no-pictures"]
    flags += ["--count", "2", "--init", "pose.txt", "--particles", "77", "--method", "pso"]
    code, first = walk(tmp_path / "a", *flags)
    assert code == 0
    written = tmp_path / "a" / "settings.toml"
    code, second = walk(tmp_path / "b", "--config", str(written))
    assert code == 0
    names = ("voxel_size", "names", "no_overlay", "pictures", "count")
    assert [getattr(first, n) for n in names] == [getattr(second, n) for n in names]
    assert second.init == Path("pose.txt").resolve()
    assert select_method(first) == select_method(second)
    assert select_method(second).search == "pso"
    assert (tmp_path / "b" / "settings.toml").read_text() == written.read_text()


def test_flags_beat_the_file_and_exclude_its(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        "voxel-size = 0.05\ncount = 2\nparticles = 50\n"
        "[method.filter.search]\nn_layers = 4\n"
        "[reconstruction.occupancy]\nthreshold = 0.7\n"
    )
    config = ["--config", str(file)]
    _, args = walk(tmp_path / "a", *config, "--count", "1", "--grid", "1:2", "--layers", "3")
    assert args.count == 1 and args.voxel_size is None
    search = select_method(args).filter.search
    assert (search.n_particles, search.n_layers) == (50, 3)
    _, args = walk(tmp_path / "b", *config)
    assert (args.count, args.voxel_size) == (2, 0.05)
    assert select_method(args).filter.search.n_layers == 4
    assert args.configs["reconstruction"].occupancy.threshold == 0.7
    assert args.configs["reconstruction"].occupancy.prior == 0.5


def test_a_method_named_in_a_file_has_its_own_defaults(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('[method]\nsearch = "sir"\n')
    _, args = walk(tmp_path / "a", "--config", str(file))
    assert select_method(args).filter.search.n_particles == 3000
    _, args = walk(tmp_path / "a", "--config", str(file), "--method", "apf")
    assert select_method(args).filter.search.n_particles == 200


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("particels = 3", "particels is no setting of walker walk; did you mean particles?"),
        ("x = 3", "x is no setting of walker walk; see walker walk --help"),
        ('voxel-size = "thick"', "voxel-size is 'thick'; expected a number"),
        ("voxel-size = [1, 2]", "voxel-size is [1, 2]; expected one value"),
        ("names = 3", "names is 3; expected a list"),
        ("names = [true]", "names is True; expected a text or a number"),
        ("count = 7", "count is 7; expected one of 1, 2"),
        ("no-overlay = 1", "no-overlay is 1; expected true or false"),
        ('grid = "b"', "grid is 'b'; 'b' is no frame range"),
        ("[reconstuction]", "has a table [reconstuction]; expected [method], [reconstruction]"),
        ("[method]\nfilter = 3", "method.filter is 3; expected settings with names"),
        ("[method.filter.search]\nlayers = 3", "method.filter.search.layers: no such setting"),
        ("[method.filter.search]\nn_layers = 3.5", "search.n_layers is 3.5; expected a whole"),
        ("[method.filter.search]\nnoise = nan", "search.noise is nan; expected a number"),
        ("[method.filter.search]\nnoise = -1", "noise"),
        ('[reconstruction.silhouette.appearance]\nlearn = "no"', "expected true or false"),
        ("count = ", "malformed TOML"),
    ],
)
def test_bad_files_are_named(
    text: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    code, _ = walk(tmp_path / "out", "--config", str(file))
    said = capsys.readouterr().err
    assert code == 2 and expected in said and str(file) in said and said.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("flag", "value", "expected"),
    [
        ("--voxel-size", "0,02", "--voxel-size: is '0,02'; expected a number, such as 1.5"),
        ("--count", "one", "--count: is 'one'; expected a whole number"),
    ],
)
def test_a_flag_that_is_no_number(
    flag: str, value: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert walk(tmp_path / "out", flag, value)[0] == 2
    assert expected in capsys.readouterr().err


def test_quiet_shows_warnings_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    walk(tmp_path, "--quiet")
    said = capsys.readouterr()
    assert said.out == "" and said.err == "warning: a warning\n"
    walk(tmp_path)
    said = capsys.readouterr()
    assert said.out == "a result\nwarning: a warning\n" and said.err == ""


def test_the_log_has_all_messages_and_grows(tmp_path: Path) -> None:
    log = tmp_path / "logs" / "walk.log"
    walk(tmp_path, "--quiet", "--log-file", str(log))
    assert walk(tmp_path, "--log-file", str(log), folder="bad")[0] == 2
    text = log.read_text()
    assert text.count("a result") == 2 and text.count("warning: a warning") == 2
    assert "walker walk somewhere" in text and "walker: done" in text
    assert "InputError: bad: not good" in text and "Traceback" in text
    walk(tmp_path)
    assert log.read_text() == text


def test_a_log_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _ = walk(tmp_path / "out", "--log-file", str(tmp_path))
    assert code == 2 and "--log-file" in capsys.readouterr().err


@pytest.mark.parametrize("main", [psfs.cli.main, apf.cli.main])
def test_versions(main: object, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0  # type: ignore[operator]
    assert "psfs-apf 0" in capsys.readouterr().out


@pytest.mark.parametrize("main", [psfs.cli.main, apf.cli.main])
def test_completion_is_a_script_that_bash_reads(
    main: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if shutil.which("bash") is None:
        pytest.skip("there is no bash")
    assert main(["--completion", "bash"]) == 0  # type: ignore[operator]
    script = tmp_path / "completion"
    script.write_text(capsys.readouterr().out)
    prog = "apf" if main is apf.cli.main else "psfs"
    command = "track" if prog == "apf" else "reconstruct"
    ask = (
        f"source {script}; COMP_WORDS=({prog} {command} --vo); COMP_CWORD=2; "
        f"_shtab_{prog}; echo ${{COMPREPLY[@]}}"
    )
    found = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)
    assert "--voxel-size" in found.stdout.split()


@pytest.mark.parametrize(("main", "command"), [(apf.cli.main, "track"), (apf.cli.main, "live")])
def test_help_has_what_is_common_first(
    main: object, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, "--help"]) == 0  # type: ignore[operator]
    text = capsys.readouterr().out
    order = ["--frames", "--device", "sequence:", "start:", "search:", "--particles", "messages:"]
    order = [f"\n{'' if word[-1] == ':' else '  '}{word}" for word in order]
    positions = [text.index(word) for word in order]
    assert positions == sorted(positions)
    assert "[flags]" in text.splitlines()[0]
