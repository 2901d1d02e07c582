"""Terms that the glossary retires are in no text that people read: one word for one thing."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
GLOSSARY = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
ENTRIES = re.findall(r"^(\S.*)\n: (.*(?:\n  .*)*)", GLOSSARY, re.MULTILINE)
RETIRED = [term for _, text in ENTRIES for term in re.findall(r"`([^`]+)`", text.partition("Not: ")[2])]
READ = {
    "guides": [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), ROOT / "docker" / "README.md"],
    "page": [ROOT / "dashboard" / "src" / "i18n" / "en.ts"],
    "messages": [
        path for folder in ("schemas", "service", "solver") for path in (ROOT / folder).rglob("*.py")
    ],
}
"""Files by what they hold; messages and help are strings of the code."""


def words_of(path: Path) -> str:
    """Return the text of a file with strings joined and single blanks, without what the glossary retires."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        text = re.sub(r'"\s*\n\s*f?"', "", text)
    return " ".join(re.sub(r"Not: .*", "", text).split()).lower()


def test_the_glossary_retires_terms_and_is_short():
    assert len(RETIRED) >= 10
    assert {
        "compensate a program",
        "held-out postures",
        "reference campaign",
        "well determined",
        "work area",
    } <= {name for name, _ in ENTRIES}
    assert [name for name, text in ENTRIES if len(text) > 360] == []


@pytest.mark.parametrize("kind", READ)
def test_retired_terms_are_gone(kind):
    retired = re.compile("|".join(rf"\b{re.escape(term)}\b" for term in RETIRED))
    files = [path for path in READ[kind] if path.name != "CHANGELOG.md"]
    found = {
        f"{path.relative_to(ROOT)}: {one[0]}" for path in files for one in retired.finditer(words_of(path))
    }
    assert len(files) >= 1
    assert sorted(found) == []
