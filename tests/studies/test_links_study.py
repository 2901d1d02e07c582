"""The study of elastic links on the real robot's readings."""

from __future__ import annotations

import numpy as np
import pytest
from support.campaigns import prepare
from support.shared_data import shared

from benchmarks.studies.links_fanuc import held_out_compensation
from jointstiff.solver.links.model import MODELS

pytestmark = pytest.mark.slow  # the studies of benchmarks/, each night


@pytest.mark.parametrize("splits", [1, pytest.param(20, marks=pytest.mark.slow)])
def test_fanuc_held_out_compensation_gains_from_links(splits):
    """The weight is chosen within the fitted part."""
    robot, measurements = prepare(shared("fanuc_r2000ic/campaign"))
    gains = []
    for seed in range(splits):
        drawn = np.random.default_rng(seed).permutation(len(measurements))
        parts = measurements[np.sort(drawn[:20])], measurements[np.sort(drawn[20:])]
        both = [held_out_compensation(robot, *parts, name, seed=seed) for name in (MODELS[0], MODELS[-1])]
        gains.append(both[1] - both[0])
    assert np.mean(gains) > 0.04
