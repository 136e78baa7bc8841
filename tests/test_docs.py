"""The pages' paths exist, and scripts find their marks."""

import ast
import importlib
import inspect
import re
import runpy
from importlib.util import find_spec
from pathlib import Path

import pytest

import apf
import psfs

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
PAGES += sorted((ROOT / "docs").rglob("*.md"))
#: Paths in backquotes that begin with one of these are the repository's.
ROOMS = ("cl/", "psfs/", "apf/", "tests/", "scripts/", "docs/", "notebooks/")


def page_name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_paths_links_and_anchors_exist(page: Path) -> None:
    """An anchor is a heading of the page that is linked to."""
    text = re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL)
    quoted = re.findall(r"`([\w./-]+)`", text)
    paths = [path for path in quoted if path.startswith(ROOMS)]
    missing = [path for path in paths if not (ROOT / path).exists()]
    for link, anchor in re.findall(r"\]\((?!https?:)([^)#]*)#?([^)]*)\)", text):
        target = page.parent / link if link else page
        if not target.exists():
            missing.append(link)
        elif anchor:
            headings = re.findall(r"^#+ (.*)$", target.read_text(), re.MULTILINE)
            names = [re.sub(r"[^\w -]", "", line.lower()).replace(" ", "-") for line in headings]
            missing += [f"{link}#{anchor}"] if anchor not in names else []
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=page_name)
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
            if hasattr(owner, "__path__") and find_spec(f"{owner.__name__}.{part}"):
                importlib.import_module(f"{owner.__name__}.{part}")
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


def test_code_of_the_stage_is_the_repositorys() -> None:
    """Every block under `path`: is in that file, but for its dots."""
    text = (ROOT / "docs" / "add_a_stage.md").read_text()
    blocks = re.findall(r"\n`([\w./]+)`:\n\n```\w+\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 6
    for path, block in blocks:
        source = (ROOT / path).read_text()
        for piece in re.split(r"^ *\.\.\.\n|\n\n", block, flags=re.MULTILINE):
            assert piece.strip() in source, f"{path} has not:\n{piece}"


def test_messages_of_the_questions_are_those_of_the_code() -> None:
    page = (ROOT / "docs" / "faq.md").read_text().split("| message contains")[1]
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    named = [message for row in rows for message in re.findall(r"`([^`]+)`", row)]
    assert len(named) > 10
    said = "\n".join(texts_of_the_code())
    assert [message for message in named if message not in said] == []


def texts_of_the_code() -> list[str]:
    """Return all texts in the code, adjacent ones joined, without what is filled into them."""
    return [
        node.value
        for package in ("cl", "psfs", "apf")
        for file in (ROOT / package).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    ]


def test_links_out_of_the_pages_lead_to_the_repository() -> None:
    hooks = runpy.run_path(str(ROOT / "scripts" / "site_hooks.py"))
    text = "[a](../CHANGELOG.md#x) [b](../start.md) [c](start.md)"
    shown = hooks["link_repository"](text, ROOT / "docs" / "lab" / "speed.md")
    assert shown == text  # as seen from docs/lab/, both are in docs/
    shown = hooks["link_repository"](text, ROOT / "docs" / "start.md")
    base = "https://github.com/psfs-apf/psfs-apf/blob/main"
    assert shown == f"[a]({base}/CHANGELOG.md#x) [b]({base}/start.md) [c](start.md)"
