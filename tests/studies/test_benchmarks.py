"""The command `python -m benchmarks`: its names lead to functions, and what is missing is said."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.__main__ import BENCHMARKS
from benchmarks.record import BEGIN, END, PAGE, rewritten
from benchmarks.report import Figure

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_name_leads_to_a_function(name):
    benchmark = BENCHMARKS[name]
    path = ROOT / "benchmarks" / f"{benchmark.module.replace('.', '/')}.py"
    functions = [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)]
    function = next(each for each in functions if each.name == "run")
    assert [each.arg for each in function.args.kwonlyargs] == ["quick", *["part"] * benchmark.in_parts]


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
    head = ["", "| benchmark | figure | measured | asked |", "|---|---|---|---|"]
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


def test_the_page_has_room_for_recorded_figures():
    assert PAGE.read_text(encoding="utf-8").count(BEGIN) == PAGE.read_text(encoding="utf-8").count(END) == 1


@pytest.mark.process
def test_without_the_development_set_up_it_says_what_to_run():
    command = [sys.executable, "-S", "-m", "benchmarks", "small"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "run scripts/setup requirements-dev.lock, then .venv/bin/python -m benchmarks" in done.stderr
    assert "Traceback" not in done.stderr
