"""The notebooks run from top to bottom, and what is kept of their last run is fit to be read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import pytest
from jupyter_client.manager import KernelManager, start_new_kernel
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[1] / "notebooks"
#: What the notebooks are run with here, smaller than they state.
SMALLER: dict[str, dict[str, str]] = {
    "image_objectives": {
        "size=(320, 240)": "size=(160, 120)",
        "range(8)": "range(3)",
        "np.linspace(-40, 40, 41)": "np.linspace(-40, 40, 5)",
    },
    "reconstruction": {"frames=11, size=(480, 360)": "frames=11, size=(160, 120)"},
    "tracking": {
        "frames=24, size=(400, 300)": "frames=6, size=(160, 120)",
        "n_particles=100, n_layers=8": "n_particles=30, n_layers=2",
        "voxel_size=0.025": "voxel_size=0.05",
    },
    "timings": {
        "FRAMES = 6": "FRAMES = 3",
        "range(8)": "range(3)",
        "frames[:3]": "frames[:2]",
        "size=(320, 240)": "size=(160, 120)",
        "0.03, (67, 67, 67)": "0.06, (34, 34, 34)",
        "n_particles=60, n_layers=5": "n_particles=40, n_layers=2",
    },
}
NAMES = tuple(SMALLER)


def cells_with_code(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def pictures(notebook: Any) -> int:
    return sum(
        any(kind.startswith("image/") for kind in output.get("data", {}))
        for cell in cells_with_code(notebook)
        for output in cell.outputs
    )


def make_smaller(notebook: Any, changes: dict[str, str]) -> None:
    """Replace each text, which must stand in the code once."""
    code = cells_with_code(notebook)
    for stated, smaller in changes.items():
        (cell,) = (cell for cell in code if stated in cell.source)
        assert cell.source.count(stated) == 1
        cell.source = cell.source.replace(stated, smaller)


def test_all_notebooks_are_tested() -> None:
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == set(NAMES)


@pytest.fixture(scope="module")
def kernel() -> Iterator[KernelManager]:
    """A process for all notebooks: each imports what the one before has loaded."""
    kernel, client = start_new_kernel(kernel_name="python3", cwd=str(FOLDER))
    client.stop_channels()
    yield kernel
    kernel.shutdown_kernel(now=True)


@pytest.mark.parametrize("name", NAMES)
def test_runs_from_top_to_bottom(name: str, kernel: KernelManager) -> None:
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", 4)
    kept = pictures(notebook)
    make_smaller(notebook, SMALLER[name])
    notebook.cells.insert(0, nbformat.v4.new_code_cell("%reset -f"))
    NotebookClient(notebook, km=kernel, timeout=300).execute()
    assert pictures(notebook) == kept


@pytest.mark.parametrize("name", NAMES)
def test_kept_outputs_are_whole_small_and_of_no_machine(name: str) -> None:
    path = FOLDER / f"{name}.ipynb"
    notebook = nbformat.read(path, 4)
    counts = [cell.execution_count for cell in cells_with_code(notebook)]
    assert counts == list(range(1, len(counts) + 1))
    assert pictures(notebook) >= 2
    assert path.stat().st_size < 1_000_000
    text = path.read_text()
    assert not [word for word in ("/tmp/", "/home/", "/work/", "/root/", "C:\\\\") if word in text]
    outputs = [output for cell in cells_with_code(notebook) for output in cell.outputs]
    assert not [o for o in outputs if o.output_type == "error" or o.get("name") == "stderr"]
