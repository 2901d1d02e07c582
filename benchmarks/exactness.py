"""Random problems against exact arithmetic: how wrong can a certified answer be?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import fmpq

from benchmarks.exact_nnls import exact_nnls
from benchmarks.report import Figure, Section
from jointstiff.solver.arrays import BoolArray, FloatArray
from jointstiff.solver.convex import Bounds, IdentificationProblem, Solution, solve, solve_step
from jointstiff.solver.errors import SolverError
from jointstiff.solver.regression import Compression

__all__ = ["Problem", "combined_problem", "random_problem", "run", "tied_problem"]


TOLERANCE = 1e-8
"""Greatest relative error of a certified answer."""
MOST_PARAMETERS, MOST_ACTIVE, MOST_ROWS = 8, 6, 40
WORST_CONDITION = 1e3
"""Of the equilibrated columns; beyond it the data themselves do not determine so many digits."""

_NOTES = (
    "Clarabel: single answers, by the program stated in cvxpy and the polish; pivoting: steps of many",
    f"random: 1 to {MOST_PARAMETERS} parameters, 0 to {MOST_ACTIVE} of them at zero, columns over 12 "
    f"decades, condition up to {WORST_CONDITION:g} once they are equilibrated",
    "combined: the same and a column that is a multiple of another; the error is that of the others",
    "tied: whole numbers, some zeros have multipliers of exactly zero; error relative to the greatest",
    "other support: a parameter is zero in one answer and not in the other (1e-17 counts as not)",
)


@dataclass(frozen=True, eq=False)
class Problem:
    """Minimise ‖A x − b‖ subject to x ≥ 0.

    Attributes:
        A: (m, n).
        b: (m,).
        judged: (n,) the parameters that the data determine.
        relative_to: whether each error is relative to its `part`, or to the `greatest` of them in
            equilibrated variables, where some are zero but for rounding.
    """

    A: FloatArray
    b: FloatArray
    judged: BoolArray
    relative_to: str = "part"


@dataclass(frozen=True)
class Outcome:
    """One problem, solved by us and exactly.

    Attributes:
        solved_by: what found the support; None if there was no certificate.
        error: greatest relative error of a parameter; nan if there was no certificate.
        same_support: whether the same parameters are zero.
        active: how many are zero in truth.
    """

    solved_by: str | None
    error: float
    same_support: bool
    active: int

    @property
    def falsely_certified(self) -> bool:
        """Whether there is a certificate, and yet the answer is wrong."""
        return self.solved_by is not None and not self.error <= TOLERANCE


def run(*, quick: bool) -> list[Section]:
    """Solve random, combined and tied problems by the solver and by exact arithmetic."""
    kinds: tuple[tuple[str, Callable[[int], Problem], int], ...] = (
        ("random", random_problem, 100 if quick else 10_000),
        ("combined", combined_problem, 20 if quick else 1_000),
        ("tied", tied_problem, 20 if quick else 1_000),
    )
    found = {
        f"{number:,} {name}, {way}": _summary([_outcome(make(i), solver) for i in range(number)])
        for name, make, number in kinds
        for way, solver in (("Clarabel", solve), ("pivoting", solve_step))
    }
    return [
        Section(
            title="Exactness: the solver beside exact rational arithmetic",
            columns=("problems", *next(iter(found.values()))),
            rows=tuple((name, *map(str, summary.values())) for name, summary in found.items()),
            figures=tuple(_figures(found)),
            notes=_NOTES,
            data=found,
        )
    ]


def _figures(found: dict[str, dict[str, Any]]) -> Iterable[Figure]:
    for name, summary in found.items():
        error = float(summary["greatest error"])
        yield Figure(f"{name} problems: greatest relative error", error, "at most", TOLERANCE)
    for what in ("false certificates", "unanswered"):
        total = sum(summary[what] for summary in found.values())
        yield Figure(f"exactness, all problems: {what}", total, "at most", 0)


def random_problem(seed: int) -> Problem:
    """A problem whose optimum and multipliers are drawn first, and the data from them.

    With unit columns A, ``b = A x + r`` where ``Aᵀ r = −λ``, λ positive on the active parameters and
    zero elsewhere; r has a part orthogonal to A as well. Columns and right-hand side are then scaled.
    """
    rng = np.random.default_rng([seed, 1])
    n = int(rng.integers(1, MOST_PARAMETERS + 1))
    A = _equilibrated(rng, n, int(rng.integers(n, MOST_ROWS + 1)))
    active = rng.permutation(n)[: rng.integers(0, min(n, MOST_ACTIVE) + 1)]
    x, multipliers = rng.uniform(0.05, 1.0, n), np.zeros(n)
    x[active], multipliers[active] = 0.0, rng.uniform(0.05, 1.0, len(active))
    noise = rng.standard_normal(len(A))
    noise -= A @ np.linalg.lstsq(A, noise, rcond=None)[0]
    push = -np.linalg.pinv(A.T) @ multipliers
    size = float(np.linalg.norm(A @ x)) or 1.0
    push = _of_size(push, rng.uniform(0.01, 1.0) * size)
    noise = _of_size(noise, rng.uniform(0.0, 1.0) * size)
    b: FloatArray = A @ x + push + noise
    scales = 10.0 ** rng.uniform(-6.0, 6.0, n)
    return Problem(A * scales, b * 10.0 ** rng.uniform(-6.0, 6.0), np.ones(n, dtype=np.bool_))


def combined_problem(seed: int) -> Problem:
    """A random problem with a further column, an exact multiple of the first: only their sum shows."""
    simple = random_problem(seed)
    rng = np.random.default_rng([seed, 2])
    copy = simple.A[:, :1] * 2.0 ** rng.integers(-20, 21)
    judged = np.append(simple.judged, False)
    judged[0] = False
    return Problem(np.hstack([simple.A, copy]), simple.b, judged)


def tied_problem(seed: int) -> Problem:
    """Whole numbers, so that the optimum is known exactly: some zeros have zero multipliers.

    The last n rows of A are the unit matrix; the residuals there are −λ, all others are zero, hence
    ``Aᵀ (A x − b) = λ``.
    """
    rng = np.random.default_rng([seed, 3])
    n = int(rng.integers(2, MOST_PARAMETERS + 1))
    A = np.vstack([rng.integers(-9, 10, (n + int(rng.integers(2, 20)), n)), np.eye(n)])
    x = rng.integers(1, 10, n) * (rng.random(n) < 0.6)
    multipliers = np.where(x == 0, rng.integers(0, 3, n), 0)
    b = A @ x
    b[-n:] -= multipliers
    scales = 2.0 ** rng.integers(-20, 21, n)
    return Problem(
        A.astype(float) * scales, b.astype(float), np.ones(n, dtype=np.bool_), relative_to="greatest"
    )


def _equilibrated(rng: np.random.Generator, n: int, rows: int) -> FloatArray:
    """Unit columns with a condition number of up to about `WORST_CONDITION`."""
    U = np.linalg.qr(rng.standard_normal((rows, n)))[0]
    V = np.linalg.qr(rng.standard_normal((n, n)))[0]
    spread = rng.uniform(0.0, np.log10(WORST_CONDITION))
    A: FloatArray = U * 10.0 ** -rng.permutation(np.linspace(0.0, spread, n)) @ V.T
    return np.asarray(A / np.linalg.norm(A, axis=0))


def _of_size(vector: FloatArray, size: float) -> FloatArray:
    """The vector with this norm; nothing if it is rounding."""
    norm = np.linalg.norm(vector)
    return np.asarray(vector * (size / norm)) if norm > 1e-10 else np.zeros_like(vector)


def _outcome(problem: Problem, solver: Callable[[IdentificationProblem], Solution]) -> Outcome:
    """Solve as identify does, compression included, and exactly."""
    exact = exact_nnls(problem.A, problem.b)
    active = sum(value == 0 for value in exact)
    rows = Compression(len(exact) + 1)
    rows.add(np.column_stack([problem.A, problem.b]))
    try:
        solution = solver(IdentificationProblem(rows.matrix, rows.rhs, Bounds.positive(len(exact))))
    except SolverError:
        return Outcome(None, float("nan"), same_support=False, active=active)
    errors, same = _errors(problem, solution.compliance, exact)
    return Outcome(solution.certificate.solved_by, errors, same, active)


def _errors(problem: Problem, c: FloatArray, exact: list[fmpq]) -> tuple[float, bool]:
    """Greatest relative error, subtracted exactly, and whether the supports agree, where judged.

    A number other than zero where zero is exact has the error inf relative to its part.
    """
    size: list[fmpq] = exact
    if problem.relative_to == "greatest":
        norms = np.linalg.norm(problem.A, axis=0)
        greatest = max(float(value) * norm for value, norm in zip(exact, norms, strict=True))
        size = [_rational((greatest or 1.0) / norm) for norm in norms]
    errors, same = [0.0], True
    for j in np.flatnonzero(problem.judged):
        error = abs(_rational(c[j]) - exact[j])
        same &= (c[j] == 0) == (exact[j] == 0)
        if error != 0:
            errors.append(float(error / size[j]) if size[j] != 0 else float("inf"))
    return max(errors), bool(same)


def _rational(value: float) -> fmpq:
    return fmpq(*float(value).as_integer_ratio())


def _summary(outcomes: list[Outcome]) -> dict[str, Any]:
    """Columns of the table."""
    errors = [o.error for o in outcomes if o.solved_by is not None]
    return {
        "greatest error": f"{max(errors, default=0.0):.1e}",
        "median error": f"{np.median(errors):.1e}",
        "other support": sum(not o.same_support for o in outcomes),
        "false certificates": sum(o.falsely_certified for o in outcomes),
        "unanswered": sum(o.solved_by is None for o in outcomes),
        "support by": _histogram(o.solved_by for o in outcomes),
        "at zero": _histogram(o.active for o in outcomes),
    }


def _histogram(values: Iterable[object]) -> str:
    return "\n".join(f"{value}: {number:,}" for value, number in sorted(Counter(map(str, values)).items()))
