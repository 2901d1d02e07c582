"""Small changes of the solver and the service, one at a time: does the daily lane notice each?

The daily lane runs once with coverage, which tells for each line the tests that reach it, wherever they
stand; a change is judged by those alone. A file whose fixtures reach the line is run whole, for its tests
share them.

A change is drawn from the expressions of a house: an operator becomes its opposite, a comparison turns
round, a sign goes, a least becomes a greatest. It is made in the memory of a fork; the project's files stay
as they are. Messages are left alone. A change that lives is listed with its place: either a test is missing
there, or the change changes nothing.
"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from coverage import CoverageData

from benchmarks.report import Figure, Part, Section
from benchmarks.studies.forks import CHANGES

__all__ = ["Judged", "Lane", "Mutant", "drawn", "judged", "measured_lane", "mutants_of", "run"]

MUTANTS = {"solver": 60, "service": 30, "packages/robotprograms/src/robotprograms": 15}
SEED = 8807
"""Draw anew once tests were written for what this one left: such a share says nothing of the others."""
LANE = ("-m", "not process and not slow")
ROOT = Path(__file__).parents[2]
OPPOSITE = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Lt: ast.Gt,
    ast.Gt: ast.Lt,
    ast.LtE: ast.Gt,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
OTHER = {"minimum": "maximum", "maximum": "minimum", "min": "max", "max": "min", "argmin": "argmax"}
OTHER |= {"argmax": "argmin", "any": "all", "all": "any", "sin": "cos", "cos": "sin"}


@dataclass(frozen=True)
class Mutant:
    """A change of one expression."""

    path: Path  # with the house first
    line: int
    lines: frozenset[int]  # that run with it: its own, and the first of its statement
    source: str = field(repr=False)  # of the whole module
    before: str
    after: str

    @property
    def module(self) -> str:
        """Name of the module as it is imported."""
        parts = self.path.with_suffix("").parts
        return ".".join(parts[parts.index("src") + 1 :] if "src" in parts else ("jointstiff", *parts))


@dataclass(frozen=True)
class Judged:
    """A change, and what the tests that reach it say."""

    mutant: Mutant
    noticed: bool
    seconds: float
    tests: int  # how many reach it


class Lane:
    """The daily lane: which of its tests reach a line."""

    def __init__(self, data: Path) -> None:
        """Read what coverage measured with the contexts of pytest-cov.

        Args:
            data: coverage's file.
        """
        self._data = CoverageData(str(data))
        self._data.read()
        self._reached = dict[str, int]()
        for path in self._data.measured_files():
            for contexts in self._data.contexts_by_lineno(path).values():
                for context in contexts:
                    test = context.rpartition("|")[0]
                    self._reached[test] = self._reached.get(test, 0) + 1

    def tests(self, mutant: Mutant) -> tuple[list[str], list[str]]:
        """Return the tests that reach a change, those that reach the fewest lines first, and whole files."""
        by_line = self._data.contexts_by_lineno(str((ROOT / mutant.path).resolve()))
        contexts = {each for line in mutant.lines for each in by_line.get(line, ()) if each}
        files = {each.partition("::")[0] for each in contexts if each.endswith("|setup")}
        tests = {each.rpartition("|")[0] for each in contexts}
        return sorted(tests, key=lambda test: (self._reached[test], test)), sorted(files)


class _Changes(ast.NodeVisitor):
    """Expressions that can be changed, each with what it becomes; none within messages."""

    def __init__(self) -> None:
        self.found = list[tuple[ast.expr, ast.expr, ast.stmt]]()
        self._statement: ast.stmt

    def visit(self, node: ast.AST) -> None:
        """Keep the statement visited; pass over texts and errors, and functions, which are visited alone."""
        if isinstance(node, ast.JoinedStr | ast.Raise | ast.FunctionDef | ast.AsyncFunctionDef):
            return
        if isinstance(node, ast.stmt):
            self._statement = node
        super().visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Pass over annotations."""
        if node.value is not None:
            self.visit(node.value)

    def generic_visit(self, node: ast.AST) -> None:
        """Take the changes of an expression."""
        if isinstance(node, ast.BinOp) and type(node.op) in OPPOSITE:
            self._found(node, ast.BinOp(node.left, OPPOSITE[type(node.op)](), node.right))  # type: ignore[arg-type]
        elif isinstance(node, ast.BoolOp):
            self._found(node, ast.BoolOp(OPPOSITE[type(node.op)](), node.values))  # type: ignore[arg-type]
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in OPPOSITE:
            ops = [OPPOSITE[type(node.ops[0])](), *node.ops[1:]]
            self._found(node, ast.Compare(node.left, ops, node.comparators))  # type: ignore[arg-type]
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not, ast.Invert)):
            self._found(node, node.operand)
        elif isinstance(node, ast.Attribute) and node.attr in OTHER:
            self._found(node, ast.Attribute(node.value, OTHER[node.attr], node.ctx))
        elif isinstance(node, ast.Name) and node.id in OTHER:
            self._found(node, ast.Name(OTHER[node.id], node.ctx))
        super().generic_visit(node)

    def _found(self, node: ast.expr, other: ast.expr) -> None:
        self.found.append((node, other, self._statement))


def mutants_of(path: Path, root: Path) -> Iterator[Mutant]:
    """Yield all changes of a module that are inside its functions.

    Args:
        path: of the module.
        root: the folder of the houses.
    """
    text = path.read_text(encoding="utf-8")
    lines = text.encode().splitlines(keepends=True)
    starts = np.r_[0, np.cumsum([len(line) for line in lines])]
    for function in ast.walk(ast.parse(text)):
        if not isinstance(function, (ast.FunctionDef, ast.AsyncFunctionDef)):
            continue
        changes = _Changes()
        for statement in function.body:
            changes.visit(statement)
        for node, other, statement in changes.found:
            if node.end_lineno is None or node.end_col_offset is None:
                continue
            reached = frozenset({statement.lineno, *range(node.lineno, node.end_lineno + 1)})
            start = int(starts[node.lineno - 1]) + node.col_offset
            end = int(starts[node.end_lineno - 1]) + node.end_col_offset
            after = f"({ast.unparse(other)})"
            source = text.encode()[:start] + after.encode() + text.encode()[end:]
            before, place = ast.unparse(node), path.relative_to(root)
            yield Mutant(place, node.lineno, reached, source.decode(), before, after)


def run(*, quick: bool, part: Part) -> list[Section]:
    """Draw changes, and judge each by the tests that reach it."""
    with TemporaryDirectory() as folder:
        lane = measured_lane(Path(folder), quick=quick)
        sections = []
        for house in MUTANTS:
            chosen, total = drawn(house, part)
            sections.append(
                _section(house, total, judged(chosen[: 1 if quick else None], lane, Path(folder)))
            )
        return sections


def measured_lane(folder: Path, *, quick: bool = False) -> Lane:
    """Run the daily lane once with coverage, which must be green, and return the tests of each line.

    Args:
        folder: of coverage's file.
        quick: only the tests of this study.
    """
    data = folder / "coverage"
    measured = [
        "--cov=jointstiff",
        "--cov=robotprograms",
        "--cov-context=test",
        "--cov-report=",
        "--cov-fail-under=0",
    ]
    tests = ["tests/studies"] if quick else ["tests", "packages/robotprograms"]
    _pytest([*measured, "-p", "benchmarks.studies.caches", "-n", "auto", *tests], COVERAGE_FILE=str(data))
    return Lane(data)


def drawn(house: str, part: Part) -> tuple[list[Mutant], int]:
    """Return the changes of this part, and the number of changes that they are drawn from."""
    every = [m for path in sorted((ROOT / house).rglob("*.py")) for m in mutants_of(path, ROOT)]
    chosen = np.random.default_rng(SEED).choice(len(every), MUTANTS[house], replace=False)
    return [every[int(chosen[number])] for number in part.of(MUTANTS[house])], len(every)


def judged(chosen: list[Mutant], lane: Lane, folder: Path) -> list[Judged]:
    """Run the tests that reach each change, in a fork that has it in memory.

    Args:
        chosen: the changes.
        lane: the daily lane.
        folder: of the file that tells the forks what to do.
    """
    changes = []
    for mutant in chosen:
        tests, files = lane.tests(mutant)
        change = {"module": mutant.module, "path": str(ROOT / mutant.path), "source": mutant.source}
        changes.append(change | {"tests": tests, "files": files})
    file = folder / "changes.json"
    file.write_text(json.dumps(changes), encoding="utf-8")
    _pytest(["-n", "0", "-p", "no:cacheprovider", "-p", "benchmarks.studies.forks"], **{CHANGES: str(file)})
    outcomes = json.loads(file.read_text(encoding="utf-8"))
    return [
        Judged(mutant, outcome["noticed"], outcome["seconds"], len(outcome["tests"]))
        for mutant, outcome in zip(chosen, outcomes, strict=True)
    ]


def _pytest(options: list[str], **environment: str) -> None:
    command = [sys.executable, "-m", "pytest", "-q", *LANE, *options]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | environment, capture_output=True, check=False)
    if done.returncode:
        raise RuntimeError(f"tests fail without a change, too: {done.stdout.decode()[-2000:]}")


def _section(house: str, total: int, changes: list[Judged]) -> Section:
    rows = [
        (
            f"{each.mutant.path}:{each.mutant.line}",
            each.mutant.before[:40],
            each.mutant.after[:40],
            str(each.tests),
            "noticed" if each.noticed else "lived",
            f"{each.seconds:.0f} s",
        )
        for each in changes
    ]
    share = 100.0 * float(np.mean([each.noticed for each in changes]))
    return Section(
        f"{len(changes)} small changes of the {house}, one at a time",
        ("place", "before", "after", "tests that reach it", "daily lane", "time"),
        tuple(sorted(rows, key=lambda row: row[4])),
        figures=(
            Figure(f"changes of the {house} that the daily lane notices", share, "at least", 95.0, "%"),
        ),
        notes=(f"drawn from {total} places with seed {SEED}; judged by the tests that reach the place",),
    )
