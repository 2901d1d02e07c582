"""Lanes and groups of the suite: markers set from what a test uses, and a guard for tests that forget theirs.

Registered as a plugin by `tests/conftest.py`. A test that asks for a fixture of `LANES` has its markers; one
that starts a process by itself must say `@pytest.mark.process`, else the start is refused.
"""

import gc
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.shared_data import MISSING

LANES = {
    "postgresql_url": ("postgresql", "process"),
    "new_postgresql_database": ("postgresql", "process"),
    "services": ("process",),
    "built_wheel": ("process",),
    "node_modules": ("process",),
    "site": ("process",),
    "template": ("process",),
    "browser": ("browser", "process"),
}
"""Markers of the tests that use a fixture, directly or through others."""

OF_PROCESSES = ("dashboard", "e2e")
"""Folders all of whose tests start processes: not even imported where none is to be started."""

PAGE, SEEING, SERVICE = "page", "seeing", "service"
"""Groups of tests that share a browser, a filled database or a service: one worker runs all of a group."""

SPREAD = ("cases", "e2e")
"""Folders whose tests share nothing, so that any worker runs each. Other tests stay with their file."""

STARTS = frozenset(
    {"subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.spawn", "os.system", "pty.spawn"}
)
"""Audit events of a process that begins."""

ASK_FOR_THE_MACHINE = ("platform", "matplotlib.font_manager")
"""Modules of libraries that may start a process in any test: which they do depends on the machine alone."""


class Guard:
    """An audit hook that refuses processes while a test runs that is not marked as one that starts them."""

    def __init__(self) -> None:
        self.unmarked: str | None = None
        sys.addaudithook(self)

    def __call__(self, event: str, _: object) -> None:
        if self.unmarked and event in STARTS and not asks_for_the_machine():
            pytest.fail(f"{self.unmarked} starts a process ({event}): mark it @pytest.mark.process")

    def watch(self, item: pytest.Item) -> Iterator[None]:
        """Watch one phase of a test."""
        self.unmarked = None if item.get_closest_marker("process") else item.nodeid
        try:
            return (yield)
        finally:
            self.unmarked = None


def asks_for_the_machine() -> bool:
    """Tell whether a library asks for the platform on import, or matplotlib for its fonts on first use."""
    frame = sys._getframe(1)
    while frame is not None and frame.f_globals.get("__name__") not in ASK_FOR_THE_MACHINE:
        frame = frame.f_back
    return frame is not None


guard = Guard()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    """Refuse processes of fixtures that `LANES` does not know."""
    return (yield from guard.watch(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Refuse processes of an unmarked test."""
    return (yield from guard.watch(item))


def pytest_configure(config: pytest.Config) -> None:
    """Let the seed of a random order (`-p randomly`) draw the order alone; tests draw what they always do."""
    if config.pluginmanager.hasplugin("randomly"):
        config.option.randomly_reset_seed = False


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Pass over whole folders that `-m` leaves out."""
    is_left_out = collection_path.name in OF_PROCESSES and "not process" in config.option.markexpr
    return True if is_left_out else None


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark a test by the fixtures and the kind of database that it uses."""
    names = {name for fixture in getattr(item, "fixturenames", ()) for name in LANES.get(fixture, ())}
    call = getattr(item, "callspec", None)
    if call and any(isinstance(value, str) and value == "postgresql" for value in call.params.values()):
        names |= {"postgresql", "process"}
    if any(item.get_closest_marker(name) for name in ("postgresql", "browser")):
        names.add("process")
    for name in sorted(names):
        item.add_marker(name)
    group = group_of(item)
    if group and item.config.pluginmanager.hasplugin("xdist"):
        item.add_marker(pytest.mark.xdist_group(group))


def group_of(item: pytest.Item) -> str | None:
    """Return the group of a test, whose fixtures one worker builds once; None if it shares nothing."""
    if item.path.name == "test_seeing.py":
        return SEEING
    if item.path.parent.name == "dashboard":
        return PAGE
    if "services" in getattr(item, "fixturenames", ()):
        return SERVICE
    return None if item.path.parent.name in SPREAD else item.path.stem


def rank_of(item: pytest.Item) -> int:
    """Return the place of a test in the order: long groups, then tests that wait, then tests that compute."""
    if item.path.parent.name == "dashboard":
        return 0 if item.path.name == "test_seeing.py" else 1
    if not item.get_closest_marker("process"):
        return 4
    return 2 if item.path.parent.name == "e2e" else 3


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Put tests with processes first, which wait while others compute; leave slow ones to `-m`."""
    items.sort(key=rank_of)
    if "slow" in config.option.markexpr:
        return
    slow = [item for item in items if item.get_closest_marker("slow")]
    if slow:
        config.hook.pytest_deselected(items=slow)
        items[:] = [item for item in items if not item.get_closest_marker("slow")]


def pytest_collection() -> None:
    """Collect no garbage while tests are collected."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Spare the garbage collector what was imported and collected: a tenth of the tests' time."""
    gc.freeze()
    gc.set_threshold(50_000, 20, 50)
    gc.enable()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say in one line which tests were skipped for want of the shared data."""
    skipped = terminalreporter.stats.get("skipped", [])
    count = sum(MISSING in str(report.longrepr) for report in skipped)
    if count:
        terminalreporter.write_line(f"{count} tests skipped: {MISSING}", yellow=True)
