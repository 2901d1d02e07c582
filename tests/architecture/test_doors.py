"""The shape of the house: packages are used through their doors, and no room is crowded."""

from __future__ import annotations

import importlib
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[2]
MOST_MODULES = 6
ROOMS = ("jointstiff.solver", "jointstiff.service")
"""Packages of messages are vocabularies: their modules are used by name."""
ROOTS = {
    "jointstiff.__main__",
    "jointstiff.service.app",
    "jointstiff.service.cli",
    "jointstiff.service.server",
}
"""Composition roots, which put modules together and import no more than they need."""


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    return grimp.build_graph("jointstiff", include_external_packages=False, cache_dir=None)


def package_of(module: str) -> str:
    """The child of a room that a module is in: `jointstiff.solver.robot` of `jointstiff.solver.robot.dh`."""
    return ".".join(module.split(".")[:3])


def test_packages_are_used_through_their_doors(graph):
    past = sorted(
        f"{importer} -> {imported}"
        for importer in graph.modules
        for imported in graph.find_modules_directly_imported_by(importer)
        if imported.startswith(ROOMS)
        and package_of(imported) not in (imported, package_of(importer))
        and package_of(importer) not in ROOTS
    )
    assert not past, "\n".join(past)


@pytest.mark.parametrize("room", ["solver", "service"])
def test_few_modules_lie_in_a_room(room):
    assert len(list((ROOT / room).glob("*.py"))) <= MOST_MODULES


def test_doors_say_what_they_offer(graph):
    for module in graph.modules:
        if module in ROOTS or package_of(module) != module or not module.startswith(ROOMS):
            continue
        if graph.find_children(module) and module.count(".") == 2:
            door = importlib.import_module(module)
            assert door.__doc__, module
            assert sorted(door.__all__) == sorted(set(door.__all__)), module
