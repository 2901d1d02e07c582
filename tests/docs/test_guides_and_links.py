"""The pages as files: links lead somewhere in a checkout and in the sdist, and the words stay few."""

import re
import tomllib

import pytest
from support.guide_files import ROOT

LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
HERE = re.compile(r"https://github\.com/jointstiff/jointstiff/(?:blob|tree)/main/")
FENCE = re.compile(r"^ *```.*?^ *```", re.MULTILINE | re.DOTALL)
GUIDES = sorted((ROOT / "docs").glob("*.md"))
OTHERS = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "docker/README.md")
PAGES = [*(ROOT / name for name in OTHERS), *GUIDES]
MOST_WORDS = 28_000
"""Of the pages of docs/, code included; pages made from the code (docs/reference/) do not count."""
RECORD = "figures.md"
"""Record of measurements, which each study continues, so it does not count."""


def links_of(page):
    """Return the addresses of a page's links and pictures, without those in code."""
    return LINK.findall(FENCE.sub("", page.read_text(encoding="utf-8")))


def anchors_of(page):
    """Return the anchors of a page's headings, as GitHub and the site make them."""
    headings = re.findall(r"^#+ (.*)", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    plain = [re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings]
    return {heading.replace(" ", "-") for heading in plain}


def target_of(page, address):
    """Return file and anchor of a link to this repository; None for a link elsewhere."""
    inside = HERE.sub("", address)
    if "://" in inside or inside.startswith("mailto:"):
        return None
    path, _, anchor = inside.partition("#")
    folder = page.parent if inside == address else ROOT
    return (folder / path if path else page), anchor


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere_in_a_checkout(page):
    lost = []
    for address in links_of(page):
        target = target_of(page, address)
        if target is None:
            continue
        path, anchor = target
        made = path.resolve().is_relative_to(ROOT / "docs" / "reference")
        if made or not path.exists() or (anchor and anchor not in anchors_of(path)):
            lost.append(address)
    assert lost == []


def test_the_sdist_has_what_the_pages_link_to():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    included = tomllib.loads(text)["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    linked = {
        target[0].resolve().relative_to(ROOT)
        for page in PAGES
        for address in links_of(page)
        if (target := target_of(page, address))
    }
    assert sorted(str(path) for path in linked if path.parts and path.parts[0] not in included) == []


def test_the_guides_stay_short():
    words = sum(len(page.read_text(encoding="utf-8").split()) for page in GUIDES if page.name != RECORD)
    assert words <= MOST_WORDS, "say it once, or let the reference say it"
