"""Files that the guides name exist."""

from __future__ import annotations

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
