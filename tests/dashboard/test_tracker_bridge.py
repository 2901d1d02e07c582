"""A tracker that writes into the page: paired by its code, shown before it is sent, two taps a reading."""

import re
import socket
import threading
import time
from contextlib import suppress
from typing import Self

import numpy as np
from playwright.sync_api import Page, expect
from support.live import ARM, declared, positions
from support.processes import started

from jointstiff.simulator import TARGETS

NOISE = 5e-6
"""Standard deviation of a coordinate in the stream [m]."""
COUNT = """
  window.counts = {taps: 0, scrolls: 0};
  addEventListener("click", (event) => { if (event.isTrusted) window.counts.taps += 1; }, true);
  addEventListener("scroll", () => { window.counts.scrolls += 1; }, true);
"""


SENT = dict(zip(TARGETS, ["P10", "P11", "SMR-7"], strict=True))
"""Target → its name at the tracker: the last one has another name there."""


class Stream:
    """A tracker next to an arm, which sends a line of each target ten times a second, over TCP."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.source = f"lines:tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self._random = np.random.default_rng(7)
        self._places = np.zeros((len(TARGETS), 3))  # in R0 [m]
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def drive(self, following: dict, state: str) -> None:
        """Put the arm in a posture, without its load or bent by it, by springs that balance it exactly."""
        self._places = positions(ARM, following["joints"], following["force"], sigma=0.0)[state]

    def _serve(self) -> None:
        connection, _ = self._listener.accept()
        with connection, suppress(OSError):
            while True:
                read = self._places + NOISE * self._random.standard_normal(self._places.shape)
                lines = [
                    f"{SENT[name]} {x:.6f} {y:.6f} {z:.6f}\n"
                    for name, (x, y, z) in zip(TARGETS, 1e3 * read, strict=True)
                ]
                connection.sendall("".join(lines).encode())
                time.sleep(0.1)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.join(10.0)
        self._listener.close()


def paired(page: Page) -> str:
    """Pair a tracker on the page; return the code."""
    page.get_by_text("Tracker", exact=True).click()
    page.get_by_role("button", name="Pair a tracker").click()
    code = page.locator("output.pairing")
    expect(code).to_have_text(re.compile(r"^[2-9A-Z]{4}-[2-9A-Z]{4}$"))
    assert code.inner_text() in page.locator("pre.command").inner_text()
    return code.inner_text()


def name_of_the_last(page: Page) -> None:
    """Answer once which target the tracker's other name is."""
    question = page.get_by_label("Which target is “SMR-7”")
    question.select_option("P12")
    expect(question).to_have_count(0)
    page.evaluate("scrollTo(0, 0)")
    page.wait_for_timeout(300)


def test_a_tracker_fills_the_form_and_a_reading_costs_two_taps(visit, api):
    """A phone, a real service, the command at the tracker's computer, and no scrolling between readings."""
    with Stream() as stream:
        measured(visit("phone"), api, stream)


def measured(visited, api, stream):
    """Measure five readings with a stream."""
    page = visited.page
    campaign = declared(api)
    address = f"{campaign}/next"
    visited.go(f"#/measure/{campaign.rpartition('/')[2]}")
    expect(page.get_by_role("heading", name="Next: m01")).to_be_visible()
    code = paired(page)
    arguments = ["--bridge", stream.source, "--server", visited.url, "--code", code]
    with started("measure", *arguments):
        expect(page.get_by_text("connected", exact=True)).to_be_visible()
        page.evaluate("scrollTo(0, 0)")
        page.wait_for_timeout(300)
        boxes = page.locator(".live-readings input")
        jumped = page.get_by_role("status").filter(has_text="the source has jumped")
        expect(jumped).to_be_visible()  # the arm is not in its posture yet
        stream.drive(api.get(address).json()["next"], "unloaded")
        name_of_the_last(page)
        page.evaluate(COUNT)
        for number in range(1, 6):
            following = api.get(address).json()["next"]
            assert following["label"] == f"m{number:02d}"
            expect(page.get_by_role("heading", name=f"Next: m{number:02d}")).to_be_visible()
            stream.drive(following, "unloaded")
            keep = page.get_by_role("button", name="Keep, then load")
            expect(keep).to_be_enabled()
            keep.tap()
            stream.drive(following, "loaded")
            moved = page.get_by_role("status").filter(has_text=re.compile(r"moved up to [1-9]\d*\.\d\d mm"))
            expect(moved).to_be_visible()
            shown = [float(box.input_value().replace("\u2212", "-")) for box in boxes.all()]
            page.get_by_role("button", name="Send reading").tap()
            expect(page.get_by_role("heading", name=f"Next: m{number + 1:02d}")).to_be_visible()
            sent = api.get(campaign).json()["observations"][-1]
            true = positions(ARM, following["joints"], following["force"], sigma=0.0)
            for i, each in enumerate(sent["readings"]):
                for state in ("unloaded", "loaded"):
                    assert np.abs(np.array(each[state]) - true[state][i]).max() < 6 * NOISE
            first = sent["readings"][0]["unloaded"]
            assert [round(1e3 * part, 4) for part in first] == shown[:3]  # what was shown was sent
        assert page.evaluate("window.counts") == {"taps": 10, "scrolls": 0}
        assert [each["state"] for each in api.get(address).json()["readings"]] == ["counts"] * 5
        page.reload()  # the tab stays paired
        expect(jumped).to_be_visible()
        stream.drive(api.get(address).json()["next"], "unloaded")
        expect(page.get_by_role("button", name="Keep, then load")).to_be_enabled()
        page.locator("summary", has_text="Tracker").click()
        page.get_by_role("button", name="Disconnect").click()
        expect(page.get_by_role("button", name="Pair a tracker")).to_be_visible()
