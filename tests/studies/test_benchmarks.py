"""The command `python -m benchmarks`: its names lead to functions, and what is missing is said."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.__main__ import BENCHMARKS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_name_leads_to_a_function(name):
    benchmark = BENCHMARKS[name]
    path = ROOT / "benchmarks" / f"{benchmark.module.replace('.', '/')}.py"
    functions = [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)]
    function = next(each for each in functions if each.name == benchmark.function)
    assert [each.arg for each in function.args.kwonlyargs] == ["quick", *["part"] * benchmark.in_parts]


def test_every_benchmark_has_a_name():
    named = {benchmark.module for benchmark in BENCHMARKS.values()}
    for room in ("performance", "studies", "attacks"):
        for path in (ROOT / "benchmarks" / room).glob("*.py"):
            module = f"{room}.{path.stem}"
            assert ("\ndef run(*, quick: bool" in path.read_text()) <= (module in named), module


@pytest.mark.process
def test_without_the_development_set_up_it_says_what_to_run():
    command = [sys.executable, "-S", "-m", "benchmarks", "small"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "run scripts/setup requirements-dev.lock, then .venv/bin/python -m benchmarks" in done.stderr
    assert "Traceback" not in done.stderr
