"""Labels of observations and names of targets go with the readings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import prepare

from jointstiff.simulator import default_arm, simulate_campaign
from jointstiff.solver.errors import MeasurementError


@pytest.fixture(scope="module")
def measurements():
    return prepare(simulate_campaign(default_arm(), configurations=5))[1]


def test_names_follow_the_readings(measurements):
    assert measurements.targets == ("P10", "P11", "P12")
    assert measurements[np.array([3, 0])].labels == ("c04", "c01")
    assert measurements[1:3].labels == ("c02", "c03")
    assert measurements.place(2) == "observations[2] 'c03'"


def test_what_has_no_name_is_numbered(measurements):
    plain = replace(measurements, labels=(), targets=())
    assert plain.labels == ("1", "2", "3", "4", "5")
    assert plain.targets == ("1", "2", "3")


@pytest.mark.parametrize("names", ["labels", "targets"])
def test_names_of_another_number_are_refused(measurements, names):
    with pytest.raises(MeasurementError, match=f"7 {names}"):
        replace(measurements, **{names: tuple("abcdefg")})
