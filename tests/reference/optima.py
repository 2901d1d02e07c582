"""Optima as others find them: by cone programs, bounded least squares, enumeration."""

import warnings
from itertools import product

import cvxpy as cp
import numpy as np
from support.campaigns import SIGMA


def by_cvxpy(A, b, bounds):
    """The optimum as anyone would state it, and its value; None for the value if it is inaccurate."""
    x = cp.Variable(A.shape[1])
    below, above = np.isfinite(bounds.lower), np.isfinite(bounds.upper)
    constraints = [x[below] >= bounds.lower[below], x[above] <= bounds.upper[above]]
    problem = cp.Problem(cp.Minimize(cp.sum_squares(A @ x - b)), constraints)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the status says the same
        problem.solve(solver=cp.CLARABEL)
    return x.value, problem.value if problem.status == cp.OPTIMAL else None


def by_enumeration(A, b, rows, least):
    """The optimum under ``rows @ x ≥ least`` by trying every set of tight rows: slow, and surely right."""
    best, value = None, np.inf
    n = A.shape[1]
    for tight in product([False, True], repeat=len(rows)):
        active = rows[list(tight)]
        if len(active) > n or np.linalg.matrix_rank(active) < len(active):
            continue
        t = len(active)
        system = np.block([[A.T @ A, active.T], [active, np.zeros((t, t))]])
        x = np.linalg.solve(system, np.r_[A.T @ b, least[list(tight)]])[:n]
        cost = float(np.sum((A @ x - b) ** 2))
        if (rows @ x >= least - 1e-9).all() and cost < value:
            best, value = x, cost
    return best


def huber_by_clarabel(A, d, threshold, limits=lambda _: [], extra=lambda _: 0.0):
    """The Huber problem as a cone program, in sigma; limits and extra loss see them in 1e-6 rad/(N.m)."""
    unit = SIGMA / np.linalg.norm(A, axis=(0, 1))
    x = cp.Variable(A.shape[2])
    c = cp.multiply(unit * 1e6, x)
    rows = zip(A * unit / SIGMA, d / SIGMA, strict=True)
    losses = [cp.huber(cp.norm(b - M @ x), threshold) / 2 for M, b in rows]
    problem = cp.Problem(cp.Minimize(cp.sum(losses) + extra(c)), [c >= 0, *limits(c)])
    problem.solve(cp.CLARABEL, tol_gap_abs=1e-9, tol_gap_rel=1e-9, tol_feas=1e-9)
    assert problem.status == cp.OPTIMAL
    return unit * x.value, problem.value


def huber_objective(A, d, c, threshold):
    norm = np.linalg.norm(d - A @ c, axis=1) / SIGMA
    return np.where(norm <= threshold, norm**2 / 2, threshold * (norm - threshold / 2)).sum()
