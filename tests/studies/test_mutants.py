"""The study of small changes finds the expressions of a function, and none of its messages."""

from __future__ import annotations

from benchmarks.studies.mutants import mutants_of

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
