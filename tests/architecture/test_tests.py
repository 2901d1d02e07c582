"""The shape of the tests: what they share lies in support/ and reference/."""

import ast
from collections import Counter
from pathlib import Path

from support.sources import nodes

TESTS = Path(__file__).parents[1]
FILES = sorted(TESTS.rglob("*.py"))
STUDIES = TESTS / "studies"
"""Its tests run the studies of benchmarks/; nobody else knows these."""


def imported(path: Path) -> set[str]:
    """Return the first parts of the names of the modules that a file imports."""
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.split(".")[0])
    return found


def test_tests_import_neither_tests_nor_benchmarks():
    tests = {path.stem for path in FILES if path.stem.startswith(("test_", "conftest"))} | {"tests"}
    wrong = {
        str(path.relative_to(TESTS)): found
        for path in FILES
        if (found := imported(path) & (tests if STUDIES in path.parents else tests | {"benchmarks"}))
    }
    assert not wrong


PATCHED: dict[str, int] = {}
"""How often private names are still replaced: the numbers may fall and never rise."""


def name_of(called: ast.expr) -> str:
    """Return the last part of what is called: `setattr` of `monkeypatch.setattr`."""
    return called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")


def patches_of_private_names(path: Path) -> int:
    """Count the calls of `monkeypatch.setattr` and `patch` that name something private."""
    calls = [node for node in nodes(path) if isinstance(node, ast.Call)]
    patching = [call for call in calls if name_of(call.func) in ("setattr", "patch", "object")]
    texts = [[a.value for a in call.args[:2] if isinstance(a, ast.Constant)] for call in patching]
    return sum(any(str(text).split(".")[-1].startswith("_") for text in each) for each in texts)


def test_no_further_private_names_are_patched():
    found = Counter({str(path.relative_to(TESTS)): patches_of_private_names(path) for path in FILES})
    assert +found == Counter(PATCHED)


def test_names_of_test_files_are_unique():
    """Two of one name cannot be collected together."""
    names = Counter(path.name for path in FILES if path.name.startswith("test_"))
    assert [name for name, count in names.items() if count > 1] == []
