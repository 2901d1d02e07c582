"""Docstrings begin with a verb or a noun, never with a relative clause or a genitive."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
REFUSED = ("What", "Of", "Whether", "That", "Where", "How")


def docstrings(folder: str) -> list[str]:
    """The docstrings of a folder's modules, classes and functions, each with its place."""
    found = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                text = ast.get_docstring(node)
                if text is not None:
                    found.append(f"{path.relative_to(ROOT)}:{node.body[0].lineno}: {text}")
    return found


@pytest.mark.parametrize("folder", ["solver", "service", "schemas", "examples", "benchmarks"])
def test_docstrings_begin_with_a_verb_or_a_noun(folder):
    texts = docstrings(folder)
    riddles = [text for text in texts if text.split(": ", 1)[1].split()[0].rstrip(",") in REFUSED]
    assert len(texts) > 20
    assert not riddles, "\n".join(riddles)
