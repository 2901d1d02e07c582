"""A base that bends against exact springs below joint 1, and clean arms beside it."""

from __future__ import annotations

import numpy as np
import pytest
from support.campaigns import estimate, prepare

from jointstiff.schemas.options import CrossValidation
from jointstiff.simulator import default_arm
from jointstiff.simulator.base import pedestal_campaign
from jointstiff.solver.estimation.causes import LINKS_LEVEL, screen_estimate
from jointstiff.solver.estimation.conic import to_vector
from jointstiff.solver.links.choice import Folds, compared_models
from jointstiff.solver.links.fit import effective_compliances, effective_rows, estimate_elastic
from jointstiff.solver.links.model import MODELS, WITH_BASE, ElasticColumns, ElasticModel, elastic_blocks
from jointstiff.solver.mechanics.configuration import Configurations
from jointstiff.solver.mechanics.springs import BASE
from jointstiff.solver.predict.forward import LoadCases
from jointstiff.solver.predict.models import ElasticPredictor

ARM, STIFFNESS, FOOT = default_arm(), np.array([8e6, 2e7]), -0.8
COLUMNS = ElasticColumns(6, tuple(range(6)))
TILT = np.array([[0.0, FOOT, 0.0, 1.0, 0.0, 0.0], [-FOOT, 0.0, 0.0, 0.0, 1.0, 0.0]])
"""Motion of R0's origin by a tilt about x and y of the foot: translation, then rotation."""


def compliances():
    """Compliances of the arm, and of its pedestal about the origin of R0."""
    truth = np.zeros(COLUMNS.width)
    truth[COLUMNS.joints] = ARM.compliances
    truth[COLUMNS.link(BASE)] = to_vector(TILT.T @ np.diag(1.0 / STIFFNESS) @ TILT)
    return truth


@pytest.mark.parametrize("force", [1500.0, 150.0])
def test_the_exact_balance_on_a_pedestal_is_the_linear_model_to_first_order(force):
    document = pedestal_campaign(ARM, STIFFNESS, foot=FOOT, configurations=8, force=force, sigma=0.0, seed=2)
    robot, measurements = prepare(document)
    rows = np.concatenate([rows[..., :-1] for _, rows in elastic_blocks(robot, measurements, COLUMNS)])
    apart = np.abs(rows @ compliances() - measurements.deflection).max()
    assert apart < 2.0e-6 * force * np.abs(measurements.deflection).max()


def test_a_turn_of_the_base_about_the_first_axis_is_joint_1(campaign):
    robot, measurements = campaign
    (_, rows), *_ = elastic_blocks(robot, measurements, COLUMNS)
    about = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    turned = rows[..., COLUMNS.link(BASE)] @ to_vector(np.outer(about, about))
    np.testing.assert_allclose(turned, rows[..., 0], atol=1e-9 * np.abs(rows[..., 0]).max())
    effective = effective_rows(robot, COLUMNS)[:, COLUMNS.link(BASE)] @ to_vector(np.outer(about, about))
    np.testing.assert_allclose(effective, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], atol=1e-12)


@pytest.fixture(scope="module")
def campaign():
    return prepare(pedestal_campaign(ARM, STIFFNESS, foot=FOOT, seed=1))


@pytest.fixture(scope="module")
def found(campaign):
    folds = Folds(*campaign, COLUMNS, np.ones(6, dtype=bool), CrossValidation(folds=3, draws=1))
    return estimate_elastic(folds, ElasticModel("joints_and_base", COLUMNS), 1e-3)


def test_base_and_joints_are_found_together(campaign, found):
    effective = effective_compliances(campaign[0], found, 0.95)
    np.testing.assert_allclose(effective.compliance[:3], ARM.compliances[:3], rtol=0.05)
    assert found.base is not None
    assert found.base.parameters == 21
    softest = [each.value for each in found.base.rotation]
    np.testing.assert_allclose(softest[:2], 1.0 / STIFFNESS, rtol=0.15)
    assert softest[2] < 0.1 * softest[1]
    assert not found.links
    assert [each.kind for each in found.elements].count("base") == 1


def test_the_model_predicts_other_postures_and_places(campaign, found):
    """At other postures, and where no target was."""
    robot = campaign[0]
    document = pedestal_campaign(ARM, STIFFNESS, foot=FOOT, configurations=20, sigma=0.0, seed=9)
    _, other = prepare(document)
    at = Configurations(robot, other.joints)
    place = (other.position[:, 0] - at.flange_translation)[:, None] @ at.flange_rotation
    cases = LoadCases(other.joints, other.force, other.moment, other.load_point, place[:, 0])
    predicted = ElasticPredictor.of(robot, found).deflect(cases)
    off = np.linalg.norm(predicted.displacement - other.deflection[:, 0], axis=1)
    assert off.mean() < 0.02 * np.linalg.norm(other.deflection[:, 0], axis=1).mean()


def test_a_test_speaks_for_a_pedestal_and_links_have_nothing_to_say_beside_it(campaign):
    screening = screen_estimate(*campaign, estimate(*campaign))
    assert screening.base_speaks
    assert screening.base_p_value < 1e-20
    assert screening.links_beside_base > LINKS_LEVEL
    assert compared_models(screening, None) == ("joints", "joints_and_base")


def test_a_clean_arm_has_no_base(campaign):
    clean = prepare(pedestal_campaign(ARM, np.inf, seed=1))
    screening = screen_estimate(*clean, estimate(*clean))
    assert not screening.base_speaks
    assert not WITH_BASE & set(compared_models(screening, None))
    assert not WITH_BASE & set(compared_models(screening, "joints_and_links"))
    assert compared_models(screening, "joints_and_base") == MODELS
