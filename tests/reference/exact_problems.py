"""Random problems of non-negative least squares for exact arithmetic: the optimum is drawn first."""

from dataclasses import dataclass

import numpy as np

from jointstiff.solver.arrays import BoolArray, FloatArray

MOST_PARAMETERS, MOST_ACTIVE, MOST_ROWS = 8, 6, 40
WORST_CONDITION = 1e3
"""Condition of the equilibrated columns; beyond it the data themselves do not determine so many digits."""


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
