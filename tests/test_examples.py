"""The examples of docs/python.md run, one after the other, on small walks."""

import os
import re
import runpy
from pathlib import Path

import pytest

from apf.synthetic.generate import generate
from apf.synthetic.scene import SceneConfig
from cl import Device

DOCS = Path(__file__).parents[1] / "docs"


def test_examples_run(walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "walk").symlink_to(walk)
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
