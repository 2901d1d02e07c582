"""Algebra of many small matrices, beside NumPy's decompositions of each."""

import numpy as np
import pytest

from jointstiff.solver.arrays import are_regular


@pytest.mark.parametrize("bound", [1e-4, 0.04, 0.5, 3.0])
def test_regular_matrices_are_those_whose_least_singular_value_reaches_the_bound(bound):
    generator = np.random.default_rng(3)
    scale = generator.uniform(-4.0, 1.0, (3000, 1, 1))
    matrices = 10.0**scale * generator.standard_normal((3000, 6, 6))
    expected = np.linalg.svd(matrices, compute_uv=False)[:, -1] >= bound
    np.testing.assert_array_equal(are_regular(matrices, bound), expected)
    assert 0 < expected.sum() < len(expected)


def test_each_matrix_may_have_a_bound_of_its_own():
    matrices = np.stack([np.diag([1.0, 2.0, 4.0])] * 3)
    np.testing.assert_array_equal(are_regular(matrices, np.array([0.5, 1.0, 1.5])), [True, True, False])


def test_singular_matrices_are_not_regular():
    matrices = np.stack([np.zeros((3, 3)), np.ones((3, 3)), np.eye(3)])
    np.testing.assert_array_equal(are_regular(matrices, 1e-4), [False, False, True])
    np.testing.assert_array_equal(are_regular(matrices, 0.0), [True, True, True])
    assert are_regular(np.zeros((0, 3, 3)), 1e-4).shape == (0,)
