"""A stage is a kernel file, a launcher, a NumPy twin, and tests that compare the two."""

import re
from pathlib import Path

import pytest

from cl.program import kernel_source
from cl.signature import signatures

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "cl" / "kernels"
STAGES = sorted(str(p.relative_to(FOLDER).with_suffix("")) for p in FOLDER.rglob("*.cl"))


def test_every_kernel_is_compared_with_its_twin() -> None:
    """A test marked for it does so, and launches it, or fails (conftest.py)."""
    kernels = {
        f"{stage}.{name}" for stage in STAGES for name in signatures(kernel_source(stage), stage)
    }
    texts = [path.read_text() for path in (ROOT / "tests").rglob("test_*.py")]
    marks = re.findall(r"pytest\.mark\.parity\(([^)]*)\)", "".join(texts))
    marked = set(re.findall(r'"([^"]+)"', "".join(marks)))
    assert not kernels - marked, "no test has @pytest.mark.parity for these"
    assert not marked - kernels, "tests are marked for kernels that there are not"


@pytest.mark.parametrize("stage", STAGES)
def test_every_stage_names_its_twin(stage: str) -> None:
    head = (FOLDER / f"{stage}.cl").read_text().split("#if")[0].replace("//", "").split()
    named = re.findall(r"[Tt]win\S*.*?\s((?:\w+/)+\s?\w+\.py)", " ".join(head))
    assert named, f"{stage}.cl names no twin"
    for path in (name.replace(" ", "") for name in named):
        assert any((ROOT / package / path).is_file() for package in ("", "psfs", "apf")), path


def test_helpers_of_kernels_are_static() -> None:
    """C99's `inline` alone gives no definition where a compiler does not inline."""
    paths = [path for path in FOLDER.rglob("*") if path.suffix in (".cl", ".h")]
    texts = {path.name: re.sub(r"//.*", "", path.read_text()) for path in paths}
    bare = {name for name, text in texts.items() if re.search(r"(?<!static )\binline\b", text)}
    assert len(texts) > 40 and not bare
