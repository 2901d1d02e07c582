"""The package imports the standard library and NumPy, and gives the names that it promises."""

import ast
import sys
from pathlib import Path

import robotprograms

SOURCES = sorted(Path(robotprograms.__file__).parent.glob("*.py"))
ALLOWED = {*sys.stdlib_module_names, "numpy", "robotprograms"}


def imported(path):
    """Return the first parts of the names of the modules that a file imports."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    return {name.split(".")[0] for name in names}


def test_the_standard_library_and_numpy_are_all_that_is_imported():
    found = {path.name: imported(path) - ALLOWED for path in SOURCES}
    assert len(found) > 10
    assert {name: others for name, others in found.items() if others} == {}


def test_each_public_name_is_there():
    assert sorted(robotprograms.__all__, key=str) == sorted(set(robotprograms.__all__))
    assert all(hasattr(robotprograms, name) for name in robotprograms.__all__)
