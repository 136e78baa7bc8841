"""How large functions and files may be, and how many parameters a function may take."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
MOST_PARAMETERS, MOST_LINES, MOST_LINES_OF_FILE = 6, 60, 400


def too_large(path: str, source: str) -> Iterator[str]:
    """What of a source file exceeds the limits; keyword-only options do not count as parameters,
    nor do `self` and `cls`."""
    if source.count("\n") > MOST_LINES_OF_FILE:
        yield f"{path}: {source.count(chr(10))} lines"
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            names = [a.arg for a in (*node.args.posonlyargs, *node.args.args)]
            count = len([name for name in names if name not in ("self", "cls")])
            lines = (node.end_lineno or 0) - node.lineno + 1
            if count > MOST_PARAMETERS:
                yield f"{path}:{node.lineno}: {node.name} takes {count} parameters"
            if lines > MOST_LINES:
                yield f"{path}:{node.lineno}: {node.name} has {lines} lines"


def test_functions_and_files_stay_small() -> None:
    folders = ("cl", "psfs", "apf", "scripts")
    paths = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    assert len(paths) > 300
    found = [what for path in paths for what in too_large(str(path), path.read_text())]
    assert not found, "\n".join(found)


def test_what_is_too_large_is_found() -> None:
    longer = "def f(self, a, b, c, d, e, g, h, *, i, j):\n" + "    a\n" * MOST_LINES + "\n" * 340
    assert list(too_large("x.py", longer)) == [
        "x.py: 401 lines",
        "x.py:1: f takes 7 parameters",
        "x.py:1: f has 61 lines",
    ]
    assert not list(too_large("x.py", "def f(a, b, c, d, e, g, *, h):\n    a\n"))
