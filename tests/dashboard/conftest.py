"""The page in a real browser against a real service: what its tests share."""

import json
import os
import shutil
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import httpx2
import pytest
from playwright.sync_api import Browser, sync_playwright
from support.api import made, post
from support.browsing import (
    ARGUMENTS,
    DASHBOARD,
    LONGEST_MS,
    REQUIRE_CHROMIUM,
    ROOT,
    SIZES,
    Stored,
    Visit,
    campaign,
    run_npm,
)
from support.processes import Service, alone
from support.programs import path, small_program_options, tool_poses

from jointstiff.simulator import TARGETS, default_arm
from jointstiff.simulator.document import robot_document
from jointstiff.simulator.programs import program_text


@pytest.fixture(scope="session")
def node_modules(shared_folder: Path) -> Path:
    """What npm installs, once it is there."""
    folder = DASHBOARD / "node_modules"
    with alone(shared_folder / "page.lock"):
        if not folder.is_dir():
            done = run_npm("ci", "--ignore-scripts", "--no-progress", "--loglevel=error")
            assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.fixture(scope="session")
def bundle(node_modules: Path, shared_folder: Path) -> Path:
    """The page as it is served, built again if it is older than its sources."""
    page = ROOT / "service" / "static" / "index.html"
    sources = [p for p in (DASHBOARD / "src").rglob("*") if p.is_file() and p.name != "schema.d.ts"]
    sources += DASHBOARD.glob("*.*")
    with alone(shared_folder / "page.lock"):
        if not page.is_file() or page.stat().st_mtime < max(p.stat().st_mtime for p in sources):
            done = run_npm("run", "--silent", "build")
            assert done.returncode == 0, done.stdout + done.stderr
    return page.parent


@pytest.fixture(scope="session")
def site(bundle: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service of our own, with the page and an empty database."""
    running = Service(f"sqlite:///{tmp_path_factory.mktemp('page') / 'jointstiff.db'}")
    try:
        yield running
        assert running.process.poll() is None, running.log()
    finally:
        running.stop()


@pytest.fixture(scope="session")
def api(site: Any) -> Iterator[httpx2.Client]:
    """The API beside the page."""
    with httpx2.Client(base_url=site.url, timeout=None) as session:
        yield session


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """Chromium, or a skip that says why there is none.

    It ends with this folder: while it is there, an event loop runs in this thread, which others would meet.
    """
    found = shutil.which("chromium-headless-shell") or shutil.which("chromium")  # the first at half the time
    if found is None:
        reason = "no Chromium here: scripts/chromium"
        if os.environ.get(REQUIRE_CHROMIUM) == "1":
            pytest.fail(f"{reason} ({REQUIRE_CHROMIUM}=1)")
        pytest.skip(reason)
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=found, args=ARGUMENTS)
        try:
            yield running
        finally:
            running.close()


@pytest.fixture
def visit(site: Any, browser: Browser) -> Iterator[Callable[..., Visit]]:
    """Call it for a page of a size and theme, at a view; no script may have failed, no policy been broken."""
    contexts, visits = [], []

    def open_page(size: str = "tablet", theme: str = "light", view: str = "", service: Any = site) -> Visit:
        width, height = SIZES[size]
        context = browser.new_context(
            viewport={"width": width, "height": height},
            color_scheme=theme,
            has_touch=size != "desktop",
            base_url=service.url,
        )
        context.set_default_timeout(LONGEST_MS)
        contexts.append(context)
        visited = Visit(context.new_page(), service.url)
        visits.append(visited)
        visited.page.on("pageerror", lambda error: visited.faults.append(str(error)))
        visited.page.on("console", visited.note)
        visited.page.on("request", lambda request: visited.requests.append(request.url))
        if view:
            visited.go(view)
        return visited

    yield open_page
    for context in contexts:
        context.close()
    for visited in visits:
        assert visited.faults == []
        for request in visited.requests:
            assert request.startswith((visited.url, "about:", "blob:", "data:")), request


@pytest.fixture(scope="session")
def stored(api: httpx2.Client) -> Stored:
    """One of everything, in the service's database."""
    robot = post(api, "/v1/robots", robot_document(default_arm()))["id"]

    def add_job(kind: str, body: Any) -> str:
        """Post a job, and wait for its end."""
        return made(api, partial(api.post, f"/v1/{kind}?wait=60", json=body))

    def add(encoders: str, seed: int) -> str:
        document = campaign(load="dead_weight", encoders=encoders, seed=seed)["measurement_set"]
        return post(api, "/v1/measurement-sets", {**document, "robot_id": robot})["id"]

    first, second = add("motor", 3), add("secondary", 4)
    run = add_job("runs", {"measurement_set_id": first})
    other = add_job("runs", {"measurement_set_id": second})
    decoupled = {"measurement_set_id": first, "method": "decoupled_partial_pose"}
    runs = [run, add_job("runs", decoupled)]
    comparison = add_job("comparisons", {"run_ids": runs})
    pair = add_job("comparisons", {"run_ids": [run, other], "ordered": True})
    joints = [f"joint_{j}" for j in range(2, 7)]  # a weight never twists the first
    plan = add_job("plans", {"measurement_set_id": first, "readings": 6, "joints": joints})
    work = {"run_id": run, "area": [[1.2, -0.6, 0.6], [1.8, 0.6, 1.0]], "grid": [7, 9, 2]}
    tool = {"place": [0.0, 0.0, 0.25], "turns": 4, "force": [0.0, 0.0, -900.0]}
    work_map = add_job("maps", work | tool)
    program, live = corrected(api, run), opened(api, robot)
    return Stored(robot, first, second, run, comparison, pair, plan, work_map, program, live)


def opened(api: httpx2.Client, robot: str) -> str:
    """Return an open set with the readings of a small campaign."""
    document = campaign(load="dead_weight", configurations=5, seed=5)["measurement_set"]
    goal = {"kind": "joints", "relative": 0.02}
    options = {"goal": goal, "load": {"kind": "dead_weight", "force": 1500.0}, "candidates": 100}
    targets = {name: list(place) for name, place in TARGETS.items()}
    body = {**document, "robot_id": robot, "open": {**options, "targets": targets}}
    return str(post(api, "/v1/measurement-sets", body)["id"])


def corrected(api: httpx2.Client, run: str) -> str:
    """Return a small program, corrected by a run."""
    options = {"run_id": run} | small_program_options()
    file = ("corner.src", program_text("krl", tool_poses(path(6)), 4).encode())
    data = {"options": json.dumps(options)}
    return made(api, partial(api.post, "/v1/corrections?wait=60", data=data, files={"files": file}))
