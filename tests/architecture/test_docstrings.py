"""Docstrings begin with a verb or a noun, never with a relative clause or a genitive."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
REFUSED = (
    *("What", "Of", "Whether", "That", "Where", "How", "Why", "Which", "Who", "Whom", "Whose", "Those"),
    *("To", "As", "From", "On", "With", "Without", "Under", "Are", "Is", "Say", "Likewise"),
)
REFUSED_IN_FIELDS = {
    *REFUSED,
    "In",
    "By",
    "Its",
    "Likewise",
    "Who",
    "Whose",
    "When",
    "Which",
    "Along",
    "They",
}


def docstrings(folder: str) -> list[str]:
    """The docstrings of a folder's modules, classes and functions, each with its place."""
    found = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        for node in described(ast.parse(path.read_text(encoding="utf-8"))):
            text = ast.get_docstring(node)
            if text is not None:
                found.append(f"{path.relative_to(ROOT)}:{node.body[0].lineno}: {text}")
    return found


def described(node: ast.AST) -> Iterator[Any]:
    """A module, its classes and functions, and theirs; expressions have none."""
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        yield node
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt):
            yield from described(child)


@pytest.mark.parametrize("folder", ["solver", "service", "schemas", "examples", "benchmarks"])
def test_docstrings_begin_with_a_verb_or_a_noun(folder):
    texts = docstrings(folder)
    riddles = [text for text in texts if text.split(": ", 1)[1].split()[0].rstrip(",") in REFUSED]
    assert len(texts) > 20
    assert not riddles, "\n".join(riddles)


def descriptions(node: object, place: str = "") -> Iterator[tuple[str, str]]:
    """Every description in a document, with its place."""
    if isinstance(node, dict):
        if isinstance(node.get("description"), str):
            yield place, node["description"]
        for key, value in node.items():
            yield from descriptions(value, f"{place}/{key}")
    elif isinstance(node, list):
        for i, value in enumerate(node):
            yield from descriptions(value, f"{place}/{i}")


def test_descriptions_of_the_api_begin_with_a_noun_or_a_verb(openapi):
    """They are the help of commands and the reference of the API, where they stand beside a bare name."""
    texts = list(descriptions(openapi))
    assert len(texts) > 1500
    first = [(place, text.split()[0].rstrip(",.;:"), text) for place, text in texts]
    assert not [each for each in first if each[1] in REFUSED_IN_FIELDS]
