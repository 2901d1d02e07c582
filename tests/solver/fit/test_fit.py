"""One fit for every model: what its result has, and what it refuses."""

from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from scipy import special
from support import sagging
from support.campaigns import ARM, settings_of, simulated

from jointstiff.solver.errors import UnsupportedMethodError
from jointstiff.solver.fit.elastic import Penalised
from jointstiff.solver.fit.fit import Fit, fit
from jointstiff.solver.fit.part import compress_parts
from jointstiff.solver.fit.rows import Rows
from jointstiff.solver.fit.statements import Statements
from jointstiff.solver.fit.weight import Weighed
from jointstiff.solver.mechanics.measurements import CommonUncertainty
from jointstiff.solver.mechanics.terms import list_stated_terms
from jointstiff.solver.models import ELASTIC_MODELS, JOINTS, MODELS, OWN_WEIGHT, Columns

COLUMNS = Columns(6, tuple(range(6)))
OFF = np.array([0.03, 0.0, 0.0])
"""Error of a load point that is stated within as much [m]."""


class Readings(NamedTuple):
    """Readings of an arm whose joints alone bend, by what a model is fitted to."""

    rows: Rows  #: deflections under known loads
    positions: sagging.WeightReadings  #: positions without and with a known load

    def of(self, model):
        return self.positions if model is OWN_WEIGHT else self.rows

    def with_load_point(self, off, uncertainty):
        measurements = self.rows.measurements
        stated = CommonUncertainty(load_point=uncertainty)
        moved = replace(measurements, load_point=measurements.load_point + off, common_uncertainty=stated)
        positions = replace(self.positions, load_point=self.positions.load_point + off)
        return Readings(self.rows.of(moved), sagging.state_loads(positions, stated))


@pytest.fixture(scope="module")
def readings():
    robot, measurements = simulated(load="pull", configurations=20, sigma=2e-5, seed=5)
    exact_loads = Rows(robot, replace(measurements, common_uncertainty=CommonUncertainty()))
    return Readings(exact_loads, sagging.campaign(postures=20, payload=100.0))


def penalised(rows):
    measurements = rows.measurements
    statements = Statements(
        list_stated_terms(measurements), measurements.common_uncertainty, ARM.compliances, measurements.sigma
    )
    (whole_set,) = compress_parts(rows, COLUMNS, [np.arange(len(rows))], statements)
    return Penalised(COLUMNS, np.ones(6, dtype=bool), 10.0, whole_set)


def fit_model(readings, model) -> Fit:
    rows = readings.of(model)
    if model is OWN_WEIGHT:
        return fit(rows, model, Weighed())
    return fit(rows, model, settings_of(rows.robot) if model is JOINTS else penalised(rows))


of_every_model = pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)


@of_every_model
def test_every_model_has_sigma_proof_and_the_compliances_of_an_arm_of_joints(readings, model):
    """With a strong penalty nothing but the joints bends: each model gives the joints of the arm."""
    found = fit_model(readings, model)
    assert found.model is model
    assert found.scale.given
    assert found.scale.chi_square == pytest.approx(found.scale.degrees_of_freedom, rel=0.3)
    assert all(certificate.primal == 0.0 for certificate in found.certificates)
    assert all(certificate.gap <= 1e-2 for certificate in found.certificates)
    assert (found.compliance >= 0.0).all()
    first = 1 if model is OWN_WEIGHT else 0  # no weight twists the vertical axis
    if model.name != "coupled_joints":
        np.testing.assert_allclose(found.compliance[first:], ARM.compliances[first:], rtol=0.2)


@of_every_model
def test_every_model_fits_a_stated_error_of_the_load(readings, model):
    exact = fit_model(readings.with_load_point(OFF, 0.0), model)
    stated = fit_model(readings.with_load_point(OFF, 0.03), model)
    assert [term.name for term in exact.statements.terms] == []
    assert [term.name for term in stated.statements.terms] == ["load_point"]
    assert stated.scale.chi_square == pytest.approx(stated.scale.degrees_of_freedom, rel=0.3)
    gain = exact.scale.chi_square - stated.scale.chi_square
    assert special.chdtrc(3, gain) < 1e-3  # three coordinates of the load point


def test_matrices_without_a_penalty_are_refused(readings):
    for model in ELASTIC_MODELS[1:]:
        with pytest.raises(UnsupportedMethodError, match="has compliance matrices") as refused:
            fit(readings.rows, model, settings_of(readings.rows.robot))
        assert refused.value.remedy == "give the weight of the penalty"


def test_readings_models_and_options_that_do_not_belong_together_are_refused(readings):
    weight = {readings.positions, OWN_WEIGHT, Weighed()}
    for rows, model in product(readings, (JOINTS, OWN_WEIGHT)):
        for options in (settings_of(readings.rows.robot), penalised(readings.rows), Weighed()):
            if len(weight & {rows, model, options}) in (0, 3):
                continue
            with pytest.raises(UnsupportedMethodError, match=f"{model.name} with the options") as refused:
                fit(rows, model, options)
            assert "`WeightReadings` by the model own_weight with `Weighed`" in refused.value.remedy
