"""The notebooks run from top to bottom, and what is kept of their last run is fit to be read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[1] / "notebooks"
NAMES = ("image_objectives", "reconstruction", "tracking", "timings")


def cells_with_code(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def pictures(notebook: Any) -> int:
    return sum(
        any(kind.startswith("image/") for kind in output.get("data", {}))
        for cell in cells_with_code(notebook)
        for output in cell.outputs
    )


def test_all_notebooks_are_tested() -> None:
    assert {path.stem for path in FOLDER.glob("*.ipynb")} == set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_runs_from_top_to_bottom(name: str) -> None:
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", 4)
    kept = pictures(notebook)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(FOLDER)}}).execute()
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
