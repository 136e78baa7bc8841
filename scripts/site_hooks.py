"""Hooks of MkDocs: links to files of the repository that are not pages, formulas as MathML, and the
lists of the public API."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

_ROOT = Path(__file__).parents[1]
#: Where the files are that the site does not hold.
_REPOSITORY = "https://github.com/psfs-apf/psfs-apf/blob/main"


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Return the text of a page as the site shows it."""
    path = Path(page.file.abs_src_path)
    return list_api(draw_formulas(link_repository(markdown, path)))


def link_repository(markdown: str, path: Path) -> str:
    """Return the text of the page at `path` with links to files outside docs/ replaced by links to
    the repository."""
    docs = _ROOT / "docs"

    def replaced(match: re.Match[str]) -> str:
        target = (path.parent / match[1]).resolve()
        if target.is_relative_to(docs) or not target.is_relative_to(_ROOT):
            return match[0]
        return f"]({_REPOSITORY}/{target.relative_to(_ROOT).as_posix()}{match[2]}"

    return re.sub(r"\]\((\.\.?/[^)#\s]+)((?:#[^)\s]*)?\))", replaced, markdown)


def draw_formulas(markdown: str) -> str:
    """Return the text with every block of LaTeX (three backquotes and `math`, as GitHub reads it)
    replaced by MathML, which browsers draw without a script."""
    if "```math" not in markdown:
        return markdown
    from latex2mathml.converter import convert

    def drawn(match: re.Match[str]) -> str:
        return f'<div class="formula">{convert(match[1].strip(), display="block")}</div>'

    return re.sub(r"```math\n(.*?)```", drawn, markdown, flags=re.DOTALL)


def list_api(markdown: str) -> str:
    """Return the text with `<!-- api: PACKAGE -->` replaced by the documentation of all that the
    package exports, each by the module that defines it."""

    def listed(match: re.Match[str]) -> str:
        package = importlib.import_module(match[1])
        found = [getattr(package, name) for name in package.__all__ if name != "__version__"]
        own = [thing for thing in found if match[1] == "psfs" or not _is_of_psfs(thing)]
        return "\n\n".join(f"::: {thing.__module__}.{thing.__qualname__}" for thing in own)

    return re.sub(r"<!-- api: (\w+) -->", listed, markdown)


def _is_of_psfs(thing: Any) -> bool:
    return thing.__module__.split(".")[0] in ("cl", "psfs")
