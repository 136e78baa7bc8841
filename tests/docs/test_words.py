"""The language rules that a test can hold: first words of docstrings, banned names and words.

`docs/glossary.md` has the words to use instead.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("cl", "psfs", "apf", "scripts")
#: Verbs that end like a third person, a participle or a gerund.
VERBS = {
    *("Access", "Address", "Assess", "Bring", "Compress", "Cross", "Discuss", "Dismiss", "Embed"),
    *("Express", "Feed", "Focus", "Guess", "Pass", "Press", "Process", "Ring", "Seed", "Speed"),
    *("String", "Suppress"),
}
#: First words that make a phrase or a question, not an instruction.
NO_VERBS = {
    *("A", "All", "An", "And", "Any", "As", "At", "Before", "Both", "But", "By", "Each", "Every"),
    *("For", "From", "He", "Her", "Here", "How", "If", "In", "Is", "It", "Its", "Least", "Made"),
    *("Most", "My", "Nearest", "No", "Not", "Of", "On", "One", "Only", "Or"),
    *("Our", "So", "Some", "That", "The", "Their", "Then", "There", "These", "They"),
    *("This", "Those", "To", "True", "Until", "What", "When", "Where", "Whether", "Which"),
    *("White", "Who", "Whole", "Whose", "Why", "With", "Without"),
}
#: First words of a class's or an attribute's docstring that leave the noun out.
NO_NOUNS = {
    *("And", "As", "At", "Below", "But", "By", "From", "He", "How", "In", "It", "Likewise", "Of"),
    *("On", "Or", "Them", "There", "They", "What", "When", "Where", "Which", "Who", "Why", "With"),
    *("Without",),
}
#: Words of our own, in docstrings and comments.
BANNED_WORDS = re.compile(
    r"\b(told|whom|plates?|witness(?:es)?|learnt|anew|nobody's|somebody's|looked (?:for|at)"
    r"|(?:is|are|was|were|as|been) said|way back|say together|who is seen|a look at|give up hope"
    r"|(?:is|are) seen by (?:nobody|somebody))\b",
    re.IGNORECASE,
)
#: Parts of names that are such words, or participles that say neither verb nor object.
BANNED_PARTS = {
    *("told", "whom", "plate", "plates", "witness", "witnesses", "learnt", "looked", "said"),
    *("hopeless", "trusted", "examined", "watched", "steadied", "reaching", "exchanged", "odd"),
    *("habits", "strain", "settled", "sideways", "somebody", "nobody"),
}
#: Last words of names that end like a participle and are none, and conversions that keep theirs.
NO_PARTICIPLES = {"seed", "speed", "packed", "posed", "scaled"}
#: Participles that do not end in "ed".
PARTICIPLES = {
    *("begun", "bound", "chosen", "drawn", "found", "given", "grown", "hidden", "kept", "known"),
    *("placed", "relearnt", "seen", "shown", "taken", "unlit", "written"),
}
#: First words of functions that say neither verb nor object.
PREPOSITIONS = {"around", "at", "beside", "between", "in", "near", "of", "over"}
#: Functions that define a setting.
SETTINGS = {"setting", "fraction", "positive", "nonnegative", "natural"}
#: A function whose name ends so names neither its verb nor its object.
ENDINGS = ("_of", "_as", "_at", "_in", "_by", "_than", "_out_of")


def room_of(path: str) -> str:
    """Return the folder in the package that holds a file, or the file itself beside such
    folders."""
    parts = path.split("/")
    return "/".join(parts[:2]) if len(parts) > 2 else path


@cache
def files_by_room() -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*.py")):
            found.setdefault(room_of(file.relative_to(ROOT).as_posix()), []).append(file)
    return found


def is_property(function: ast.FunctionDef) -> bool:
    return any("property" in ast.unparse(decorator) for decorator in function.decorator_list)


def docstring_faults(node: ast.AST, text: str) -> Iterator[str]:
    """Yield what is wrong with the beginning of a docstring."""
    word = re.split(r"[\s,.:;]", text, maxsplit=1)[0]
    if isinstance(node, ast.FunctionDef) and not is_property(node):
        if not re.fullmatch(r"[A-Z][a-z]+", word):
            yield f"begins with {word!r}; expected a verb"
        elif word in NO_VERBS or (word.endswith(("s", "ed", "ing")) and word not in VERBS):
            yield f"begins with {word!r}; expected an imperative"
    elif word in NO_NOUNS or re.match(r"\.\.\.|[a-z]", text):
        yield f"begins with {word!r}; expected a noun phrase that stands alone"
    if text.endswith(("...", ",")):
        yield "ends in the middle of a sentence"


def documented(tree: ast.Module) -> Iterator[tuple[int, ast.AST, str]]:
    """Yield line, node and docstring of functions, classes and attributes."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and ast.get_docstring(node):
            yield node.lineno, node, str(ast.get_docstring(node))
        if isinstance(node, ast.ClassDef):
            for field, after in pairwise(node.body):
                is_text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
                if isinstance(field, (ast.AnnAssign, ast.Assign)) and is_text:
                    yield after.lineno, field, " ".join(str(after.value.value).split())


def is_setting(node: ast.AST) -> bool:
    """Return whether a node defines a setting. Its name is a key in people's files, and stays."""
    if not isinstance(node, ast.AnnAssign) or not isinstance(node.value, ast.Call):
        return False
    return isinstance(node.value.func, ast.Name) and node.value.func.id in SETTINGS


def defined_names(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield line and name of everything that a file defines, except settings."""
    keys = {id(node.target) for node in ast.walk(tree) if is_setting(node)}  # type: ignore[attr-defined]
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            if id(node) not in keys:
                yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr


def parts_of_name(name: str) -> set[str]:
    return {part.lower() for part in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", name)}


def module_functions(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    """Yield the functions and methods of a file, without properties and nested functions."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef):
            yield from module_functions(node)
        elif isinstance(node, ast.FunctionDef) and not is_property(node):
            yield node


def is_participle(name: str) -> bool:
    """Return whether a function's name is a past participle alone, as `sized` and `_shown`."""
    word = name.strip("_")
    regular = re.fullmatch(r"[a-z]+ed", word) is not None and word not in NO_PARTICIPLES
    return regular or word in PARTICIPLES


def prose(text: str, docstrings: list[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Yield line and text of the docstrings of `text` and of its comments."""
    yield from docstrings
    comments: list[tuple[int, str]] = []
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            comments.append((token.start[0], token.string.lstrip("#: ")))
    yield from comments
    for (line, first), (below, second) in pairwise(comments):
        if below == line + 1:  # a phrase may be broken between two lines
            yield line, f"{first.split(' ')[-1]} {second.split(' ')[0]}"


def faults_in(file: Path) -> Iterator[str]:
    """Yield what breaks the rules, with file and line."""
    text = file.read_text(encoding="utf-8")
    tree, where = ast.parse(text), file.relative_to(ROOT)
    docstrings = [(1, ast.get_docstring(tree) or "")]
    for line, node, docstring in documented(tree):
        docstrings.append((line, docstring))
        for fault in docstring_faults(node, docstring):
            yield f"{where}:{line}: the docstring {fault}"
    for line, passage in prose(text, docstrings):
        for word in BANNED_WORDS.finditer(" ".join(passage.split())):
            yield f"{where}:{line}: {word[0]!r} is none of the field's words"
    for line, name in defined_names(tree):
        if banned := parts_of_name(name) & BANNED_PARTS:
            yield f"{where}:{line}: the name {name} has {', '.join(sorted(banned))} in it"
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.name.endswith(ENDINGS):
            yield f"{where}:{node.lineno}: {node.name} ends with a preposition; expected an object"
    for function in module_functions(tree):
        if is_participle(function.name) or function.name.strip("_").split("_")[0] in PREPOSITIONS:
            yield f"{where}:{function.lineno}: {function.name} has no verb; expected one"


@pytest.mark.parametrize("room", sorted(files_by_room()))
def test_language_of_a_room(room: str) -> None:
    faults = [fault for file in files_by_room()[room] for fault in faults_in(file)]
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        ('def f():\n    """The mean of what it gets."""', "expected an imperative"),
        ('def f():\n    """Returns the mean."""', "expected an imperative"),
        ('def f():\n    """(N, 3) points."""', "expected a verb"),
        ('class C:\n    """What is known of a camera."""', "expected a noun phrase"),
        ('class C:\n    a: int = 1\n    """Of the lens."""', "expected a noun phrase"),
        ('class C:\n    a: int = 1\n    """Frames at most, and ..."""', "middle of a sentence"),
        ("# the person whom it lost\n", "'whom' is none"),
        ("# what was looked\n# for\n", "'looked for' is none"),
        ("said_lost = 1\n", "the name said_lost has said in it"),
        ("class OddOne:\n    pass\n", "the name OddOne has odd in it"),
        ("def poses_of(x):\n    pass\n", "ends with a preposition"),
        ("def _sized(x):\n    pass\n", "_sized has no verb"),
        ("class C:\n    def shown(self):\n        pass\n", "shown has no verb"),
        ("def beside_truth(x):\n    pass\n", "beside_truth has no verb"),
    ],
)
def test_rules_find_faults(
    source: str, fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "a.py"
    file.write_text(source)
    monkeypatch.setitem(globals(), "ROOT", tmp_path)
    faults = list(faults_in(file))
    assert len(faults) == 1 and fault in faults[0]
