"""Optimal designs of campaigns beside cvxpy + Clarabel and FIGAROH, in the same run."""

from __future__ import annotations

import warnings
from functools import partial

import cvxpy as cp
import numpy as np

from benchmarks.performance.candidate_pool import CRITERIA, READINGS, Pool
from benchmarks.performance.figaroh_peer import run_figaroh
from benchmarks.report import Figure, Section, seconds_text, times_table
from benchmarks.timing import interleaved
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design.optimum import Design, optimise
from jointstiff.solver.design.plan import Distinct, exact_design

__all__ = ["run", "run_figaroh_section"]

_FEW, _FIGAROH = 5_000, 1_600


def run(*, quick: bool) -> list[Section]:
    """Weights of 5,000 candidates beside cvxpy."""
    return [_against_cvxpy(Pool.of(200 if quick else _FEW), 2 if quick else 7)]


def run_figaroh_section(*, quick: bool) -> list[Section]:
    """Weights of 1,600 candidates, and a list of the first 200, beside FIGAROH."""
    return [_against_figaroh(Pool.of(60 if quick else _FIGAROH))]


def _weights(pool: Pool, name: str) -> Design:
    return optimise(pool.problem(name))


def _against_cvxpy(pool: Pool, rounds: int) -> Section:
    rows, figures = [], []
    for name in CRITERIA:
        times = interleaved(
            {
                "ours, from the rows": partial(_weights, pool, name),
                "fresh cvxpy + Clarabel": partial(_cvxpy_weights, pool, name),
            },
            rounds=rounds,
        )
        ours: Design = times.results["ours, from the rows"]
        theirs = times.results["fresh cvxpy + Clarabel"]
        criterion = pool.criterion(name)
        gaps = {"ours, from the rows": 1 - ours.bound.efficiency, "fresh cvxpy + Clarabel": np.nan}
        if theirs is not None:
            reached = criterion.information(pool.information(theirs))
            best = criterion.information(ours.matrix) / ours.bound.efficiency
            gaps["fresh cvxpy + Clarabel"] = 1 - reached / best
        columns, table = times_table(
            times, "ours, from the rows", [("gap", {n: f"{g:.1e}" for n, g in gaps.items()})]
        )
        rows += [(f"{name}: {row[0]}", *row[1:]) for row in table]
        ratio = times.ratio("fresh cvxpy + Clarabel", "ours, from the rows")
        figures += [
            Figure(
                f"{name}: {len(pool.rows):,} candidates, cvxpy + Clarabel / ours", ratio, "at least", 50, "×"
            )
        ]
    return Section(
        title=f"{len(pool.rows):,} candidates × 3 targets: ours beside cvxpy",
        columns=columns,
        rows=tuple(rows),
        figures=tuple(figures),
        notes=("gap: 1 − φ / bound, the bound from a sweep over all candidates",),
    )


def _against_figaroh(pool: Pool) -> Section:
    times = interleaved({"ours": partial(_weights, pool, "D")}, rounds=9)
    peer = run_figaroh(pool.rows / np.sqrt(np.square(pool.rows).mean(axis=(0, 1))), READINGS)
    if peer is None:
        return Section("FIGAROH could not be installed", ("",), ())
    criterion, ours = pool.criterion("D"), times.results["ours"]
    reached = criterion.information(ours.matrix)
    theirs = criterion.information(pool.information(np.array(peer["weights"])))
    rows = [
        ("ours", seconds_text(times.median("ours")), "1", "1"),
        (
            "SOCPOptimizer",
            seconds_text(peer["seconds"]),
            f"{peer['seconds'] / times.median('ours'):,.0f}",
            f"{theirs / reached:.8f}",
        ),
    ]
    figures = [
        Figure(
            f"{len(pool.rows):,} candidates, FIGAROH's SOCPOptimizer / ours",
            peer["seconds"] / times.median("ours"),
            "at least",
            1000,
            "×",
        ),
        Figure("root of the determinant, ours / SOCPOptimizer's", reached / theirs, "at least", 1.0 - 1e-9),
    ]
    if peer.get("detmax_list"):
        first = pool[200]
        chosen = peer["detmax_list"]
        repeats = len(set(chosen)) < len(chosen)
        listed = interleaved({"ours": lambda: _list(first, repeats=repeats)}, rounds=5)
        K = np.einsum("imp,imq->pq", first.rows[chosen], first.rows[chosen])
        ratio = criterion.information(listed.results["ours"].matrix) / criterion.information(K)
        rows.append(
            (f"list of {READINGS} of the first 200: ours", seconds_text(listed.median("ours")), "1", "1")
        )
        rows.append(
            (
                "the same: Detmax, mended",
                seconds_text(peer["detmax_seconds"]),
                f"{peer['detmax_seconds'] / listed.median('ours'):,.0f}",
                f"{1 / ratio:.8f}",
            )
        )
        figures.append(Figure("root of the determinant, our list / Detmax's", ratio, "at least", 1.0 - 1e-9))
    return Section(
        title=f"{len(pool.rows):,} candidates: ours beside FIGAROH 1.0.2, as released",
        columns=("", "time", "time / ours", "det^(1/6) / ours"),
        rows=tuple(rows),
        figures=tuple(figures),
        notes=(
            "in an environment of its own, once, columns scaled, as it fails without; "
            "Detmax keeps no list: the best one that it evaluated counts; both may repeat readings",
            str(peer.get("detmax_error", "")),
        ),
    )


def _list(pool: Pool, *, repeats: bool) -> object:
    problem = pool.problem("D")
    distinct = Distinct(np.arange(float(len(pool.joints)))[:, None], 0.0 if repeats else 0.5)
    return exact_design(problem, optimise(problem), distinct)


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
