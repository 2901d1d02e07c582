"""The list of benchmarks and the mutants: each module runs, each mutant is one change."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest
from coverage import CoverageData

from benchmarks.__main__ import BENCHMARKS
from benchmarks.record import BEGIN, END, PAGE, rewritten
from benchmarks.report import Figure
from benchmarks.studies.forks import replace_code
from benchmarks.studies.mutants import ROOT, Lane, Mutant, mutants_of


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_name_leads_to_a_function(name):
    benchmark = BENCHMARKS[name]
    path = ROOT / "benchmarks" / f"{benchmark.module.replace('.', '/')}.py"
    functions = [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)]
    function = next(each for each in functions if each.name == "run")
    options = ["part"] * benchmark.in_parts
    assert [each.arg for each in function.args.kwonlyargs] == ["quick", *options]


def test_every_benchmark_has_a_name():
    named = {benchmark.module for benchmark in BENCHMARKS.values()}
    for room in ("performance", "studies", "attacks"):
        for path in (ROOT / "benchmarks" / room).glob("*.py"):
            module = f"{room}.{path.stem}"
            assert ("\ndef run(*, quick: bool" in path.read_text()) <= (module in named), module


FIGURES = [Figure("a | b", 0.5, "at most", 1.0, " m"), Figure("c", 2.0, "at least", 3.0)]


def test_recorded_figures_are_of_one_commit():
    page = f"before\n{BEGIN}\n{END}\nafter\n"
    first = rewritten(page, "Commit a:", {"y": FIGURES[:1], "x": FIGURES[1:]})
    rows = ["| `x` | c | 2 **not met** | ≥ 3 |", "| `y` | a \\| b | 0.5 m | ≤ 1 m |"]
    head = ["", "| benchmark | figure | measured | required |", "|---|---|---|---|"]
    assert first.splitlines() == ["before", BEGIN, "Commit a:", *head, *rows, END, "after"]
    again = rewritten(first, "Commit a:", {"y": FIGURES[1:]})
    assert [line for line in again.splitlines() if "`" in line] == [rows[0], rows[0].replace("x", "y")]
    other = rewritten(again, "Commit b:", {"z": FIGURES[1:]})
    assert other.splitlines() == [
        "before",
        BEGIN,
        "Commit b:",
        *head,
        rows[0].replace("x", "z"),
        END,
        "after",
    ]


def test_a_number_with_two_bounds_has_one_row():
    figures = [Figure("c", 2.0, "at least", 1.0, " %"), Figure("c", 2.0, "at most", 1.5, " %")]
    page = rewritten(f"{BEGIN}\n{END}", "Commit a:", {"x": figures})
    assert "| `x` | c | 2 % **not met** | ≥ 1 %, ≤ 1.5 % |" in page.splitlines()


def test_the_page_has_room_for_recorded_figures():
    assert PAGE.read_text(encoding="utf-8").count(BEGIN) == PAGE.read_text(encoding="utf-8").count(END) == 1


@pytest.mark.process
def test_without_the_development_set_up_it_says_what_to_run():
    command = [sys.executable, "-S", "-m", "benchmarks", "small"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "run scripts/setup requirements-dev.lock, then .venv/bin/python -m benchmarks" in done.stderr
    assert "Traceback" not in done.stderr


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


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("solver/mechanics/robot.py", "jointstiff.solver.mechanics.robot"),
        ("packages/robotprograms/src/robotprograms/krl.py", "robotprograms.krl"),
    ],
)
def test_the_module_of_a_change_is_the_one_that_is_imported(path, name):
    assert Mutant(Path(path), 1, frozenset({1}), "", "a", "b").module == name


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
