"""Flows on the page as text: a user's action or what is seen on each line.

A flow begins with `== its name`. A name that ends with `!` is the whole name of a field or button; a text in
slashes is a pattern. `{run}` and its like are ids of what is stored, `{last}` is the end of the address.
"""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx2
from playwright.sync_api import Locator, Page, expect
from support.browsing import Visit, file_of
from support.processes import until


def flows_of(path: Path) -> dict[str, list[str]]:
    """Return the lines of each flow of a file, by its name."""
    parts = path.read_text(encoding="utf-8").split("== ")[1:]
    return {name: body.splitlines() for name, _, body in (part.strip().partition("\n") for part in parts)}


@dataclass
class Flow:
    """Someone who carries out a flow."""

    visit: Callable[..., Visit]
    api: httpx2.Client
    files: dict[str, Any]  # contents by the name that a flow has for them, behind `@`
    values: dict[str, str | Callable[[], str]]  # of placeholders, or how they are made when they are needed
    visited: Visit = field(init=False)
    asked: list[str] = field(default_factory=list)  # by the page, in dialogs
    taps: int = 0
    sets: int = 0  # in the service before what is done

    @property
    def page(self) -> Page:
        """The page that is open."""
        return self.visited.page

    def carry_out(self, lines: list[str]) -> None:
        """Carry out the lines, one after the other."""
        for line in lines:
            if "{last}" in line or line.startswith("keep "):
                self.values["last"] = self.page.url.rsplit("/", 1)[1]
            for name in [name for name in self.values if f"{{{name}}}" in line]:
                if callable(made := self.values[name]):
                    self.values[name] = made()
                line = line.replace(f"{{{name}}}", str(self.values[name]))
            verb, _, rest = line.partition(" ")
            if verb:
                VERBS[verb](self, *rest.split(" = ", 1))

    def opened(self, page: str) -> None:
        """Open a page of a size at a view."""
        size, _, view = page.partition(" #")
        self.visited = self.visit(size, view=f"#{view}")

    def labelled(self, label: str) -> Locator:
        """Find a field."""
        return self.page.get_by_label(label.removesuffix("!"), exact=label.endswith("!"))

    def named(self, role: Any, name: str) -> Locator:
        """Find a button or a link."""
        return self.page.get_by_role(role, name=name.removesuffix("!"), exact=name.endswith("!"))

    def first(self, selector: str) -> Locator:
        """Find the first of what a selector finds."""
        return self.page.locator(selector).first

    def content(self, text: str) -> Any:
        """Return what stands here, or what has the name behind `@`."""
        return self.files[text[1:]] if text.startswith("@") else text

    def chosen(self, name: str, content: str) -> None:
        """Choose a file."""
        self.first("input[type=file]").set_input_files(file_of(name, self.content(content)))

    def tap(self, selector: str) -> None:
        """Tap on the first of what a selector finds."""
        self.taps += 1
        self.page.wait_for_load_state("networkidle")  # what still comes would move the page under the finger
        self.first(selector).tap()

    def unfolded(self, selector: str) -> None:
        """Open what a phone folds away; on a larger screen it is in view."""
        if self.page.locator(selector).count() > 0:
            self.first(selector).click()

    def picked_up(self, name: str, content: str) -> None:
        """Choose a file by two taps: one for the chooser, one in it."""
        with self.page.expect_file_chooser() as chooser:
            self.tap("text=Choose file")
        self.taps += 1
        chooser.value.set_files(file_of(name, self.content(content)))

    def has_tapped(self, most: str) -> None:
        """Have tapped at most so often."""
        assert self.taps <= int(most)

    def count_sets(self, more: str = "") -> None:
        """Count the sets of the service, or find so many more than before."""
        count = len(self.api.get("/v1/measurement-sets?limit=100").json()["items"])
        if more:
            assert count == self.sets + int(more)
        self.sets = count

    def seen_in_every(self, selector: str, text: str) -> None:
        """See a text in all that a selector finds."""
        expect(self.first(selector)).to_be_visible()
        assert all(text in each for each in self.page.locator(selector).all_inner_texts())

    def found(self, path: str) -> Any:
        """Return a value of what the service has, by address and way: `runs/1 request.name`."""
        address, _, way = path.partition(" ")
        value = self.api.get(f"/v1/{address}").json()
        for key in way.split("."):
            value = value[int(key) if key.isdigit() else key]
        return value

    def held(self, path: str, value: str) -> None:
        """Find a value in what the service has."""
        found, wanted = self.found(path), pattern(value)
        if isinstance(wanted, str):
            assert found == json.loads(wanted), path
        else:
            assert wanted.search(str(found)), (path, found)

    def missing(self, address: str) -> None:
        """Find nothing at an address of the service."""
        assert self.api.get(f"/v1/{address}").status_code == 404

    def answered(self, text: str) -> None:
        """Answer the question that the page asks: `yes`, `no`, or a text."""
        dialog = self.page.get_by_role("dialog")
        self.asked.append(dialog.inner_text())
        if text not in {"yes", "no"}:
            dialog.get_by_role("textbox").fill(text)
        dialog.get_by_role("button", name="Cancel" if text == "no" else "Continue").click()
        expect(dialog).to_have_count(0)

    def was_asked(self, number: str, text: str) -> None:
        """Have been asked so often, the first time in such words."""
        assert len(self.asked) == int(number)
        assert text in self.asked[0]

    def downloaded(self, name: str, file: str) -> None:
        """Follow a link to a file whose name ends with words and the number of a job: `map NUMBER.csv`."""
        stem, _, suffix = file.rpartition(".")
        words, _, number = stem.rpartition(" ")
        with self.page.expect_download() as download:
            self.named("link", name).click()
        assert download.value.suggested_filename.endswith(f" {words} {number[:8]}.{suffix}")

    def saved(self, selector: str, begin: str) -> None:
        """Tap on a link to a file, which begins with these letters."""
        with self.page.expect_download() as download:
            self.tap(selector)
        assert download.value.path().read_bytes().startswith(begin.encode())

    def tapped(self, selector: str, place: str) -> None:
        """Tap on a place of what a selector finds, by px from the left and a share of the height."""
        box, (x, y) = self.first(selector).bounding_box(), map(float, place.split())
        assert box is not None
        self.first(selector).tap(position={"x": x, "y": y * box["height"]})

    def tabbed(self, selector: str) -> None:
        """Go by keyboard to what a selector finds."""
        for _ in range(80):
            if self.first(selector).evaluate("e => e === document.activeElement"):
                return
            self.page.keyboard.press("Tab")
        raise AssertionError(f"{selector} cannot be reached")

    def turned(self, selector: str, key: str) -> None:
        """Press a key that changes a picture."""
        before = self.first(selector).screenshot()
        self.page.keyboard.press(key)
        until(lambda: self.first(selector).screenshot() != before)

    def one_restored(self, collection: str) -> None:
        """Press the first of the buttons *Restore*, one for each that the service has deleted; it goes."""
        buttons = self.page.get_by_role("button", name="Restore")
        before = len(self.api.get(f"/v1/{collection}").json()["items"])
        expect(buttons).to_have_count(before)
        buttons.first.click()
        expect(buttons).to_have_count(before - 1)

    def unstored(self, name: str) -> None:
        """Find no set of a name in the service."""
        sets = self.api.get("/v1/measurement-sets?limit=100").json()["items"]
        assert name not in {each["name"] for each in sets}


def pattern(text: str) -> str | re.Pattern[str]:
    """Return a text, or the pattern between slashes."""
    return re.compile(text[1:-1]) if len(text) > 2 and text[0] == text[-1] == "/" else text


# What the page keeps on this device for a reload, as JSON: drafts of forms, files with what was said of them.
KEPT = """async () => {
    const opened = indexedDB.open("jointstiff");
    const database = await new Promise((done) => { opened.onsuccess = () => done(opened.result); });
    const all = database.transaction("kept").objectStore("kept").getAll();
    const files = await new Promise((done) => { all.onsuccess = () => done(all.result); });
    database.close();
    return JSON.stringify([{...sessionStorage}, files]);
}"""

VERBS: dict[str, Callable[..., object]] = {
    "given": lambda *_: None,  # what a placeholder stands for, made here
    "on": Flow.opened,
    "go": lambda flow, view: flow.visited.go(view),
    "reload": lambda flow, _: flow.page.reload(),
    "back": lambda flow, _: flow.page.go_back(),
    "press": lambda flow, name: flow.named("button", name).click(),
    "follow": lambda flow, name: flow.named("link", name).click(),
    "pick": lambda flow, name: flow.named("radio", name).check(),
    "touch": lambda flow, label: flow.labelled(label).click(),
    "click": lambda flow, selector: flow.first(selector).click(),
    "fill": lambda flow, label, value="": flow.labelled(label).fill(flow.content(value)),
    "select": lambda flow, label, option: flow.labelled(label).select_option(option),
    "second": lambda flow, label: flow.labelled(label).select_option(index=1),
    "check": lambda flow, label: flow.labelled(label).check(),
    "uncheck": lambda flow, label: flow.labelled(label).uncheck(),
    "file": Flow.chosen,
    "answer": Flow.answered,
    "asked": Flow.was_asked,
    "tap": Flow.tap,
    "unfold": Flow.unfolded,
    "taps": Flow.has_tapped,
    "choose": Flow.picked_up,
    "type": lambda flow, text: flow.page.keyboard.type(text),
    "sets": Flow.count_sets,
    "unpicked": lambda flow, name: expect(flow.named("radio", name)).not_to_be_checked(),
    "tapped": Flow.tapped,
    "download": Flow.downloaded,
    "save": Flow.saved,
    "remember": lambda flow, selector, name: flow.values.update({name: flow.first(selector).inner_text()}),
    "changed": lambda flow, selector, text: expect(flow.first(selector)).not_to_have_text(text),
    "hover": lambda flow, selector: flow.first(selector).hover(),
    "tab": Flow.tabbed,
    "turn": Flow.turned,
    "restore": Flow.one_restored,
    "key": lambda flow, name: flow.page.keyboard.press(name),
    "focus": lambda flow, selector: flow.first(selector).focus(),
    "read": lambda flow, path, name: flow.values.update({name: str(flow.found(path))}),
    "missing": Flow.missing,
    "see": lambda flow, text: expect(flow.page.get_by_text(pattern(text)).first).to_be_visible(),
    "gone": lambda flow, text: expect(flow.page.get_by_text(pattern(text))).to_have_count(0),
    "visible": lambda flow, selector: expect(flow.first(selector)).to_be_visible(),
    "within": lambda flow, selector, text: expect(flow.first(selector)).to_contain_text(pattern(text)),
    "every": Flow.seen_in_every,
    "count": lambda flow, selector, count: expect(flow.page.locator(selector)).to_have_count(int(count)),
    "shows": lambda flow, label, value: expect(flow.labelled(label)).to_have_value(pattern(value)),
    "lacks": lambda flow, label: expect(flow.labelled(label)).to_have_count(0),
    "picked": lambda flow, name: expect(flow.named("radio", name)).to_be_checked(),
    "kept": lambda flow, text: until(lambda: text in flow.page.evaluate(KEPT)),
    "disabled": lambda flow, name: expect(flow.named("button", name)).to_be_disabled(),
    "at": lambda flow, address: expect(flow.page).to_have_url(re.compile(address)),
    "drawn": lambda flow, _: flow.first("canvas[data-ready=true]").wait_for(),
    "keep": lambda flow, name: flow.values.update({name: flow.values["last"]}),
    "holds": Flow.held,
    "unstored": Flow.unstored,
}
"""Words of a flow; names are in the words of `Flow`, selectors those of Playwright."""
