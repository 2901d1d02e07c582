"""The commands of the guides, as they stand in the Markdown."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
_FENCE = re.compile(r"^```(sh|python)[ \t]*\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)


def blocks_of(guide: str) -> list[tuple[str, str]]:
    """Return language and text of the blocks of a guide that a reader may run."""
    return _FENCE.findall((ROOT / guide).read_text(encoding="utf-8"))


def guides() -> list[str]:
    """Return README and all pages of the documentation that have a block to run."""
    pages = ["README.md", *(f"docs/{page.name}" for page in sorted((ROOT / "docs").glob("*.md")))]
    return [page for page in pages if blocks_of(page)]
