"""Files that the guides name exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GUIDES = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), ROOT / "docker" / "README.md"]
NAMED = re.compile(r"`((?:solver|service|schemas|tests|examples|benchmarks|scripts|docker|docs)/[\w./-]+)`")


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.name)
def test_what_a_guide_names_is_there(guide):
    named = set(NAMED.findall(guide.read_text(encoding="utf-8")))
    assert not sorted(name for name in named if not (ROOT / name).exists())


@pytest.mark.parametrize(
    "guide", [*(ROOT / "docs").glob("*.md"), ROOT / "README.md"], ids=lambda path: path.name
)
def test_no_paragraph_has_more_than_five_lines(guide):
    text = re.sub(r"^ *```.*?^ *```", "", guide.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    parts = re.split(r"\n\s*\n|\n(?=\s*(?:[*-]|\d+\.) |[|:])", text)
    assert [
        part for part in parts if len(part) > 5 * 120 and not part.lstrip().startswith(("|", "    "))
    ] == []
