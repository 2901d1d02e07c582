"""The study of small changes: expressions of functions, none of messages, and the tests that reach them."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest
from coverage import CoverageData

from benchmarks.studies.forks import replace_code
from benchmarks.studies.mutants import ROOT, Lane, Mutant, mutants_of

SOURCE = '''
LIMIT = 2 - 1

def least(a: "A | B", b: float = 3 - 1) -> float:
    """Return a - b."""
    if a < b:
        raise ValueError(f"{a - b} of é", 1 + 1)
    return min(a, -b)
'''


def test_each_change_is_one_expression_in_its_place(tmp_path):
    (tmp_path / "room").mkdir()
    path = tmp_path / "room" / "module.py"
    path.write_text(SOURCE, encoding="utf-8")
    changes = {(each.line, each.before, each.after): each for each in mutants_of(path, tmp_path)}
    assert set(changes) == {(6, "a < b", "(a > b)"), (8, "min", "(max)"), (8, "-b", "(b)")}
    for (_, before, after), change in changes.items():
        assert change.source == SOURCE.replace(
            f"if {before}" if "<" in before else before, f"if {after}" if "<" in before else after
        )


def test_a_change_is_judged_by_the_tests_that_reach_its_lines(tmp_path):
    """The most particular test first; a file whose fixtures reach a line is run whole."""
    path = Path("solver/arrays.py")
    data = CoverageData(str(tmp_path / "coverage"))
    for context, lines in {
        "": [1, 2, 3, 4],
        "tests/a.py::test_wide|run": [2, 3, 4],
        "tests/b.py::test_narrow[x]|run": [3],
        "tests/c.py::test_shares|run": [3],
        "tests/c.py::test_first|setup": [3],
        "tests/d.py::test_other|run": [4],
    }.items():
        data.set_context(context)
        data.add_lines({str((ROOT / path).resolve()): lines})
    data.write()
    change = Mutant(path, 3, frozenset({3}), "", "a", "b")
    tests, files = Lane(tmp_path / "coverage").tests(change)
    assert (tests[0], files) == ("tests/b.py::test_narrow[x]", ["tests/c.py"])
    assert tests.index("tests/a.py::test_wide") > tests.index("tests/c.py::test_shares")
    assert "tests/d.py::test_other" not in tests


def test_code_is_replaced_in_the_memory_of_an_imported_module(tmp_path, monkeypatch):
    path = tmp_path / "changed_in_memory.py"
    path.write_text(SOURCE + "\n\n@property\ndef other(self):\n    return 1\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("changed_in_memory")
    least = module.least
    assert least(4, 3) == -3
    source = path.read_text(encoding="utf-8")
    replace_code(path, source.replace("return min", "return max"))
    assert (least(4, 3), module.other.fget(None)) == (4, 1)
    with pytest.raises(LookupError):
        replace_code(path, source.replace("LIMIT = 2", "LIMIT = 3"))
