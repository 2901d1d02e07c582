"""Optimal designs of campaigns: gap, time, memory, beside cvxpy + Clarabel and FIGAROH."""

from __future__ import annotations

import tracemalloc
import warnings
from dataclasses import dataclass
from functools import partial

import cvxpy as cp
import numpy as np

from benchmarks.campaigns import large_campaign
from benchmarks.figaroh_peer import run_figaroh
from benchmarks.peers import stacked_rows
from benchmarks.report import Figure, Section, seconds_text, times_table
from benchmarks.timing import interleaved
from jointstiff.simulator import default_arm
from jointstiff.solver.arrays import FloatArray
from jointstiff.solver.design import (
    AOptimality,
    Design,
    DesignProblem,
    Distinct,
    DOptimality,
    PackedCandidates,
    exact_design,
    optimise,
)

__all__ = ["run"]

CANDIDATES, FEW, FIGAROH, MANY = 100_000, 5_000, 1_600, 1_000_000
READINGS = 20
CRITERIA = ("D", "relative A", "I")
_MEGABYTE = 1e6
_BLOCK = 50_000


@dataclass(frozen=True, eq=False)
class Pool:
    """Candidates: random postures under random pulls, three targets.

    Attributes:
        rows: (N, 9, 6) whitened, of relative compliances.
        joints: (N, 6) [rad].
    """

    rows: FloatArray
    joints: FloatArray

    @classmethod
    def of(cls, count: int) -> Pool:
        """Draw candidates."""
        campaign = large_campaign(count)
        rows = np.empty((count, 9, 6))
        for start in range(0, count, _BLOCK):
            part = campaign.measurements[start : start + _BLOCK]
            rows[start : start + _BLOCK] = stacked_rows(campaign.robot, part)[0].reshape(-1, 9, 6)
        rows *= default_arm().compliances
        return cls(rows, campaign.measurements.joints)

    def __getitem__(self, count: int) -> Pool:
        """The first ones."""
        return Pool(self.rows[:count], self.joints[:count])

    def problem(self, name: str, readings: int = READINGS) -> DesignProblem:
        """State a choice, from the rows."""
        candidates = PackedCandidates.from_rows(self.rows)
        return DesignProblem(candidates, _criterion(name, self.rows), readings, np.zeros((6, 6)))


def run(*, quick: bool) -> list[Section]:
    """Time, gap and memory; then lists."""
    pool = Pool.of(2_000 if quick else CANDIDATES)
    few = pool[200 if quick else FEW]
    sections = [_against_cvxpy(few, 2 if quick else 7), _large(pool, Pool.of(4_000 if quick else MANY))]
    return [*sections, _against_figaroh(pool[60 if quick else FIGAROH]), _lists(pool)]


def _weights(pool: Pool, name: str) -> Design:
    return optimise(pool.problem(name))


def _criterion(name: str, rows: FloatArray) -> DOptimality | AOptimality:
    if name == "D":
        return DOptimality()
    places = rows[:: max(1, len(rows) // 500)].reshape(-1, 6)
    return AOptimality(np.eye(6) if name == "relative A" else places.T @ places)


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
        problem = pool.problem(name)
        gaps = {"ours, from the rows": 1 - ours.bound.efficiency, "fresh cvxpy + Clarabel": np.nan}
        if theirs is not None:
            reached = problem.criterion.information(_matrix(pool, theirs))
            best = problem.criterion.information(ours.matrix) / ours.bound.efficiency
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


def _large(pool: Pool, many: Pool) -> Section:
    rows, figures = [], []
    for name in CRITERIA:
        times = interleaved({"1e5": partial(_weights, pool, name)}, rounds=5)
        longer = interleaved({"1e6": partial(_weights, many, name)}, rounds=3)
        tracemalloc.start()
        found = optimise(many.problem(name))
        peak = tracemalloc.get_traced_memory()[1] / _MEGABYTE
        tracemalloc.stop()
        gaps = [1 - times.results["1e5"].bound.efficiency, 1 - found.bound.efficiency]
        ratio = longer.median("1e6") / times.median("1e5")
        cells = (seconds_text(times.median("1e5")), f"{gaps[0]:.1e}", seconds_text(longer.median("1e6")))
        rows.append((name, *cells, f"{gaps[1]:.1e}", f"{ratio:.1f}", f"{peak:.0f} MB"))
        figures += [
            Figure(f"{name}: gap at {len(pool.rows):,} candidates", gaps[0], "at most", 1e-6),
            Figure(
                f"{name}: {len(many.rows):,} candidates, time / that of {len(pool.rows):,}",
                ratio,
                "at most",
                6,
                "×",
            ),
            Figure(
                f"{name}: {len(many.rows):,} candidates, memory beyond the rows", peak, "at most", 300, " MB"
            ),
        ]
    return Section(
        title="Many candidates, from the rows",
        columns=("criterion", f"{len(pool.rows):,}", "gap", f"{len(many.rows):,}", "gap", "ratio", "memory"),
        rows=tuple(rows),
        figures=tuple(figures),
    )


def _against_figaroh(pool: Pool) -> Section:
    times = interleaved({"ours": lambda: optimise(pool.problem("D"))}, rounds=9)
    peer = run_figaroh(pool.rows, READINGS)
    if peer is None:
        return Section("FIGAROH could not be installed", ("",), ())
    problem, ours = pool.problem("D"), times.results["ours"]
    reached = problem.criterion.information(ours.matrix)
    theirs = problem.criterion.information(_matrix(pool, np.array(peer["weights"])))
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
        listed = interleaved({"ours": lambda: _list(first)}, rounds=5)
        chosen = peer["detmax_list"]
        K = np.einsum("imp,imq->pq", first.rows[chosen], first.rows[chosen])
        ratio = problem.criterion.information(listed.results["ours"].matrix) / problem.criterion.information(
            K
        )
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
            "in an environment of its own, once; Detmax keeps no list: the best one that it evaluated counts",
            str(peer.get("detmax_error", "")),
        ),
    )


def _list(pool: Pool) -> object:
    problem = pool.problem("D")
    once = DesignProblem(problem.candidates, problem.criterion, READINGS, problem.base, once=True)
    return exact_design(once, optimise(once), Distinct(pool.joints, 0.0))


def _lists(pool: Pool) -> Section:
    rows, figures = [], []
    for name in CRITERIA:
        cells = []
        for angle, required in ((0.0, 0.99), (10.0, 0.98), (15.0, 0.98)):
            worst = 1.0
            for n in (12, 20, 40):
                problem = pool.problem(name, n)
                found = exact_design(problem, optimise(problem), Distinct(pool.joints, np.radians(angle)))
                cells.append(f"{found.efficiency:.4f}")
                worst = min(worst, found.efficiency)
            apart = f"{angle:g}° apart" if angle else "repeats allowed"
            figures.append(
                Figure(
                    f"{name}: lists of 12, 20, 40 {apart}, least efficiency proved",
                    worst,
                    "at least",
                    required,
                )
            )
        rows.append((name, *cells))
    heads = tuple(f"{n}, {a}°" for a in (0, 10, 15) for n in (12, 20, 40))
    return Section(
        title=f"Lists of {len(pool.rows):,} candidates: efficiency proved",
        columns=("criterion", *heads),
        rows=tuple(rows),
        figures=tuple(figures),
    )


def _matrix(pool: Pool, weights: FloatArray) -> FloatArray:
    """Information of weights, brought to a sum of 1."""
    w = np.maximum(weights, 0.0)
    M: FloatArray = READINGS * np.einsum("i,imp,imq->pq", w / w.sum(), pool.rows, pool.rows, optimize=True)
    return M


def _cvxpy_weights(pool: Pool, name: str) -> FloatArray | None:
    """A freshly built cvxpy problem, solved by Clarabel as it comes."""
    K = (pool.rows.transpose(0, 2, 1) @ pool.rows).reshape(len(pool.rows), -1)
    w = cp.Variable(len(K), nonneg=True)
    M = cp.reshape((READINGS * K.T) @ w, (6, 6), order="C")
    M = 0.5 * (M + M.T)
    if name == "D":
        objective = cp.Maximize(cp.log_det(M))
    else:
        criterion = _criterion(name, pool.rows)
        objective = cp.Minimize(cp.matrix_frac(np.linalg.cholesky(criterion.W), M))  # type: ignore[union-attr]
    problem = cp.Problem(objective, [cp.sum(w) == 1])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            problem.solve(solver=cp.CLARABEL)
    except cp.SolverError:
        return None
    return None if w.value is None else np.asarray(w.value, dtype=np.float64)
