"""Every recorded answer is given again; the slow ones each night."""

import pytest
from support.recorded_answers import OF_SHARED_DATA, differences, recorded
from support.shared_data import MISSING, SHARED

CASES = recorded()
SLOW = (
    "beam: ",
    "fanuc: joints_and_links",
    ": default",
    "dead_weight_motor: {",
    "joints, absolute",
    "beam_small: automatic",
    "squared",
    "beam_small: diagonal_links, huber",
    "common_errors: joints",
    "weight_centres",
    "plan: of a gauge and links",
    "pedestal: base",
    "poses_wrong",
    "two links",
    "one link, absolute",
    "weight_1: balancer",
    "weight_1: gravity estimated",
)
"""Words of cases that take seconds, or are much like others; small campaigns have all of them by day."""
LARGE = {"pair", "pair in order", "plan", "geometry", "map", "compare: methods"}
"""Names of others: of the shared data."""


def _case(name):
    slow = name in LARGE or any(word in name for word in SLOW)
    return pytest.param(CASES[name], id=name, marks=[pytest.mark.slow] if slow else [])


@pytest.mark.parametrize("case", [_case(name) for name in CASES])
def test_recorded_answer(case):
    if not SHARED.is_dir() and OF_SHARED_DATA.keys() & set(case.campaigns):
        pytest.skip(MISSING)
    assert not differences(case.answer, case.again())
