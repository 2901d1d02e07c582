"""What is wrong with a view of the page, as eyes and fingers find it."""

import re
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Page
from support.browsing import DASHBOARD, MOST_SHIFT, SHIFTS, Visit

LOOK = Path(__file__).with_name("seeing.js").read_text(encoding="utf-8")
AXE = DASHBOARD / "node_modules" / "axe-core" / "axe.min.js"
MEDIA = {"print": ("print", "light"), "dark": ("screen", "dark"), "light": ("screen", "light")}
PHONE, PAPER, DESK = 400, 650, 1000
"""A phone is at most this wide, paper and a desk at least [px]."""
ROW = {"phone": 72, "desk": 44}
"""Most that a row of a list or a table is high [px]."""
FIRST, FIRST_STIFFNESS = 400, 420
"""A phone shows the first number of a result, and the first stiffness of a run, within this height [px]."""
TARGET = {"phone": 40, "tablet": 44}
"""Least size of what a finger taps [px]: a phone shows a whole reading on one screen."""
WORDS = {"phone": 200, "desk": 400}
"""Most words above the fold."""
WORDS_OF_A_RESULT = 120
"""Most words above the fold of a result, for every verdict."""
HIGHEST = 20_000
"""Most that a view is high [px]."""
ASKING = (
    *("/report", "}/map", "/correct", "/predict", "/new", "plans?robot={robot}", "?set={set}"),
    *("of-this-name", "compare/methods", "compare/pairs", "#/wall"),
    *("{cancelled}", "{deleted}", "{running}", "{queued}", "{empty_map}", "{live_fresh}"),
    *("plans?step=1", "#/gearboxes"),
    *("trend/{cobot}", "trend/{bare}", "plans?robot={cobot}", "measure?robot={cobot}"),
)
"""Views that ask, hand out files, or have nothing to show: they have no number of their own to show first."""
IS_RUN = re.compile(r"#/runs/\{\w+\}$")


OPENED = "document.querySelectorAll('details:not(.display)').forEach((e) => { e.open = true; })"
COLOURS = {"runOnly": {"type": "rule", "values": ["color-contrast", "link-in-text-block"]}}
"""All that differs between the themes."""


def limits_of_first(view: str, width: int) -> list[int]:
    """Return the most words, height, and room above the first number and stiffness [px]; 0 for no limit."""
    words = WORDS["phone"] if width <= PHONE else WORDS["desk"]
    if IS_RUN.match(view):
        words = WORDS_OF_A_RESULT
    if width > PHONE or view.startswith("#/ ") or view == "#/" or view.endswith(ASKING):
        return [words, HIGHEST, 0, 0]
    if IS_RUN.match(view):
        return [words, HIGHEST, 0, FIRST_STIFFNESS]
    return [words, HIGHEST, FIRST, 0]


def limits(width: int, media: str) -> list[float | bool]:
    """Return whether it is paper, and the most height of a row [px]; 0 for no limit."""
    row = ROW["phone"] if width <= PHONE else ROW["desk"] if width >= DESK else 0
    return [media == "print" and width >= PAPER, 0 if media == "print" else row]


class Eyes:
    """What is wrong with views at a width, in some media."""

    def __init__(self, visited: Visit, width: int, media: tuple[str, ...], axe: str | None) -> None:
        """Look at pages of a width; `axe` is the text of axe-core, None to leave it out."""
        self.visited, self.page, self.width, self.media, self.axe = visited, visited.page, width, media, axe
        self.faults: dict[str, list[str]] = {}
        self.pairs: set[str] = set()
        self.page.add_init_script(SHIFTS)
        self.page.set_viewport_size({"width": width, "height": 844 if width <= PHONE else 1000})

    def look(self, view: str, address: str, act: Callable[[Page], None] | None) -> None:
        """Open a view, act there, and note what is wrong."""
        self.page.emulate_media(media="screen", color_scheme="light")
        self.visited.go(address)
        self.visited.settle()
        if act is not None:
            act(self.page)
            self.visited.settle()
        self.page.evaluate(LOOK)
        self.page.evaluate("drawn()")
        if act is None and (shift := self.page.evaluate("window.shifted")) > MOST_SHIFT:
            moved = self.page.evaluate("window.moved")
            self._note(view, "loading", [f"what is shown moves by {shift:.2f}: {moved}"])
        limits_at_first = limits_of_first(view, self.width)
        self._note(view, "loading", self.page.evaluate("(limits) => first(...limits)", limits_at_first))
        for media in self.media:
            self._look_in(view, media)
        self.page.emulate_media(media="screen", color_scheme="light")
        self.pairs |= set(self.page.evaluate("pairs()"))
        if self.axe is not None:
            self.page.evaluate(self.axe)
            self._note(view, "axe", accessibility_faults(self.page, TARGET["phone"]))

    def _look_in(self, view: str, media: str) -> None:
        """Look at the view that is open in a medium, with all that is folded opened and boxes filled."""
        medium, scheme = MEDIA[media]
        self.page.emulate_media(media=medium, color_scheme=scheme)
        self.page.evaluate(OPENED)
        self.page.evaluate("typed()")
        self.page.evaluate("drawn()")
        seen = self.page.evaluate("(limits) => seeing(...limits)", limits(self.width, media))
        self._note(view, media, seen)
        if media != "print":
            self._note(view, media, self.page.evaluate("ill()"))

    def _note(self, view: str, media: str, faults: list[str]) -> None:
        for fault in faults:
            self.faults.setdefault(f"{view}: {fault}", []).append(media)


def accessibility_faults(page: Page, target: int) -> list[str]:
    """What axe-core finds in light, and of the colours in dark; targets smaller than `target` [px]."""
    page.emulate_media(color_scheme="light")
    faults = page.evaluate("check({})")
    page.emulate_media(color_scheme="dark")
    faults += [f"dark: {fault}" for fault in page.evaluate("(rules) => check(rules)", COLOURS)]
    return faults + page.evaluate("(least) => small(least)", target)
