"""Draw sentences by a seed from guides, page, messages and fields, for a person to judge; argument: seed."""

from __future__ import annotations

import ast
import random
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]


def prose(text: str) -> Iterator[str]:
    """Yield the paragraphs, list items and table cells of Markdown, without code."""
    text = re.sub(r"^ *```.*?^ *```", "", text, flags=re.MULTILINE | re.DOTALL)
    for block in re.split(r"\n\s*\n|\n(?=\s*(?:[*-]|\d+\.) )|\n(?=[|:])", text):
        if not block.startswith(("#", "    ", "{", "|--")):
            yield from (block.split("|") if block.startswith("|") else [block])


def text_of(node: ast.AST) -> str:
    """Return the text of an expression of strings, with … for what is inserted."""
    values = [getattr(one, "value", None) for one in ast.walk(node) if isinstance(one, ast.expr)]
    return "…".join(each for each in values if isinstance(each, str))


def strings(path: Path, *, fields: bool) -> Iterator[str]:
    """Yield the descriptions of fields of a module, or the other texts that it passes to functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            named = {one.arg: one.value for one in node.keywords}
            nodes = (
                [named["description"]] if fields and "description" in named else [] if fields else node.args
            )
            yield from (text for text in map(text_of, nodes) if "\n" not in text)


def pools() -> dict[str, list[str]]:
    """Return all sentences by where people read them."""
    guides = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    words = (ROOT / "dashboard/src/i18n/en.ts").read_text("utf-8")
    page = re.findall(r'"((?:[^"\\\n]|\\.)*)"|`((?:[^`\\]|\\.)*)`', words)
    code = [path for room in ("solver", "service") for path in sorted((ROOT / room).rglob("*.py"))]
    texts = {
        "guides": [part for path in guides for part in prose(path.read_text("utf-8"))],
        "page": [first or second for first, second in page],
        "messages": [text for path in code for text in strings(path, fields=False)],
        "fields": [text for path in (ROOT / "schemas").rglob("*.py") for text in strings(path, fields=True)],
    }
    whole = {name: [" ".join(text.split()) for text in found] for name, found in texts.items()}
    return {
        name: sorted({s for w in found for s in re.split(r"(?<=[.!?]) ", w)}) for name, found in whole.items()
    }


if __name__ == "__main__":
    chance = random.Random(int(sys.argv[1]))  # noqa: S311 - a sample, no secret
    for name, sentences in pools().items():
        for sentence in chance.sample([one for one in sentences if one.count(" ") > 2], 25):
            sys.stdout.write(f"{name}: {sentence}\n")
