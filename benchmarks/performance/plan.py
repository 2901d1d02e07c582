"""Optimal designs of campaigns beside cvxpy + Clarabel, in the same run."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cvxpy as cp
import numpy as np

from benchmarks.campaigns import large_campaign
from benchmarks.performance.peers import stacked_rows
from benchmarks.report import Figure, Section, times_table
from benchmarks.timing import interleaved
from jointstiff.simulator import default_arm
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.optimum import (
    AOptimality,
    Candidates,
    Design,
    DesignProblem,
    DOptimality,
    optimise_design,
)

__all__ = ["run"]


CANDIDATES = 5_000
READINGS = 20
CRITERIA = ("D", "relative A", "I")
OURS, PEER = "ours, from the rows", "fresh cvxpy + Clarabel"


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates: random postures under random pulls, three targets."""

    rows: FloatArray  # (N, 9, 6) whitened, of relative compliances

    @classmethod
    def of(cls, count: int) -> Pool:
        """Draw candidates."""
        campaign = large_campaign(count)
        rows = stacked_rows(campaign.robot, campaign.measurements)[0].reshape(-1, 9, 6)
        return cls(rows * default_arm().compliances)

    def problem(self, name: str) -> DesignProblem:
        """State a choice, from the rows."""
        candidates = Candidates.from_rows(self.rows)
        return DesignProblem(candidates, self.criterion(name), READINGS, np.zeros((6, 6)))

    def criterion(self, name: str) -> DOptimality | AOptimality:
        """Return a criterion by its name."""
        if name == "D":
            return DOptimality(6)
        places = self.rows[:: max(1, len(self.rows) // 500)].reshape(-1, 6)
        return AOptimality(np.eye(6) if name == "relative A" else places.T @ places)

    def information(self, weights: FloatArray) -> FloatArray:
        """Return the information (6, 6) of weights, brought to a sum of 1."""
        w = np.maximum(weights, 0.0)
        M: FloatArray = READINGS * np.einsum(
            "i,imp,imq->pq", w / w.sum(), self.rows, self.rows, optimize=True
        )
        return M


def run(*, quick: bool) -> list[Section]:
    """Weights of 5,000 candidates beside cvxpy."""
    return [_against_cvxpy(Pool.of(200 if quick else CANDIDATES), 2 if quick else 7)]


def _weights(pool: Pool, name: str) -> Design:
    return optimise_design(pool.problem(name))


def _against_cvxpy(pool: Pool, rounds: int) -> Section:
    rows, figures = [], []
    for name in CRITERIA:
        candidates: dict[str, Callable[[], object]] = {
            OURS: partial(_weights, pool, name),
            PEER: partial(_cvxpy_weights, pool, name),
        }
        times = interleaved(candidates, rounds=rounds)
        ours: Design = times.results[OURS]
        theirs, criterion = times.results[PEER], pool.criterion(name)
        gaps = {OURS: 1 - ours.bound.efficiency, PEER: np.nan}
        if theirs is not None:
            reached = criterion.information(pool.information(theirs))
            best = criterion.information(ours.matrix) / ours.bound.efficiency
            gaps[PEER] = float(1 - reached / best)
        columns, table = times_table(times, OURS, [("gap", {n: f"{g:.1e}" for n, g in gaps.items()})])
        rows += [(f"{name}: {row[0]}", *row[1:]) for row in table]
        ratio = times.ratio(PEER, OURS)
        what = f"{name}: {len(pool.rows):,} candidates, cvxpy + Clarabel / ours"
        figures.append(Figure(what, ratio, "at least", 50, "×"))
    return Section(
        title=f"{len(pool.rows):,} candidates × 3 targets: ours beside cvxpy",
        columns=columns,
        rows=tuple(rows),
        figures=tuple(figures),
        notes=("gap: 1 − φ / bound, the bound from a sweep over all candidates",),
    )


def _cvxpy_weights(pool: Pool, name: str) -> FloatArray | None:
    """A freshly built cvxpy problem, solved by Clarabel as it comes."""
    K = pool.rows.transpose(0, 2, 1) @ pool.rows
    unit = 1.0 / np.sqrt(K.mean(axis=0).diagonal())  # without it Clarabel fails
    w = cp.Variable(len(K), nonneg=True)
    M = cp.reshape((K * np.outer(unit, unit)).reshape(len(K), -1).T @ w, (6, 6), order="C")
    M = 0.5 * (M + M.T)
    if name == "D":
        objective = cp.Maximize(cp.log_det(M))
    else:
        W = pool.criterion(name).scaled(unit).W  # type: ignore[union-attr]
        objective = cp.Minimize(cp.matrix_frac(np.linalg.cholesky(W / np.trace(W)), M))
    problem = cp.Problem(objective, [cp.sum(w) == 1])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            problem.solve(solver=cp.CLARABEL)
    except cp.SolverError:
        return None
    return None if w.value is None else np.asarray(w.value, dtype=np.float64)
