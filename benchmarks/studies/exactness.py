"""Random problems against exact arithmetic: how wrong can a certified answer be?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import fmpq

from benchmarks.report import Figure, Section
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.errors import SolverError
from jointstiff.solver.fit.cone import Scalars
from jointstiff.solver.fit.constraints import Bounds
from jointstiff.solver.fit.problem import LeastSquares, Problem
from jointstiff.solver.fit.solution import solve
from jointstiff.solver.fit.triangle import compute_triangular_factor
from tests.reference.exact_nnls import exact_nnls
from tests.reference.exact_problems import (
    MOST_ACTIVE,
    MOST_PARAMETERS,
    WORST_CONDITION,
    random_problem,
    tied_problem,
)
from tests.reference.exact_problems import Problem as ExactProblem

__all__ = ["run"]


TOLERANCE = 1e-8
"""Greatest relative error of a certified answer."""

_NOTES = (
    "Clarabel: single answers, by the program stated in cvxpy and the polish; pivoting: steps of many",
    f"random: 1 to {MOST_PARAMETERS} parameters, 0 to {MOST_ACTIVE} of them at zero, columns over 12 "
    f"decades, condition up to {WORST_CONDITION:g} once they are equilibrated",
    "combined: the same and a column that is a multiple of another; the error is that of the others",
    "tied: whole numbers, some zeros have multipliers of exactly zero; error relative to the greatest",
    "other support: a parameter is zero in one answer and not in the other (1e-17 counts as not)",
)


def combined_problem(seed: int) -> ExactProblem:
    """A random problem with a further column, an exact multiple of the first: only their sum shows."""
    simple = random_problem(seed)
    rng = np.random.default_rng([seed, 2])
    copy = simple.A[:, :1] * 2.0 ** rng.integers(-20, 21)
    judged = np.append(simple.judged, False)
    judged[0] = False
    return ExactProblem(np.hstack([simple.A, copy]), simple.b, judged)


@dataclass(frozen=True)
class Outcome:
    """One problem, solved by us and exactly."""

    solved_by: str | None  # what found the support; None if there was no certificate
    error: float  # greatest relative error of a parameter; nan if there was no certificate
    same_support: bool  # the same parameters are zero
    active: int  # parameters that are zero in truth

    @property
    def falsely_certified(self) -> bool:
        """Return True if a wrong answer has a certificate."""
        return self.solved_by is not None and not self.error <= TOLERANCE


def run(*, quick: bool) -> list[Section]:
    """Solve random, combined and tied problems by the solver and by exact arithmetic."""
    kinds: tuple[tuple[str, Callable[[int], ExactProblem], int], ...] = (
        ("random", random_problem, 100 if quick else 10_000),
        ("combined", combined_problem, 20 if quick else 1_000),
        ("tied", tied_problem, 20 if quick else 1_000),
    )
    found = {
        f"{number:,} {name}, {way}": _summary([_outcome(make(i), witnessed=witnessed) for i in range(number)])
        for name, make, number in kinds
        for way, witnessed in (("Clarabel", True), ("pivoting", False))
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
        yield Figure.none(f"exactness, all problems: {what}", total)


def _outcome(problem: ExactProblem, *, witnessed: bool) -> Outcome:
    """Solve as identify does, compression included, and exactly."""
    exact = exact_nnls(problem.A, problem.b)
    active = sum(value == 0 for value in exact)
    R = compute_triangular_factor(np.column_stack([problem.A, problem.b]))
    try:
        positive = Scalars(Bounds.positive(len(exact)))
        solution = solve(Problem(LeastSquares(R[:, :-1], R[:, -1]), positive), witnessed=witnessed)
    except SolverError:
        return Outcome(None, float("nan"), same_support=False, active=active)
    errors, same = _errors(problem, solution.x, exact)
    return Outcome(solution.certificate.solved_by, errors, same, active)


def _errors(problem: ExactProblem, c: FloatArray, exact: list[fmpq]) -> tuple[float, bool]:
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
