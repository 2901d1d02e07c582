"""Fits with K_c: repeated until the posture under load stands still."""

from __future__ import annotations

import numpy as np
import pytest
from support.campaigns import METHODS, estimate, prepare

from jointstiff.simulator import default_arm, simulate_campaign


@pytest.mark.parametrize("method", METHODS)
def test_exact_balances_tell_exact_compliances(method):
    """Springs that balance 8 kN exactly: off by per cents without K_c, by 1e-5 with it, in few rounds."""
    robot, measurements = prepare(
        simulate_campaign(default_arm(), load="pull", force=8000.0, sigma=0.0, configurations=12, seed=4)
    )
    off = {}
    for choice in ("neglected", "included"):
        found = estimate(robot, measurements, method=method, complementary_stiffness=choice)
        off[choice] = np.abs(found.compliance / default_arm().compliances - 1.0).max()
    assert off["included"] < 1e-4 < 1e-2 < off["neglected"]
    assert 1 <= found.complementary_stiffness.iterations <= 6
