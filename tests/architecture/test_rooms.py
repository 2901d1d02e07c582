"""The shape of the house: no room is crowded, and every package says what it is for."""

from pathlib import Path

import pytest

from jointstiff import solver

ROOT = Path(__file__).parents[2]
MOST_MODULES = 8
DOORS = {ROOT / "solver" / "__init__.py"}
"""Packages from which names are imported; every other module is imported by its name."""


@pytest.mark.parametrize("room", ["solver", "service"])
def test_few_modules_lie_in_a_room(room):
    assert len(list((ROOT / room).glob("*.py"))) <= MOST_MODULES


@pytest.mark.parametrize("room", ["solver", "service", "schemas"])
def test_packages_say_what_they_are_for(room):
    inits = sorted((ROOT / room).rglob("__init__.py"))
    silent = [path for path in inits if not path.read_text(encoding="utf-8").startswith('"""')]
    assert inits
    assert not silent


@pytest.mark.parametrize("room", ["solver", "service", "schemas"])
def test_packages_give_no_names_of_their_modules(room):
    doors = [
        path
        for path in (ROOT / room).rglob("__init__.py")
        if path not in DOORS and "__all__" in path.read_text(encoding="utf-8")
    ]
    assert not doors


def test_the_door_of_the_solver_gives_every_name_that_it_promises():
    given = {name: getattr(solver, name) for name in solver.__all__}
    assert all(value.__name__ == name for name, value in given.items())
