"""Optimal weights beside published ones."""

from __future__ import annotations

import numpy as np
import pytest

from jointstiff.solver.design.criteria import AOptimality, DOptimality, EOptimality, GOptimality
from jointstiff.solver.design.optimum import Candidates, DesignProblem, optimise


def best(rows: np.ndarray, criterion):
    """Optimal weights of one reading whose candidates have these rows (N, m, p)."""
    return optimise(DesignProblem(Candidates.from_rows(rows), criterion, 1, np.zeros((rows.shape[-1],) * 2)))


def polynomials(degree: int, count: int = 2001) -> np.ndarray:
    return (np.linspace(-1.0, 1.0, count)[:, None] ** np.arange(degree + 1))[:, None]


def assert_weights(design, rows: np.ndarray, expected: dict[float, float], tolerance: float) -> None:
    at, places = rows[design.atoms.index, 0, 1], np.array(list(expected))
    near = np.abs(at[:, None] - places).argmin(axis=1)
    assert np.abs(at - places[near]).max() < 0.005
    found = [float(design.weights[near == i].sum()) for i in range(len(places))]
    assert found == pytest.approx(list(expected.values()), abs=tolerance)


class TestPolynomialsOnAnInterval:
    """Fedorov 1972, Pukelsheim 1993 (chapters 9.5 to 9.15)."""

    @pytest.mark.parametrize(
        ("criterion", "expected", "tolerance", "gap"),
        [
            (DOptimality(3), {-1.0: 1 / 3, 0.0: 1 / 3, 1.0: 1 / 3}, 1e-3, 1e-9),
            (DOptimality(4), {-1.0: 0.25, -(0.2**0.5): 0.25, 0.2**0.5: 0.25, 1.0: 0.25}, 1e-3, 1e-9),
            (AOptimality(np.eye(3)), {-1.0: 0.25, 0.0: 0.5, 1.0: 0.25}, 1e-6, 1e-9),
            (EOptimality(np.ones(3)), {-1.0: 0.2, 0.0: 0.6, 1.0: 0.2}, 1e-3, 1e-6),
        ],
        ids=["D of a parabola", "D of a cubic", "A of a parabola", "E of a parabola"],
    )
    def test_weights(self, criterion, expected, tolerance, gap):
        rows = polynomials(len(expected) - 1)
        design = best(rows, criterion)
        assert_weights(design, rows, expected, tolerance)
        assert design.bound.efficiency > 1 - gap
        if isinstance(criterion, EOptimality):
            assert np.linalg.eigvalsh(design.matrix)[0] == pytest.approx(0.2, rel=1e-6)

    def test_g_equals_d(self):
        """Kiefer & Wolfowitz 1960: the worst variance of the best design is the number of parameters."""
        rows = polynomials(2, 101)
        criterion = GOptimality(np.einsum("rmi,rmj->rij", rows, rows))
        design = best(rows, criterion)
        assert_weights(design, rows, dict.fromkeys((-1.0, 0.0, 1.0), 1 / 3), 2e-3)
        assert criterion.variances(design.matrix).max() == pytest.approx(3.0, rel=1e-5)


def test_quadratic_on_a_grid_of_nine():
    """Box & Draper 1971: corners 0.1458, middles of edges 0.0802, centre 0.0962."""
    levels = (-1.0, 0.0, 1.0)
    X = np.array([[1, a, b, a * a, b * b, a * b] for a in levels for b in levels], dtype=float)
    design = best(X[:, None], DOptimality(6))
    found = np.zeros(9)
    found[design.atoms.index] = design.weights
    corner, edge, centre = 0.14579, 0.08016, 0.09619
    expected = [corner, edge, corner, edge, centre, edge, corner, edge, corner]
    assert found == pytest.approx(expected, abs=1e-5)


def test_one_combination_only():
    """The documentation of PICOS, optimal experimental design, c-optimality: 12.8 % and 87.2 %."""
    A = [
        [[1, 0, 0, 0, 0], [0, 3, 0, 0, 0], [0, 0, 1, 0, 0]],
        [[0, 0, 2, 0, 0], [0, 1, 0, 0, 0], [0, 0, 0, 1, 0]],
        [[0, 0, 0, 2, 0], [4, 0, 0, 0, 0], [0, 0, 1, 0, 0]],
        [[1, 0, 0, 0, 0], [0, 0, 2, 0, 0], [0, 0, 0, 0, 4]],
        [[1, 0, 2, 0, 0], [0, 3, 0, 1, 2], [0, 0, 1, 2, 0]],
        [[0, 1, 1, 1, 0], [0, 3, 0, 1, 0], [0, 0, 2, 2, 0]],
        [[1, 2, 0, 0, 0], [0, 3, 3, 0, 5], [1, 0, 0, 2, 0]],
        [[1, 0, 3, 0, 1], [0, 3, 2, 0, 0], [1, 0, 0, 2, 0]],
    ]
    c = np.arange(1.0, 6.0)
    design = best(np.array(A, dtype=float), AOptimality(np.outer(c, c)))
    weights = dict(zip(design.atoms.index.tolist(), design.weights.round(3).tolist(), strict=True))
    assert weights == {4: 0.128, 6: 0.872}
