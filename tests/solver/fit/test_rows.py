"""Rows of a campaign: what is computed once, and what goes to other processes."""

import pickle

import numpy as np
from support.campaigns import prepare

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.springs import JOINTS


def measured():
    return Rows(*prepare(simulate_campaign(default_arm(), load="pull", configurations=5, seed=0)))


def test_rows_compute_their_kinematics_once():
    rows = measured()
    assert rows.block is rows.block
    assert rows.at(None).block is rows.block
    assert rows.select_evenly(5) is rows
    assert rows.select_evenly(4).block is not rows.block


def test_pickled_rows_carry_no_kinematics_and_give_the_same_numbers():
    rows = measured()
    size = len(pickle.dumps(rows))
    stack = rows.stack([JOINTS], np.zeros(rows.robot.n))
    content = pickle.dumps(rows)
    assert len(content) == size
    again = pickle.loads(content)
    assert len(again) == len(rows) == 5
    assert np.array_equal(again.stack([JOINTS], np.zeros(rows.robot.n)).rows, stack.rows)
