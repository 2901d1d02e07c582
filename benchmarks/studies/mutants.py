"""Small changes of the solver and the service, one at a time: does the daily lane of the room notice each?

A change is drawn from the expressions of a house: an operator becomes its opposite, a comparison turns
round, a sign goes, a least becomes a greatest. It is made in a copy of the sources; the project's files stay
as they are. Messages are left alone. A change that lives is listed with its place: either a test is missing
there, or the change changes nothing.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.report import Figure, Part, Section

__all__ = ["Mutant", "mutants_of", "run"]

MUTANTS = {"solver": 60, "service": 30}
SEED = 31
TIME_LIMIT = 900.0
"""Seconds for the tests of a room; a change that lets them run on is noticed."""
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
    source: str  # of the whole module
    before: str
    after: str

    @property
    def tests(self) -> list[str]:
        """Return the tests of its room: of this house, else of the other, else all of this house."""
        house, room = ROOT / "tests" / self.path.parts[0], Path(self.path.parts[1]).stem
        places = [house / room, *sorted((ROOT / "tests").glob(f"*/{room}")), house]
        return [str(next(place for place in places if place.is_dir()))]


class _Changes(ast.NodeVisitor):
    """Expressions that can be changed, each with what it becomes; none within messages."""

    def __init__(self) -> None:
        self.found = list[tuple[ast.expr, ast.expr]]()

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Leave texts alone."""

    def visit_Raise(self, node: ast.Raise) -> None:
        """Leave errors alone."""

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Pass over annotations."""
        if node.value is not None:
            self.visit(node.value)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Pass over annotations."""
        for statement in node.body:
            self.visit(statement)

    def generic_visit(self, node: ast.AST) -> None:
        """Take the changes of an expression."""
        if isinstance(node, ast.BinOp) and type(node.op) in OPPOSITE:
            other = ast.BinOp(node.left, OPPOSITE[type(node.op)](), node.right)  # type: ignore[arg-type]
            self.found.append((node, other))
        elif isinstance(node, ast.BoolOp):
            self.found.append((node, ast.BoolOp(OPPOSITE[type(node.op)](), node.values)))  # type: ignore[arg-type]
        elif isinstance(node, ast.Compare) and type(node.ops[0]) in OPPOSITE:
            ops = [OPPOSITE[type(node.ops[0])](), *node.ops[1:]]
            self.found.append((node, ast.Compare(node.left, ops, node.comparators)))  # type: ignore[arg-type]
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not, ast.Invert)):
            self.found.append((node, node.operand))
        elif isinstance(node, ast.Attribute) and node.attr in OTHER:
            self.found.append((node, ast.Attribute(node.value, OTHER[node.attr], node.ctx)))
        elif isinstance(node, ast.Name) and node.id in OTHER:
            self.found.append((node, ast.Name(OTHER[node.id], node.ctx)))
        super().generic_visit(node)


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
        if not isinstance(function, ast.FunctionDef):
            continue
        changes = _Changes()
        changes.visit(function)
        for node, other in changes.found:
            if node.end_lineno is None or node.end_col_offset is None:
                continue
            start = int(starts[node.lineno - 1]) + node.col_offset
            end = int(starts[node.end_lineno - 1]) + node.end_col_offset
            after = f"({ast.unparse(other)})"
            source = text.encode()[:start] + after.encode() + text.encode()[end:]
            yield Mutant(path.relative_to(root), node.lineno, source.decode(), ast.unparse(node), after)


def run(*, quick: bool, part: Part) -> list[Section]:
    """Draw changes, make each in a copy, and run the tests of its room."""
    workers = max(1, (os.cpu_count() or 1) - 1)
    with TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as pool:
        copies = SimpleQueue[Path]()
        for number in range(workers):
            copies.put(_copy(Path(folder) / str(number)))
        return [_of_house(house, pool, copies, quick=quick, part=part) for house in MUTANTS]


def _of_house(
    house: str, pool: ThreadPoolExecutor, copies: SimpleQueue[Path], *, quick: bool, part: Part
) -> Section:
    every = [m for path in sorted((ROOT / house).rglob("*.py")) for m in mutants_of(path, ROOT)]
    drawn = np.random.default_rng(SEED).choice(len(every), MUTANTS[house], replace=False)
    chosen = [every[int(drawn[number])] for number in part.of(MUTANTS[house])][: 1 if quick else None]
    green = {room: pool.submit(_fails, list(room), copies) for room in {tuple(m.tests) for m in chosen}}
    for room, outcome in green.items():
        if outcome.result():
            raise RuntimeError(f"tests fail without a change, too: {', '.join(room)}")
    outcomes = list(pool.map(lambda mutant: _noticed(mutant, copies), chosen))
    rows = [
        (
            f"{m.path}:{m.line}",
            m.before[:40],
            m.after[:40],
            "noticed" if seen else "lived",
            f"{seconds:.0f} s",
        )
        for m, (seen, seconds) in zip(chosen, outcomes, strict=True)
    ]
    share = 100.0 * float(np.mean([noticed for noticed, _ in outcomes]))
    return Section(
        f"{len(chosen)} small changes of the {house}, one at a time",
        ("place", "before", "after", "daily lane of its room", "time"),
        tuple(sorted(rows, key=lambda row: row[3])),
        figures=(
            Figure(
                f"changes of the {house} that its room's daily lane notices", share, "at least", 95.0, "%"
            ),
        ),
        notes=(f"drawn from {len(every)} places with seed {SEED}",),
    )


def _copy(folder: Path) -> Path:
    """Lay out the package with houses of its own, and return its folder."""
    package = folder / "jointstiff"
    package.mkdir(parents=True)
    for link in (ROOT / ".dev" / "jointstiff").iterdir():
        if link.name in MUTANTS:
            ignored = shutil.ignore_patterns("__pycache__", "static*")
            shutil.copytree(ROOT / link.name, package / link.name, ignore=ignored)
            for built in (ROOT / link.name).glob("static*"):
                (package / link.name / built.name).symlink_to(built)
        elif link.name != "__pycache__":
            (package / link.name).symlink_to(link.resolve())
    return package


def _noticed(mutant: Mutant, copies: SimpleQueue[Path]) -> tuple[bool, float]:
    """Return whether a test fails with the change, and the seconds until then."""
    start = time.perf_counter()
    return _fails(mutant.tests, copies, mutant), time.perf_counter() - start


def _fails(tests: list[str], copies: SimpleQueue[Path], mutant: Mutant | None = None) -> bool:
    """Return whether a test fails, or does not end."""
    package = copies.get()
    environment = os.environ | {"PYTHONPATH": str(package.parent), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "-p", "no:cacheprovider"]
    path = package / mutant.path if mutant else None
    original = path.read_bytes() if path else b""
    try:
        if path and mutant:
            path.write_text(mutant.source, encoding="utf-8")
        done = subprocess.run(
            [*command, "-m", "not process and not slow", *tests],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            timeout=TIME_LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return True
    finally:
        if path:
            path.write_bytes(original)
        copies.put(package)
    if done.returncode not in (0, 1, 2):  # 2: not even collected
        raise RuntimeError(f"the tests were not run: {done.stdout.decode()[-500:]}")
    return done.returncode != 0
