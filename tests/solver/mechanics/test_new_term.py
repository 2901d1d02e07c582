"""A new term is a few lines and an entry: a test, a budget, a plan and the API then have it."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import estimate, prepare

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.simulator.equilibrium import deflections
from jointstiff.solver.design.candidates import Equipment, Loads, PlanRequest, build_reading_stack
from jointstiff.solver.evidence.causes import screen_estimate
from jointstiff.solver.evidence.fitted_causes import fit_causes
from jointstiff.solver.fit.estimate import UncertaintyBudget
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.mechanics.block import Term, move_by_torque
from jointstiff.solver.mechanics.measurements import CommonUncertainty
from jointstiff.solver.mechanics.postures import Postures
from jointstiff.solver.mechanics.terms import TERMS
from jointstiff.solver.outcome.result import build_budget_message

ARM, ZERO, UNCERTAINTY = default_arm(), np.array([150.0, -100.0, 80.0]), 20.0


def cell_zero(block, compliance):
    """Move the targets by a force that is constant in the flange's frame: the zero of a load cell there."""
    force = block.load_jacobian.transpose(0, 2, 1) @ block.postures.flange_rotation
    return move_by_torque(block, compliance, force)


@pytest.fixture
def cell_zero_term():
    """The term among the others; their order, which rounding follows, is restored."""
    term = Term("cell_zero", "N", cell_zero, lambda _: (UNCERTAINTY,), suspected=True, hedged=UNCERTAINTY)
    before = dict(TERMS)
    del TERMS["load_zero"]  # the same by its own name
    TERMS[term.name] = term
    yield
    TERMS.clear()
    TERMS.update(before)


@pytest.fixture(scope="module")
def campaign():
    return prepare(simulate_campaign(ARM, load="pull", configurations=24, seed=4, sigma=1e-5))


def test_it_is_tested_as_a_cause(campaign, cell_zero_term):
    """A zero of the load cell is seen where springs balance it exactly, and nothing where there is none."""
    robot, measurements = campaign
    at = Postures(robot, measurements.joints)
    places = (measurements.position[0] - at.flange_translation[0]) @ at.flange_rotation[0]
    force = measurements.force + at.flange_rotation @ ZERO
    load = (measurements.joints, force, measurements.moment, measurements.load_point)
    unloaded, loaded = deflections(ARM, *load, places)
    noise = np.random.default_rng(1).normal(0.0, np.sqrt(2.0) * 1e-5, loaded.shape)
    off = replace(measurements, deflection=loaded - unloaded + noise)
    seen, clean = (screen_estimate(Rows(robot, m), estimate(robot, m)) for m in (off, measurements))
    told, silent = (
        next(test.p_value for test in screening.tests if test.name == "cell_zero")
        for screening in (seen, clean)
    )
    assert told < 1e-15  # beside a load point that is assumed to 10 mm
    assert silent > 1e-3


def test_it_is_fitted_beside_the_joints(campaign, cell_zero_term):
    """What it moved is taken out of the readings, and the intervals hold its uncertainty."""
    robot, measurements = campaign
    rotation = ARM.posture(measurements.joints).flange_rotation
    off = replace(measurements, force=measurements.force + rotation @ ZERO)
    screening = screen_estimate(Rows(robot, off), estimate(robot, off))
    assert [cause.suspect.name for cause in screening.causes] == ["cell_zero"]
    beside = fit_causes(Rows(robot, off), [("cell_zero", None)])
    (zero,) = beside.fitted.unknowns
    np.testing.assert_allclose(zero, -ZERO, atol=10.0)
    found = estimate(robot, beside, complementary_stiffness="included")
    u = np.sqrt(np.diag(found.covariance))
    assert (np.abs(found.compliance - ARM.compliances) < 3 * u).all()


def test_it_has_a_line_in_the_budget_and_a_name_in_the_api(campaign, cell_zero_term):
    robot, measurements = campaign
    stated = replace(measurements, common_uncertainty=CommonUncertainty())
    budget = UncertaintyBudget.from_estimate(estimate(robot, stated), 0.95)
    message = build_budget_message(budget, robot.joint_names, ())
    (part,) = (part for part in message.components if part.source == "cell_zero")
    assert all(0.0 < u < 0.1 / k for u, k in zip(part.contributions, ARM.stiffnesses, strict=True))
    # Neglecting K_c is a part of the whole budget alone.
    parts, included = [part.contributions for part in message.components], [True, True, False]
    assert [part.included for part in message.components] == included
    for expanded, shown in (
        (message.expanded_uncertainty, parts[:2]),
        (message.expanded_with_model_error, parts),
    ):
        together = np.linalg.norm(shown, axis=0)
        np.testing.assert_allclose(expanded, message.coverage_factor * together, rtol=1e-9)


def test_it_is_a_nuisance_of_plans(campaign, cell_zero_term):
    """Its columns follow those of the joints, in units of what is known of it."""
    robot, measurements = campaign
    loads = Loads("any_direction", 1500.0, np.full(6, np.inf))
    equipment = Equipment(np.zeros((3, 3)), measurements.load_point[0], loads, 1e-5)
    request = PlanRequest(equipment, 6, 1.0 / ARM.stiffnesses, np.full(6, np.inf))
    rows = build_reading_stack(robot, request, measurements).rows[..., :-1]
    twice = build_reading_stack(robot, replace(request, nominal=2.0 * request.nominal), measurements).rows[
        ..., :-1
    ]
    assert rows.shape == (24, 9, 6 + 3)
    np.testing.assert_allclose(twice[..., 6:], 2.0 * rows[..., 6:])
