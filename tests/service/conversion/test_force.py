"""Uncertainty of the force from the message to the budget of a result."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

import jointstiff
from jointstiff.schemas.measurement import Noise
from jointstiff.simulator import default_arm, simulate_campaign


def identified(noise):
    document = simulate_campaign(default_arm(), configurations=8, load="pull")
    document["measurement_set"]["noise"] = noise
    return jointstiff.identify(document)


def test_the_budget_of_a_run_adds_up():
    for joint in identified({"sigma": 2e-5, "force": {"scale": 0.01, "direction": 0.002}}).result.joints:
        budget = joint.budget
        assert budget.force_scale == pytest.approx(0.01 * joint.compliance, rel=1e-6)
        parts = budget.readings**2 + budget.force_scale**2 + budget.force_direction**2
        assert parts == pytest.approx(joint.standard_uncertainty**2, rel=1e-9)


def test_it_may_stand_alone():
    run = identified({"force": {"scale": 0.01}})
    assert run.result.goodness.sigma_source == "residuals"
    assert run.result.joints[0].budget.force_direction == 0.0
    assert identified({"sigma": 2e-5}).result.joints[0].budget is None


@pytest.mark.parametrize("force", [{}, {"scale": 0.6}, {"scale": -0.1}, {"direction": 1.0}])
def test_no_such_uncertainty(force):
    with pytest.raises(ValidationError):
        Noise.model_validate({"force": force})
