"""The pages' paths exist, the README is short, and scripts find their marks."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest

import apf
import psfs

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
PAGES += sorted((ROOT / "docs").glob("*.md"))
#: Paths in backquotes that begin with one of these are the repository's.
ROOMS = ("cl/", "psfs/", "apf/", "tests/", "scripts/", "docs/", "notebooks/")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_paths_and_links_exist(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    links = re.findall(r"\]\((?!https?:)([^)#]+)", text)
    missing = [link for link in links if not (page.parent / link).exists()]
    quoted = re.findall(r"`([\w./-]+)`", text)
    paths = [path for path in quoted if path.startswith(ROOMS)]
    missing += [path for path in paths if not (ROOT / path).exists()]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_public_names_exist(page: Path) -> None:
    """`psfs.X`, `apf.X`, and `X.y` of their classes."""
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    missing = []
    for name in re.findall(r"`((?:\w+\.)+\w+)(?:\([^`]*)?`", text):
        first, *rest = name.split(".")
        if first in ("psfs", "apf"):
            owner = {"psfs": psfs, "apf": apf}[first]
        elif first in psfs.__all__ or first in apf.__all__:
            owner = getattr(psfs if first in psfs.__all__ else apf, first)
        else:
            continue  # a file, or a name of another kind
        for part in rest:
            if not hasattr(owner, part):
                if not re.search(rf"\b{part}\b", inspect.getsource(owner)):
                    missing.append(name)
                break  # else a field without a default, or an attribute of instances
            owner = getattr(owner, part)
    assert not missing


def test_paths_named_in_the_code_exist() -> None:
    """In comments and docstrings; a path may begin in its package or among the kernels."""
    missing = []
    for package in ("cl", "psfs", "apf", "tests", "scripts"):
        for file in sorted((ROOT / package).rglob("*.*")):
            if file.suffix not in (".py", ".cl", ".h"):
                continue
            named = re.findall(r"\b((?:[a-z_]+/)+[a-z_]+\.(?:py|cl|h))\b", file.read_text())
            starts = (ROOT, ROOT / package, *(ROOT / name for name in ("psfs", "apf", "tests")))
            starts += (ROOT / "cl" / "kernels", file.parent)
            missing += [
                f"{file.relative_to(ROOT)}: {path}"
                for path in named
                if not any((start / path).exists() for start in starts)
            ]
    assert not missing


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) < 150


@pytest.mark.parametrize(
    ("page", "mark"),
    [("README.md", "accuracy"), ("README.md", "timings"), ("docs/accuracy.md", "thesis")],
)
def test_scripts_find_their_marks(page: str, mark: str) -> None:
    text = (ROOT / page).read_text()
    begin, end = f"<!-- {mark}: begin -->", f"<!-- {mark}: end -->"
    assert text.count(begin) == text.count(end) == 1
    assert text.index(begin) < text.index(end)


def test_code_of_the_stage_is_the_repositorys() -> None:
    """Every block under `path`: is in that file, but for its dots."""
    text = (ROOT / "docs" / "add_a_stage.md").read_text()
    blocks = re.findall(r"\n`([\w./]+)`:\n\n```\w+\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 6
    for path, block in blocks:
        source = (ROOT / path).read_text()
        for piece in re.split(r"^ *\.\.\.\n|\n\n", block, flags=re.MULTILINE):
            assert piece.strip() in source, f"{path} has not:\n{piece}"
