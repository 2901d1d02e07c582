"""Optimal weights beside published ones."""

from __future__ import annotations

import numpy as np
import pytest

from jointstiff.solver.design.candidates import Candidates
from jointstiff.solver.design.criteria import AOptimality, DOptimality, EOptimality, GOptimality
from jointstiff.solver.design.optimum import optimise
from jointstiff.solver.design.problem import DesignProblem


def polynomials(degree: int, count: int = 2001) -> tuple[np.ndarray, np.ndarray]:
    x = np.linspace(-1.0, 1.0, count)
    return x, (x[:, None] ** np.arange(degree + 1))[:, None]


def weights_near(x: np.ndarray, design, places: list[float]) -> list[float]:
    at = x[design.atoms.index]
    near = np.abs(at[:, None] - np.array(places)).argmin(axis=1)
    assert np.abs(at - np.array(places)[near]).max() < 0.005
    return [float(design.weights[near == i].sum()) for i in range(len(places))]


class TestPolynomialsOnAnInterval:
    """Fedorov 1972, Pukelsheim 1993 (chapters 9.5 to 9.15)."""

    @pytest.mark.parametrize(
        ("degree", "places"), [(2, [-1.0, 0.0, 1.0]), (3, [-1.0, -(0.2**0.5), 0.2**0.5, 1.0])]
    )
    def test_d_optimal(self, degree, places):
        x, rows = polynomials(degree)
        problem = DesignProblem(Candidates.from_rows(rows), DOptimality(), 1, np.zeros((degree + 1,) * 2))
        design = optimise(problem)
        assert weights_near(x, design, places) == pytest.approx([1 / (degree + 1)] * (degree + 1), abs=1e-3)
        assert design.bound.efficiency > 1 - 1e-9

    def test_a_optimal_of_a_parabola(self):
        x, rows = polynomials(2)
        design = optimise(
            DesignProblem(Candidates.from_rows(rows), AOptimality(np.eye(3)), 1, np.zeros((3, 3)))
        )
        assert weights_near(x, design, [-1.0, 0.0, 1.0]) == pytest.approx([0.25, 0.5, 0.25], abs=1e-6)

    def test_e_optimal_of_a_parabola(self):
        x, rows = polynomials(2)
        design = optimise(
            DesignProblem(Candidates.from_rows(rows), EOptimality(np.ones(3)), 1, np.zeros((3, 3)))
        )
        assert weights_near(x, design, [-1.0, 0.0, 1.0]) == pytest.approx([0.2, 0.6, 0.2], abs=1e-3)
        assert design.bound.efficiency > 1 - 1e-6
        assert np.linalg.eigvalsh(design.matrix)[0] == pytest.approx(0.2, rel=1e-6)

    def test_g_equals_d(self):
        """Kiefer & Wolfowitz 1960: the worst variance of the best design is the number of parameters."""
        x, rows = polynomials(2, 101)
        places = np.einsum("rmi,rmj->rij", rows, rows)
        design = optimise(DesignProblem(Candidates.from_rows(rows), GOptimality(places), 1, np.zeros((3, 3))))
        assert weights_near(x, design, [-1.0, 0.0, 1.0]) == pytest.approx([1 / 3] * 3, abs=2e-3)
        assert GOptimality(places).variances(design.matrix).max() == pytest.approx(3.0, rel=1e-5)


def test_quadratic_on_a_grid_of_nine():
    """Box & Draper 1971: corners 0.1458, middles of edges 0.0802, centre 0.0962."""
    levels = (-1.0, 0.0, 1.0)
    X = np.array([[1, a, b, a * a, b * b, a * b] for a in levels for b in levels], dtype=float)
    design = optimise(DesignProblem(Candidates.from_rows(X[:, None]), DOptimality(), 1, np.zeros((6, 6))))
    found = np.zeros(9)
    found[design.atoms.index] = design.weights
    corner, edge, centre = 0.14579, 0.08016, 0.09619
    expected = [corner, edge, corner, edge, centre, edge, corner, edge, corner]
    assert found == pytest.approx(expected, abs=1e-5)


def test_one_combination_only():
    """The documentation of PICOS, optimal experimental design, c-optimality: 12.8 % and 87.2 %."""
    A = [
        np.array([[1, 0, 0, 0, 0], [0, 3, 0, 0, 0], [0, 0, 1, 0, 0]]),
        np.array([[0, 0, 2, 0, 0], [0, 1, 0, 0, 0], [0, 0, 0, 1, 0]]),
        np.array([[0, 0, 0, 2, 0], [4, 0, 0, 0, 0], [0, 0, 1, 0, 0]]),
        np.array([[1, 0, 0, 0, 0], [0, 0, 2, 0, 0], [0, 0, 0, 0, 4]]),
        np.array([[1, 0, 2, 0, 0], [0, 3, 0, 1, 2], [0, 0, 1, 2, 0]]),
        np.array([[0, 1, 1, 1, 0], [0, 3, 0, 1, 0], [0, 0, 2, 2, 0]]),
        np.array([[1, 2, 0, 0, 0], [0, 3, 3, 0, 5], [1, 0, 0, 2, 0]]),
        np.array([[1, 0, 3, 0, 1], [0, 3, 2, 0, 0], [1, 0, 0, 2, 0]]),
    ]
    c = np.arange(1.0, 6.0)
    rows = np.array(A, dtype=float)
    design = optimise(
        DesignProblem(Candidates.from_rows(rows), AOptimality(np.outer(c, c)), 1, np.zeros((5, 5)))
    )
    assert dict(zip(design.atoms.index.tolist(), design.weights.round(3).tolist(), strict=True)) == {
        4: 0.128,
        6: 0.872,
    }
