"""One place whitens readings, `mechanics/measurements.py`, and one compresses rows, `triangle.py`."""

import ast
from pathlib import Path

from support.sources import nodes

SOLVER = Path(__file__).parents[2] / "solver"
WHITENED_BY_THEMSELVES = {"estimation/method.py", "geometry/poses.py", "geometry/frames.py"}
"""Maps of methods, and positions of geometry, which are no deflections."""


def _nodes():
    for path in SOLVER.rglob("*.py"):
        name = path.relative_to(SOLVER).as_posix()
        yield from ((name, node) for node in nodes(path))


def _compresses(node):
    """Tell whether a node is a QR that keeps the triangle alone; one with pivoting asks for an order."""
    if not isinstance(node, ast.Call) or ast.unparse(node.func).split(".")[-1] != "qr":
        return False
    keywords = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
    return keywords.get("mode") == "'r'" and "pivoting" not in keywords


def test_only_the_triangle_compresses():
    places = {name for name, node in _nodes() if _compresses(node)}
    assert places == {"estimation/triangle.py"}


def test_only_readings_whiten_deflections():
    named = {
        name
        for name, node in _nodes()
        if isinstance(node, ast.ImportFrom) and any(alias.name == "whitener" for alias in node.names)
    }
    assert named == WHITENED_BY_THEMSELVES


def test_only_terms_know_the_columns_of_a_term():
    users = {
        name
        for name, node in _nodes()
        if isinstance(node, ast.Attribute) and node.attr == "motion" and not name.startswith("mechanics/")
        if isinstance(node.value, ast.Name) and node.value.id.isupper()
    }
    assert not users
