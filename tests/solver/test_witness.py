"""Clarabel as a witness: a solver that lies is named or refused, and an honest one is not accused."""

from types import SimpleNamespace

import clarabel
import numpy as np
import pytest
from support.cases import campaign as read_campaign

from jointstiff import identify
from jointstiff.service.problems import CampaignError
from jointstiff.solver.fit.self_check import check_solver

LIES = {
    "factor": lambda values, _: 1.01 * values,
    "sign": lambda values, _: -values,
    "noise": lambda values, generator: values * (1.0 + 0.01 * generator.standard_normal(len(values))),
}
FEW_FOLDS = {"cross_validation": {"folds": 2}}
REQUESTS = [
    *(
        ("moments", {"elasticity": "joints", "method": method, "loss": loss})
        for method in ("partial_pose", "complete_pose", "decoupled_partial_pose")
        for loss in ("squared", "huber")
    ),
    *(
        ("beam_small", {"elasticity": elasticity, "link_penalty": 1e-2, "loss": loss} | FEW_FOLDS)
        for elasticity in ("coupled_joints", "diagonal_links", "joints_and_base")
        for loss in ("squared", "huber")
    ),
    ("weight_1", {"weight": {}}),
]
"""A campaign and the options of a run: each method, each loss, and models of each shape of cone."""


def is_named_or_refused(campaign, options):
    try:
        result = identify(read_campaign(campaign), **options).result
    except CampaignError:
        return True
    return result is None or "solver_disagrees" in {warning.code for warning in result.warnings}


@pytest.mark.parametrize(("campaign", "options"), REQUESTS, ids=str)
def test_an_honest_solver_is_not_accused(campaign, options):
    assert not is_named_or_refused(campaign, options)


def lie_by(monkeypatch, lie):
    honest, generator = clarabel.DefaultSolver, np.random.default_rng(0)

    class Lying:
        def __init__(self, *arguments):
            self.solver = honest(*arguments)

        def solve(self):
            found = self.solver.solve()
            x, z = (LIES[lie](np.asarray(values), generator) for values in (found.x, found.z))
            return SimpleNamespace(x=x, z=z, status=found.status)

    monkeypatch.setattr(clarabel, "DefaultSolver", Lying)


def test_an_honest_solver_passes_the_self_check():
    witness = check_solver()
    assert witness.agrees
    assert witness.distance < 1e-7


@pytest.mark.parametrize("lie", LIES)
def test_a_lying_solver_fails_the_self_check(monkeypatch, lie):
    lie_by(monkeypatch, lie)
    assert not check_solver().agrees


@pytest.mark.parametrize("lie", LIES)
@pytest.mark.parametrize(("campaign", "options"), REQUESTS, ids=str)
def test_a_lying_solver_is_named_or_refused(monkeypatch, campaign, options, lie):
    lie_by(monkeypatch, lie)
    assert is_named_or_refused(campaign, options)


def test_own_weight_publishes_how_far_the_solver_is_from_the_proved_optimum():
    assert identify(read_campaign("weight_1"), weight={}).result.certificate.solver_distance < 2e-5


def test_the_number_stands_where_the_solver_gives_no_answer(monkeypatch):
    options = {"elasticity": "joints"}
    right = identify(read_campaign("moments"), **options).result

    class Silent:
        def __init__(self, *arguments):
            self.unknowns = len(arguments[1])

        def solve(self):
            x = np.full(self.unknowns, np.nan)
            return SimpleNamespace(x=x, z=x, status=clarabel.SolverStatus.NumericalError)

    monkeypatch.setattr(clarabel, "DefaultSolver", Silent)
    found = identify(read_campaign("moments"), **options).result
    assert [joint.stiffness for joint in found.joints] == [joint.stiffness for joint in right.joints]
    assert "solver_disagrees" in {warning.code for warning in found.warnings}
    assert right.certificate.solver_distance < 2e-5
    assert found.certificate.solver_distance is None
