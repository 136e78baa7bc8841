"""Notebooks and the examples of docs/python.md run; what notebooks keep is fit to be read."""

import json
import os
import re
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import create_autospec

import numpy as np
import pytest

import psfs.mesh.preview
import psfs.output.preview
from apf.synthetic.generate import generate
from apf.synthetic.scene import SceneConfig
from cl import Device

FOLDER = Path(__file__).parents[1] / "notebooks"
#: That of `small_walk`, whose faults and box are then known.
FILM = "frames=4, fps=60, size=(160, 120), seed=4"
#: What the notebooks are run with here, smaller than they state.
SMALLER: dict[str, dict[str, str]] = {
    "image_objectives": {
        "size=(320, 240)": "size=(160, 120)",
        "range(8)": "range(3)",
        "np.linspace(-40, 40, 41)": "np.linspace(-40, 40, 5)",
    },
    "reconstruction": {
        "frames=11, size=(480, 360)": FILM,
        "sequence.read(10)": "sequence.read(0)",
        "_000010.png": "_000000.png",
        "psfs.Session(sequence, device)": (
            "psfs.Session(sequence, device, psfs.SessionSettings(voxel_size=0.05))"
        ),
    },
    "tracking": {
        "frames=24, size=(400, 300)": FILM,
        "n_particles=100, n_layers=8": "n_particles=30, n_layers=2",
        "voxel_size=0.025": "voxel_size=0.05",
    },
    "timings": {
        "FRAMES = 6": "FRAMES = 3",
        "range(8)": "range(3)",
        "frames[:3]": "frames[:2]",
        "cameras=4": "cameras=3",
        "size=(320, 240)": "size=(96, 72)",
        "0.03, (67, 67, 67)": "0.06, (34, 34, 34)",
        "n_particles=60, n_layers=5": "n_particles=24, n_layers=2",
    },
}
NAMES = sorted(path.stem for path in FOLDER.glob("*.ipynb"))


def read(name: str) -> list[dict[str, Any]]:
    """The cells with code, each one's source a text."""
    cells = json.loads((FOLDER / f"{name}.ipynb").read_text())["cells"]
    return [{**of, "source": "".join(of["source"])} for of in cells if of["cell_type"] == "code"]


def is_picture(data: dict[str, Any]) -> bool:
    return any(kind.startswith("image/") for kind in data)


def pictures(cells: list[dict[str, Any]]) -> int:
    return sum(is_picture(output.get("data", {})) for cell in cells for output in cell["outputs"])


def make_smaller(cells: list[dict[str, Any]], changes: dict[str, str]) -> None:
    """Replace each text, which must stand in the code once."""
    for stated, smaller in changes.items():
        (cell,) = (cell for cell in cells if stated in cell["source"])
        assert cell["source"].count(stated) == 1
        cell["source"] = cell["source"].replace(stated, smaller)


@pytest.fixture(scope="module")
def shell() -> Iterator[Any]:
    """IPython in this process, which has loaded the libraries and the kernels."""
    import matplotlib.pyplot as plt
    from IPython.core.interactiveshell import InteractiveShell
    from traitlets.config import Config

    plt.close("all")  # what tests before have left would be drawn here
    settings, backend = Config(), plt.get_backend()
    settings.HistoryManager.enabled = False
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(FOLDER)
        patch.setattr(sys, "path", [*sys.path])
        patch.setitem(sys.modules, "__main__", sys.modules["__main__"])  # which it replaces
        patch.setattr(InteractiveShell, "enable_gui", lambda *_: None)  # there is no window
        shell = InteractiveShell.instance(config=settings)
        shell.run_line_magic("matplotlib", "inline")
        yield shell
    plt.close("all")
    plt.switch_backend(backend)
    InteractiveShell.clear_instance()


@pytest.mark.parametrize("name", NAMES)
def test_runs_from_top_to_bottom(name: str, shell: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Shaded views are black pictures, as in the runs of other tests."""
    from IPython.utils.capture import capture_output

    picture = np.zeros((4, 6, 3), np.uint8)
    for draw in (psfs.mesh.preview.draw_mesh_preview, psfs.output.preview.draw_preview):
        black = create_autospec(draw, return_value=picture)
        monkeypatch.setattr(f"{draw.__module__}.{draw.__name__}", black)
    cells = read(name)
    make_smaller(cells, SMALLER[name])
    shell.reset()
    drawn = 0
    for cell in cells:
        with capture_output() as said:
            result = shell.run_cell(cell["source"])
        result.raise_error()
        last, _ = shell.display_formatter.format(result.result)
        drawn += sum(map(is_picture, (last, *(output.data for output in said.outputs))))
    assert drawn == pictures(cells)


@pytest.mark.parametrize("name", NAMES)
def test_kept_outputs_are_whole_small_and_of_no_machine(name: str) -> None:
    path, cells = FOLDER / f"{name}.ipynb", read(name)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert pictures(cells) >= 2
    assert path.stat().st_size < 1_000_000
    text = path.read_text()
    assert not [word for word in ("/tmp/", "/home/", "/work/", "/root/", "C:\\\\") if word in text]
    outputs = [output for cell in cells for output in cell["outputs"]]
    assert not [o for o in outputs if o["output_type"] == "error" or o.get("name") == "stderr"]


DOCS = Path(__file__).parents[1] / "docs"


def test_examples_run(small_walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "walk").symlink_to(small_walk)
    config = SceneConfig(people=2, cameras=4, frames=2, size=(160, 120))
    generate(tmp_path / "walkers", config, Device.best())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(os.environ, "MPLBACKEND", "agg")
    page = (DOCS / "python.md").read_text()
    names = re.findall(r'--8<-- "examples/(\w+)\.py"', page)
    assert sorted(names) == sorted(path.stem for path in (DOCS / "examples").glob("*.py"))
    for name in names:
        runpy.run_path(str(DOCS / "examples" / f"{name}.py"))
        assert (tmp_path / f"{name}.png").is_file() == (f"(pictures/{name}.png)" in page)
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        if not block.startswith("--8<--"):
            exec(compile(block, "python.md", "exec"), {})
