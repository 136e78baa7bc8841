"""What all commands share: versions, completion, settings as a file, messages, the log."""

import shutil
import subprocess
from pathlib import Path
from typing import Annotated, Any, ClassVar

import pytest
from helpers.commands import succeed

from apf.request import StartRequest
from cl import InputError
from psfs.cli.commandline import stdout, warn
from psfs.cli.program import Command, run_program
from psfs.common.requests import Flag, Request, write_settings
from psfs.opening import stated_keys
from psfs.request import frame_range, output_flag


class WalkRequest(StartRequest):
    """A request with a flag of each kind."""

    COMMAND: ClassVar = "walker walk"

    folder: Annotated[str, Flag("", "FOLDER", positional=True)]
    output: Annotated[Path, output_flag("")]
    grid: Annotated[slice | None, Flag("", "G", frame_range, either="size")] = None
    voxel_size: Annotated[float | None, Flag("", "M", either="size")] = None
    names: Annotated[tuple[str, ...] | None, Flag("", "N", nargs="+")] = None
    overlay_video: Annotated[bool, Flag("", name="no-overlay")] = True
    count: Annotated[int, Flag("", choices=(1, 2))] = 1


class Walk(Command):
    """A command that keeps its request."""

    request_made: ClassVar[Any] = None

    @property
    def kind(self) -> type[Request]:
        return WalkRequest

    def run(self, request: Request) -> None:
        assert isinstance(request, WalkRequest)
        Walk.request_made = request
        stdout.print("a result")
        warn("a warning", stdout)
        if request.folder == "bad":
            raise InputError("bad: not good")
        write_settings(request.output, request, ["method", "reconstruction"])


def walk(out: Path, *flags: str, folder: str = "somewhere") -> tuple[int, Any]:
    command = Walk("walker", "walk", "walk somewhere")
    argv = ["walk", folder, "-o", str(out), *flags]
    return run_program("walker", "walks", [command], argv), command.request_made


def test_settings_given_back_are_the_same(tmp_path: Path) -> None:
    """Every kind of flag, and all settings without one."""
    flags = ["--voxel-size", "0.03", "--names", "a", "b", "--no-overlay", "--volume=-1,1,-1,1,0,2"]
    flags += ["--cameras", "a,b", "--sync", "a=2,b=-1", "--fps", "30000/1001"]
    flags += ["--count", "2", "--init", "pose.txt", "--particles", "77", "--method", "pso"]
    code, first = walk(tmp_path / "a", *flags)
    assert code == 0
    written = tmp_path / "a" / "settings.toml"
    code, second = walk(tmp_path / "b", "--config", str(written))
    assert code == 0
    names = ("voxel_size", "names", "overlay_video", "count", "method")
    assert [getattr(first, n) for n in names] == [getattr(second, n) for n in names]
    assert stated_keys(first.capture) == stated_keys(second.capture)
    assert second.init == Path("pose.txt").resolve()
    assert second.method.search == "pso" and not second.overlay_video
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
    search = args.method.filter.search
    assert (search.n_particles, search.n_layers) == (50, 3)
    _, args = walk(tmp_path / "b", *config)
    assert (args.count, args.voxel_size) == (2, 0.05)
    assert args.method.filter.search.n_layers == 4
    assert args.reconstruction.occupancy.threshold == 0.7
    assert args.reconstruction.occupancy.prior == 0.5


def test_a_method_named_in_a_file_has_its_own_defaults(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('[method]\nsearch = "sir"\n')
    _, args = walk(tmp_path / "a", "--config", str(file))
    assert args.method.filter.search.n_particles == 3000
    _, args = walk(tmp_path / "a", "--config", str(file), "--method", "apf")
    assert args.method.filter.search.n_particles == 200


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
        ("[reconstuction]", "has a table [reconstuction]; expected [reconstruction], [method]"),
        ("[method]\nfilter = 3", "method.filter is 3; expected settings with names"),
        ("[method.filter.search]\nlayers = 3", "method.filter.search.layers: no such setting"),
        ("[method.filter.search]\nn_layers = 3.5", "search.n_layers is 3.5; expected a whole"),
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


@pytest.mark.parametrize("program", ["psfs", "apf"])
def test_versions(program: str) -> None:
    assert "psfs-apf 0" in succeed(program, "--version").out


@pytest.mark.parametrize(("program", "command"), [("psfs", "reconstruct"), ("apf", "track")])
def test_completion_is_a_script_that_bash_reads(program: str, command: str, tmp_path: Path) -> None:
    if shutil.which("bash") is None:
        pytest.skip("there is no bash")
    script = tmp_path / "completion"
    script.write_text(succeed(program, "--completion", "bash").out)
    ask = (
        f"source {script}; COMP_WORDS=({program} {command} --vo); COMP_CWORD=2; "
        f"_shtab_{program}; echo ${{COMPREPLY[@]}}"
    )
    found = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)
    assert "--voxel-size" in found.stdout.split()
