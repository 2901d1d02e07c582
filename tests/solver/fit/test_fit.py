"""One fit for every model: what its result has, and what it refuses."""

import numpy as np
import pytest
from support.campaigns import ARM, settings_of, simulated

from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fit.elastic import Penalised
from jointstiff.solver.fit.fit import Fit, fit
from jointstiff.solver.fit.part import compress_parts
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.models import JOINTS, MODELS, Columns

COLUMNS = Columns(6, tuple(range(6)))


@pytest.fixture(scope="module")
def campaign():
    return simulated(load="pull", configurations=20, sigma=2e-5, seed=5)


def fit_model(campaign, model) -> Fit:
    robot, measurements = campaign
    rows = Rows(robot, measurements)
    if model is JOINTS:
        return fit(rows, model, settings_of(robot))
    (whole_set,) = compress_parts(rows, COLUMNS, [np.arange(len(measurements))])
    return fit(rows, model, Penalised(COLUMNS, np.ones(6, dtype=bool), 10.0, whole_set))


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_every_model_has_sigma_proof_and_the_compliances_of_an_arm_of_joints(campaign, model):
    """With a strong penalty nothing but the joints bends: each model gives the joints of the arm."""
    found = fit_model(campaign, model)
    assert found.model is model
    assert found.scale.given
    assert found.scale.chi_square == pytest.approx(found.scale.degrees_of_freedom, rel=0.3)
    assert all(certificate.primal == 0.0 for certificate in found.certificates)
    assert all(certificate.gap <= 1e-2 for certificate in found.certificates)
    if not model.couples_joints:
        np.testing.assert_allclose(found.compliance, ARM.compliances, rtol=0.2)


def test_matrices_without_a_penalty_are_refused(campaign):
    robot, measurements = campaign
    for model in MODELS[1:]:
        with pytest.raises(UnsupportedMethodError, match="has compliance matrices") as refused:
            fit(Rows(robot, measurements), model, settings_of(robot))
        assert refused.value.remedy == "give the weight of the penalty"
