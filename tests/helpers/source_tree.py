"""Read imports from the text of modules."""

from __future__ import annotations

import ast


def imports(tree: ast.AST) -> list[tuple[str, str | None]]:
    """Return (module, alias) of every import, including those inside functions."""
    found: list[tuple[str, str | None]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, alias.asname) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute here"
            found.append((node.module or "", None))
    return found
