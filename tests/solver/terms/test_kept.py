"""Regressors of a set are kept with it, and with nothing else."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
from support.campaigns import simulated

from jointstiff.solver.terms.block import regressor_blocks


def test_the_same_set_has_the_same_regressors_and_others_have_their_own():
    robot, measurements = simulated(seed=8)
    (first,) = regressor_blocks(robot, measurements)
    (again,) = regressor_blocks(robot, measurements)
    assert again.A is first.A
    assert again.measurements is measurements
    (bent,) = regressor_blocks(robot, measurements, np.full(robot.n, 1e-6))
    assert (bent.A != first.A).any()
    (stronger,) = regressor_blocks(robot, replace(measurements, force=2.0 * measurements.force))
    np.testing.assert_allclose(stronger.A, 2.0 * first.A, rtol=1e-12)
    other, _ = simulated(seed=8)
    (of_other,) = regressor_blocks(other, measurements)
    assert of_other.A is not first.A


def test_a_set_that_is_gone_leaves_nothing_behind():
    robot, measurements = simulated(seed=8)
    (block,) = regressor_blocks(robot, measurements)
    kept = weakref.ref(block.configurations)
    del block, measurements
    gc.collect()
    assert kept() is None
