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


def test_descriptions_of_fields_begin_with_a_noun():
    """They are the help of commands and the reference of the API, where they stand beside a bare name."""
    described, riddles = 0, []
    for path in sorted((ROOT / "schemas").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.keyword) and node.arg == "description":
                texts = [each.value for each in ast.walk(node.value) if isinstance(each, ast.Constant)]
                first = str(texts[0]).split()[0].rstrip(",.;") if texts else ""
                described += 1
                if first in {*REFUSED, "In", "By", "Its", "Likewise", "Who", "When"}:
                    riddles.append(f"{path.relative_to(ROOT)}:{node.value.lineno}: {texts[0]}")
    assert described > 800
    assert not riddles, "\n".join(riddles)
